#!/bin/sh
# Prints include/nvsprior.h as src/capi has it. Usage: header.sh > include/nvsprior.h
set -eu
cd "$(dirname "$0")/.."

# One source in the header's order, so that cbindgen sees only what is exported.
source=$(mktemp --suffix=.rs)
trap 'rm -f "$source"' EXIT
parts="structs version status log thread allocator memory device vulkan engine prior dmabuf image frame encoding encoder
    lens decoder sender collector"
for part in $parts; do
    sed '/^\/\/!/d' "src/capi/$part.rs"
done > "$source"
cbindgen --quiet --config cbindgen.toml "$source" |
    sed -e 's!^// # \(Safety\|Parameters\)$!// Parameters:!' \
        -e '\!^// ```c$!,\!^// ```$!{/```/d; s!^// !//     !}' |
    awk '
        # A parameter whose line, or the lines after it, say "Not NULL" gets an attribute.
        /^\/\/ - `/ { name = $0; sub(/^\/\/ - /, "", name); sub(/:.*/, "", name); gsub(/[`,]/, "", name) }
        /^\/\// { if ($0 ~ /Not NULL/ && name != "") required[name] = 1; print; next }
        # A call that cannot fail if it is used as it should be may be left unchecked.
        /^nvsp_status nvsp_/ && !/_last_error\(|struct_init\(/ { print "NVSP_CHECKED" }
        /^[a-z].*nvsp_[a-z_]*\(/ && !/^typedef|^template/ { prototype = ""; inside = 1 }
        inside {
            prototype = prototype $0
            if ($0 !~ /\);$/) { print; next }
            arguments = prototype
            sub(/^[^(]*\(/, "", arguments)
            count = split(arguments, list, ",")
            places = ""
            for (i = 1; i <= count; i++) {
                words = list[i]
                gsub(/[^A-Za-z0-9_]+/, " ", words)
                n = split(words, word, " ")
                if (n > 0 && word[n] in required) places = places (places == "" ? "" : ", ") i
            }
            line = $0
            if (places != "") sub(/\);$/, ") NVSP_NONNULL(" places ");", line)
            print line
            inside = 0; name = ""; delete required
            next
        }
        { if ($0 == "") { name = ""; delete required }; print }
    '
