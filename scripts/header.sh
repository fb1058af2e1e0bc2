#!/bin/sh
# Prints include/nvsprior.h as src/capi has it. Usage: header.sh > include/nvsprior.h
set -eu
cd "$(dirname "$0")/.."

# One source in the header's order, so that cbindgen sees only what is exported.
source=$(mktemp --suffix=.rs)
trap 'rm -f "$source"' EXIT
for part in structs version status log thread engine prior image frame encoder decoder modem; do
    sed '/^\/\/!/d' "src/capi/$part.rs"
done > "$source"
cbindgen --quiet --config cbindgen.toml "$source" | sed 's!^// # \(Safety\|Parameters\)$!// Parameters:!'
