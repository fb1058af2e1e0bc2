#!/bin/sh
# Builds the Debian packages libnvsprior1, libnvsprior-dev and nvsprior, and checks them with lintian.
# Usage: [GLIBC=2.31] deb.sh [ARCHITECTURE...]; amd64 and arm64 if none is named. They are left in target/debian/.
set -eu
cd "$(dirname "$0")/.."
root=$PWD
out=$root/target/debian
version=$(dpkg-parsechangelog -l packaging/debian/changelog -S Version)
upstream=${version%-*}
[ "$upstream" = "$(sed -n '/^\[package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)" ] ||
    { echo "deb: packaging/debian/changelog is of $upstream, Cargo.toml of another version" >&2; exit 1; }

for architecture in ${*:-amd64 arm64}; do
    # Only the packaging is copied: debian/rules builds in the source tree.
    work=$out/build/$architecture
    rm -rf "$work"
    mkdir -p "$work/nvsprior-$upstream"
    cp -r packaging/debian "$work/nvsprior-$upstream/debian"
    # Debian's own compilers are not used, so its package manager cannot say whether they are there.
    (cd "$work/nvsprior-$upstream" &&
        SOURCE=$root DEB_BUILD_OPTIONS="noautodbgsym nocheck" CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$root/target}" \
            dpkg-buildpackage --build=binary --host-arch "$architecture" --no-check-builddeps \
            --unsigned-source --unsigned-changes) > "$work/log" 2>&1 ||
        { tail -n 40 "$work/log" >&2; echo "deb: failed; the whole output is in $work/log" >&2; exit 1; }
    rm -f "$out"/*_"$architecture".deb
    mv "$work"/*_"$architecture".deb "$out/"
    for package in "$out"/*_"$architecture".deb; do
        depends=$(dpkg-deb -f "$package" Depends | sed 's/^/ depends on /')
        echo "$(basename "$package"): $(wc -c < "$package") bytes;$depends"
    done
    # As root lintian warns about being root. The packages are not uploaded to Debian, where a bug would ask for them.
    lintian --allow-root --fail-on error --suppress-tags initial-upload-closes-no-bugs "$out"/*_"$architecture".deb
    echo "lintian: no errors ($architecture)"
done
