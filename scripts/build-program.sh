#!/bin/sh
# Builds the program nvsprior for release. Usage: [GLIBC=] build-program.sh TARGET FILE
# GLIBC: as for install.sh.
set -eu
cd "$(dirname "$0")/.."
[ $# = 2 ] || { echo "usage: build-program.sh TARGET FILE" >&2; exit 2; }
target=$1
name=$(echo "$target" | tr 'a-z-' 'A-Z_')
if [ -n "${GLIBC:-}" ]; then
    linker=$(scripts/zig-linker.sh "$target" "$GLIBC")
    export "CC_$(echo "$target" | tr - _)=$linker"
    # Not the library's folder: cargo-c builds with other flags, and each would build all anew after the other.
    export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-target}/glibc-$GLIBC-program"
elif [ "$target" != "$(rustc --print host-tuple)" ]; then
    linker=$(echo "$target" | sed 's/-unknown//')-gcc
fi
[ -z "${linker:-}" ] || export "CARGO_TARGET_${name}_LINKER=$linker"
cargo build --release --locked -p nvsprior-cli --target "$target"
install -D -m 755 "${CARGO_TARGET_DIR:-target}/$target/release/nvsprior" "$2"
