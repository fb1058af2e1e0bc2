#!/bin/sh
# Builds the C library into Meson's build folder.
# Usage: meson-build.sh DIR PROFILE TARGET GLIBC; the last two may be empty
set -eu
[ $# = 4 ] || { echo "usage: meson-build.sh DIR PROFILE TARGET GLIBC" >&2; exit 2; }
dir=$(realpath "$1")
tree=$dir/nvsprior-tree
# shellcheck disable=SC2086 # No target is no word.
PREFIX=$tree LIBDIR="" INCLUDEDIR="" DESTDIR="" GLIBC=$4 CARGO_TARGET_DIR=$dir/cargo \
    "$(dirname "$0")/install.sh" "$2" $3
for file in libnvsprior.so libnvsprior.so.1 libnvsprior.a; do
    cp -L "$tree/lib/$file" "$dir/$file.new"
    # Unchanged, it is not linked again.
    cmp -s "$dir/$file.new" "$dir/$file" && rm "$dir/$file.new" || mv "$dir/$file.new" "$dir/$file"
done
