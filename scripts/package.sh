#!/bin/sh
# Packs the crates that are published, and builds each from its packed file alone. Usage: package.sh
set -eu
cd "$(dirname "$0")/.."

# Cargo assumes that a crate of one version never changes. So remove what an earlier run unpacked and built: else the
# library would be built with the kernels of that run.
target=${CARGO_TARGET_DIR:-target}/packing
rm -rf "$target" "${CARGO_HOME:-$HOME/.cargo}"/registry/src/*/nvsprior-*

# Cargo builds them from what it packed: the library takes the kernels of the packed file, not of the tree. Not
# optimised, since this only tests whether they build.
CARGO_TARGET_DIR=$target cargo package --allow-dirty \
    -p nvsprior-kernels -p nvsprior -p nvsprior-formats -p nvsprior-link \
    --config 'profile.dev.opt-level=0' --config 'profile.dev.package."*".opt-level=0'

# Nothing of the tools comes with the library.
for crate in "$target"/package/nvsprior-*.crate; do
    printf '%s: %s bytes, %s files\n' "$(basename "$crate")" "$(wc -c < "$crate")" \
        "$(tar tzf "$crate" | wc -l)"
done
if tar tzf "$target"/package/nvsprior-[0-9]*.crate | grep -q '/tools/\|/shaders-rs/\|/crates/'; then
    echo "package: the library's file holds more than the library" >&2
    exit 1
fi
