#!/bin/sh
# Builds a test of the library for another machine, and runs it under QEMU.
# Usage: cross-test.sh TARGET TEST [NAME]; NAME: only the tests whose names have it
set -eu
cd "$(dirname "$0")/.."
[ $# = 2 ] || [ $# = 3 ] || { echo "usage: cross-test.sh TARGET TEST [NAME]" >&2; exit 2; }
target=$1
gnu=$(echo "$target" | sed 's/-unknown//')
name=CARGO_TARGET_$(echo "$target" | tr 'a-z-' 'A-Z_')
export "${name}_LINKER=$gnu-gcc" "${name}_RUNNER=qemu-${target%%-*} -L /usr/$gnu"
cargo test -p nvsprior --no-default-features --target "$target" --test "$2" ${3:+"$3"}
