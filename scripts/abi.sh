#!/bin/sh
# The C library's ABI, compared with the committed one by libabigail. Usage: abi.sh check|baseline|selftest
#
# check     fails if a program that was built with the baseline's header may not run with this one's library: a function
#           gone or with other parameters, a structure laid out differently, a constant with another value. What may
#           come: functions, constants, and fields at the end of a structure that begins with struct_size.
# baseline  writes packaging/abi/ anew. After a release only what check lets pass may change.
# selftest  shows that check fails if it should.
#
# What is compared are the headers: a library in C is made that has its functions. c-test.sh checks the rest: that the
# headers are those of the sources, that the real library exports the functions, and that sizes are the same in both.
set -eu
cd "$(dirname "$0")/.."
baseline=packaging/abi
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# The ABI and the constants of the headers in a folder, into another folder.
describe() { # Folder of headers, folder.
    mkdir -p "$2"
    cp "$1"/*.h "$2/"
    # One line for each function, without the names of parameters; then a body for each.
    (
        cd "$2"
        gcc -std=gnu2x -fsyntax-only -aux-info functions -x c nvsprior_extra.h
        {
            echo '#include "nvsprior_extra.h"'
            sed -n '/nvsprior\(_extra\)\?\.h:/s/^.*\*\/ extern \(.*\);.*/\1 { __builtin_trap(); }/p' functions
        } > library.c
        gcc -std=gnu2x -g -O0 -fPIC -shared -Wl,-soname,libnvsprior.so.1 library.c -o libnvsprior.so
        abidw --no-comp-dir-path --no-corpus-path --no-show-locs --no-elf-needed libnvsprior.so --out-file abi.xml
        # The version of a header is no promise.
        gcc -dM -E -x c nvsprior_extra.h | grep '^#define NVSP_' |
            grep -v '^#define NVSP_\([A-Z_]*VERSION[A-Z_]*\) \|(' | LC_ALL=C sort > constants
        # The fields of each structure, numbered: fields that are appended change no line. abidiff lets any change pass
        # in a structure that may grow.
        awk '/^typedef struct .*\{/ { name = $3; number = 0; next }
            /^}/ { name = "" }
            name != "" && $1 !~ /^\/\// { sub(/\/\/.*/, ""); $1 = $1; print name, ++number, $0 }' ./*.h |
            LC_ALL=C sort > fields
    )
}

# Whether a header may follow the baseline.
compatible() { # Folder of the baseline, folder of the header.
    # A structure that stands within another one may not grow: what comes after it would move.
    sed -n 's/^  struct \(nvsp_[a-z_]*\) [a-z_]*;.*/\1/p' "$2"/*.h | LC_ALL=C sort -u > "$scratch/within"
    growing=$(awk '
        /^(typedef )?struct .*\{/ { name = $0; sub(/.*struct /, "", name); sub(/ .*/, "", name); first = 1; next }
        first && NF && $1 !~ /^\/\// { if ($0 ~ / struct_size,/) print name; first = 0 }' "$2"/*.h |
        LC_ALL=C sort | LC_ALL=C comm -23 - "$scratch/within" | paste -sd '|')
    cat > "$scratch/growth" <<END
[suppress_type]
  type_kind = struct
  name_regexp = ^($growing)\$
  has_data_member_inserted_at = end
END
    failed=0
    abidiff --no-added-syms --suppressions "$scratch/growth" "$1/abi.xml" "$2/abi.xml" > "$scratch/report" || failed=1
    for list in constants fields; do
        LC_ALL=C comm -23 "$1/$list" "$2/$list"
    done > "$scratch/gone"
    [ ! -s "$scratch/gone" ] || failed=1
    return $failed
}

check() {
    describe include "$scratch/now"
    nm -D --defined-only "$scratch/now/libnvsprior.so" | sed 's/.* //' | LC_ALL=C sort | diff tests/c/symbols.txt - ||
        { echo "abi: the header's functions are not those of tests/c/symbols.txt" >&2; exit 1; }
    compatible "$baseline" "$scratch/now" || {
        cat "$scratch/report" >&2
        sed 's/^/gone or of another value: /' "$scratch/gone" >&2
        echo "abi: programs built with the baseline may not run with this library. Before the first release:" >&2
        echo "make abi-baseline. After it: change it back, or raise NVSP_ABI_VERSION and the soname." >&2
        exit 1
    }
    echo "$(wc -l < tests/c/symbols.txt) functions and $(wc -l < "$baseline/constants") constants as in the baseline"
}

# Each change breaks programs, but for the last, which does not.
selftest() {
    describe include "$scratch/base"
    change() { # A name, what must come of it, a sed script.
        mkdir -p "$scratch/changed"
        for header in include/*.h; do
            sed "$3" "$header" > "$scratch/changed/${header#*/}"
        done
        ! diff -rq include "$scratch/changed" > /dev/null || { echo "abi: $1 changes nothing" >&2; exit 1; }
        describe "$scratch/changed" "$scratch/$1"
        result=fails
        ! compatible "$scratch/base" "$scratch/$1" || result=passes
        [ "$result" = "$2" ] || { echo "abi: $1 $result" >&2; cat "$scratch/report" >&2; exit 1; }
    }
    change constant fails 's/^#define NVSP_FORMAT_BGR8 2 /#define NVSP_FORMAT_BGR8 7 /'
    change removed fails 's/^const char \*nvsp_status_text(nvsp_status status);$//'
    change parameter fails 's/^\(const char \*nvsp_status_text(\)nvsp_status status);$/\1int64_t status);/'
    change field fails '/^typedef struct nvsp_pose {/,/^}/s/double translation/float translation/'
    change type fails '/^typedef struct nvsp_engine_options {/,/^}/s/uint32_t flags/float flags/'
    change extra fails 's/uint64_t modifier,/uint32_t modifier,/'
    change grown fails '/^typedef struct nvsp_pose {/,/^}/s/^}/    float more;\n}/'
    change added passes 's/^const char \*nvsp_status_text(nvsp_status status);$/&\nint nvsp_new(void);/'
    change tail passes '/^typedef struct nvsp_engine_options {/,/^}/s/^}/    uint64_t more;\n}/'
    echo "seven changes that break programs are found, two that do not pass"
}

case ${1:-} in
check | selftest) "$1" ;;
baseline)
    describe include "$scratch/now"
    mkdir -p "$baseline"
    cp "$scratch/now/abi.xml" "$scratch/now/constants" "$scratch/now/fields" "$baseline/"
    echo "$baseline: $(wc -c < "$baseline/abi.xml") bytes, $(wc -l < "$baseline/constants") constants"
    ;;
*) echo "usage: abi.sh check|baseline|selftest" >&2; exit 2 ;;
esac
