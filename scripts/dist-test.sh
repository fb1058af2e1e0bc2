#!/bin/sh
# Builds and installs the C library from the source archive of dist.sh, without a network and without the crates that
# cargo keeps. Then links a program against it.
set -eu
cd "$(dirname "$0")/.."
version=$(sed -n '/^\[package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
archive=$PWD/target/dist/nvsprior-$version.tar.xz
[ -e "$archive" ] || { echo "dist-test: no $archive: run make dist" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tar -C "$work" -xf "$archive"

# A signature by a key that is made for this holds, and does not hold for another archive.
(cd target/dist && sha256sum --check --quiet SHA256SUMS)
if command -v gpg > /dev/null; then
    mkdir -m 700 "$work/gnupg"
    export GNUPGHOME="$work/gnupg"
    gpg --batch --quiet --passphrase '' --quick-generate-key 'nvsprior dist-test' ed25519 sign 1d
    SIGN='nvsprior dist-test' scripts/dist.sh > /dev/null
    gpg --batch --quiet --verify "$archive.asc" "$archive"
    gpg --batch --quiet --verify target/dist/SHA256SUMS.asc target/dist/SHA256SUMS
    { cat "$archive"; echo; } > "$work/other"
    if gpg --batch --quiet --verify "$archive.asc" "$work/other" 2> /dev/null; then
        echo "dist-test: the signature holds for another archive" >&2
        exit 1
    fi
    rm -f target/dist/*.asc
    gpgconf --kill gpg-agent
    unset GNUPGHOME
else
    echo "dist-test: signing not tried, there is no gpg"
fi

# A network namespace of its own has no network. Who is not root needs a user namespace too.
root=$([ "$(id -u)" = 0 ] || echo --map-root-user)
# shellcheck disable=SC2086
unshare $root --net true 2>/dev/null ||
    { echo "dist-test: this system gives no network namespace (unshare --net)" >&2; exit 1; }
cat > "$work/build" <<'END'
set -eu
[ "$(ls /sys/class/net 2>/dev/null)" = lo ] || [ "$(tail -n +3 /proc/net/dev | wc -l)" = 1 ]
cd "$1"/nvsprior-*
PREFIX=$1/prefix LIBDIR="" INCLUDEDIR="" DESTDIR="" GLIBC="" CARGO_NET_OFFLINE=true scripts/install.sh release
END
# The program cargo-c is found by PATH; a new CARGO_HOME has no crates.
# shellcheck disable=SC2086
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin RUSTUP_HOME=${RUSTUP_HOME:-$HOME/.rustup} CARGO_HOME=$work/cargo-home \
    CARGO_TARGET_DIR=$work/target unshare $root --net sh "$work/build" "$work"
export PKG_CONFIG_LIBDIR="$work/prefix/lib/pkgconfig"
# shellcheck disable=SC2046
"${CC:-cc}" -Wall -Wextra -Werror tests/package/device.c -o "$work/device" $(pkg-config --cflags --libs nvsprior) \
    -Wl,-rpath,"$work/prefix/lib"
"$work/device"
echo "dist: built without a network"
