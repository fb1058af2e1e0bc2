#!/bin/sh
# Installs the packages of `make deb` in a clean Debian, encodes and decodes a frame with the program and with C
# programs built there, and removes them. Packages of both architectures are tried side by side if both are there.
# Usage: deb-test.sh [SUITE]; this system's suite if none is named. Its mirror must have the suite.
#
# If no such system can be made here, it says so, and tries the packages unpacked, which shows less.
set -eu
cd "$(dirname "$0")/.."
native=$(dpkg --print-architecture)
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
packages=$PWD/target/debian
ls "$packages"/nvsprior_*_"$native".deb > /dev/null || { echo "deb-test: run make deb first" >&2; exit 1; }
other=""
for architecture in amd64 arm64; do
    if [ $architecture != "$native" ] && ls "$packages"/nvsprior_*_$architecture.deb > /dev/null 2>&1; then
        other=$architecture
    fi
done
mirror=$(apt-get indextargets --format '$(LABEL) $(REPO_URI) $(CODENAME)' | sed -n 's/^Debian //p' | head -n 1)
suite=${1:-${mirror#* }}
mirror=${mirror% *}
[ -n "$mirror" ] || { echo "deb-test: apt knows no mirror of Debian here: apt-get update" >&2; exit 1; }

# The scene of the C tests: a prior, and a frame as PPM and as PNG.
scene=$target/tmp/c-scene
[ -e "$scene/scene.txt" ] || CARGO_TARGET_DIR=$target cargo test --quiet -p nvsprior --test capi scene_is_written
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/t" "$work/t/scene"
cp "$packages"/*.deb tests/package/in-chroot.sh "$work/t/"
cp "$scene/prior.ply" "$scene/scene.txt" "$scene/frame-0.ppm" "$work/t/scene/"
python3 - "$scene/frame-0.ppm" "$work/t/scene/frame-0.png" <<'END'
import struct, sys, zlib
_, width, height, _, pixels = open(sys.argv[1], "rb").read().split(maxsplit=4)
size = int(width) * int(height) * 3
rows = zip(*[iter(pixels[-size:])] * (3 * int(width)))
def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
with open(sys.argv[2], "wb") as png:
    png.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", int(width), int(height), 8, 2, 0, 0, 0))
              + chunk(b"IDAT", zlib.compress(b"".join(b"\0" + bytes(row) for row in rows))) + chunk(b"IEND", b""))
END
chmod -R a+rX "$work"

# apt's settings for this network hold there too. The marker tells a system that cannot be made from a test that fails.
apt-config dump | grep '^Acquire::\(http\|https\|Check\|Retries\|ForceIPv\)' > "$work/apt" || true
if mmdebstrap --quiet --variant=apt --format=null --aptopt="$work/apt" \
    --customize-hook="touch $work/made" --customize-hook="copy-in $work/t /" \
    --customize-hook="chroot \"\$1\" sh /t/in-chroot.sh /t $native $other" \
    "$suite" /dev/null "$mirror" 2>&1; then
    echo "deb-test: $suite: all done"
elif [ -e "$work/made" ]; then
    echo "deb-test: failed in $suite" >&2
    exit 1
else
    echo "deb-test: NOT TRIED IN A CLEAN SYSTEM: mmdebstrap cannot make one here, for the reason above." >&2
    echo "deb-test: the packages are only unpacked and run: dependencies, installation and removal stay untested." >&2
    for package in "$packages"/*_"$native".deb; do dpkg -x "$package" "$work/root"; done
    "$work/root/usr/bin/nvsprior" --version
    LD_LIBRARY_PATH=$(dirname "$(find "$work/root" -name libnvsprior.so.1)")
    export LD_LIBRARY_PATH
    cc tests/package/device.c -I "$work/root/usr/include" -L "$LD_LIBRARY_PATH" -lnvsprior -o "$work/device"
    "$work/device"
fi
