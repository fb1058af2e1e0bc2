#!/bin/sh
# Installs, uses and removes the packages in a clean system: scripts/deb-test.sh runs this there as root.
# Usage: in-chroot.sh DIR ARCHITECTURE [OTHER]; DIR has the packages, the scene, and a C example.
set -eu
dir=$1 native=$2 other=${3:-}
export DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8
fail() { echo "in-chroot: $1" >&2; exit 1; }
step() { echo "== $1"; }
install() {
    apt-get -qq -y --no-install-recommends install "$@" > "$dir/log" 2>&1 ||
        { tail -n 30 "$dir/log" >&2; fail "apt-get install $*"; }
}
# glibc's own words for its version.
echo "glibc $(getconf GNU_LIBC_VERSION | sed 's/.* //'), $native"

step "the program and the library, with what they depend on and no driver"
apt-get -qq update
install "$dir"/libnvsprior1_*_"$native".deb "$dir"/nvsprior_*_"$native".deb
nvsprior --version
ldconfig -p | grep -q 'libnvsprior\.so\.1 ' || fail "the loader does not know libnvsprior.so.1"
dpkg -L nvsprior | grep -q 'man1/nvsprior-encode\.1\.gz' || fail "no manual page of encode"
mkdir "$dir/w"
cd "$dir/w"
{ IFS=, read -r width height fx fy cx cy; IFS=, read -r qw qx qy qz tx ty tz; } < "$dir/scene/scene.txt"
cat > cameras.json <<END
{"width": $width, "height": $height, "fx": $fx, "fy": $fy, "cx": $cx, "cy": $cy, "images": [
 {"file": "frame.png", "index": 0, "split": "dive", "qvec": [$qw, $qx, $qy, $qz], "tvec": [$tx, $ty, $tz]}]}
END
cp "$dir/scene/frame-0.png" frame.png
encode() {
    nvsprior encode --prior "$dir/scene/prior.ply" --cameras cameras.json --starts first --packets packets \
        --pictures seen
}
if encode > log 2>&1; then fail "encodes without a driver"; else code=$?; fi
[ "$code" = 1 ] && grep -qi 'driver' log || { cat log >&2; fail "does not say that a driver is missing (exit $code)"; }
echo "without a driver: $(head -n 1 log)"

step "a frame, encoded and decoded by Mesa's CPU driver"
install mesa-vulkan-drivers
device=yes
nvsprior devices || true
if ! encode > log 2>&1; then
    # Mesa before 22 has no device that fits; the program must say so, and the rest is tested all the same.
    mesa=$(dpkg-query -W -f '${Version}' mesa-vulkan-drivers)
    dpkg --compare-versions "$mesa" lt 22 && grep -qi 'device' log || { cat log >&2; fail "cannot encode"; }
    echo "Mesa $mesa has no device that fits: $(head -n 1 log)"
    device=no
fi
if [ $device = yes ]; then
    cat log
    nvsprior decode --prior "$dir/scene/prior.ply" --packets packets --pictures topside
    cmp seen/*.png topside/*.png || fail "topside and vehicle have other pictures"
fi

step "a program in C, shared and static, by pkg-config and CMake"
install "$dir"/libnvsprior-dev_*_"$native".deb gcc libc6-dev make pkg-config cmake g++
cp -r /usr/share/doc/libnvsprior-dev/examples .
for link in shared static; do
    libs=$(pkg-config --libs nvsprior)
    [ $link = shared ] || libs=$(pkg-config --static --libs nvsprior | sed 's/-lnvsprior/-l:libnvsprior.a/')
    for name in encode_frame decode_frame; do
        # shellcheck disable=SC2046,SC2086
        cc -std=c99 -Wall -Wextra -Werror examples/$name.c -o $name-$link $(pkg-config --cflags nvsprior) $libs
    done
    cmake -S examples -B cmake-$link -DNVSPRIOR_STATIC=$([ $link = static ] && echo ON || echo OFF) > "$dir/log" &&
        cmake --build cmake-$link >> "$dir/log" || { cat "$dir/log" >&2; fail "CMake, $link"; }
    [ $device = yes ] || continue
    for program in ./encode_frame-$link cmake-$link/encode_frame; do
        "$program" "$dir/scene/prior.ply" "$dir/scene/frame-0.ppm" "$width,$height,$fx,$fy,$cx,$cy" \
            "$qw,$qx,$qy,$qz,$tx,$ty,$tz" from-c.nvsp
    done
    ./decode_frame-$link "$dir/scene/prior.ply" from-c.nvsp from-c.ppm
    [ "$(wc -c < from-c.ppm)" = "$(wc -c < "$dir/scene/frame-0.ppm")" ] || fail "the decoded picture is of another size"
done
if [ $device = yes ]; then
    mkdir c-packets
    mv from-c.nvsp c-packets/
    nvsprior decode --prior "$dir/scene/prior.ply" --packets c-packets --pictures c-topside
fi

if [ -n "$other" ]; then
    step "the packages for $other beside these; the program under QEMU"
    dpkg --add-architecture "$other"
    apt-get -qq update
    install "$dir"/libnvsprior1_*_"$other".deb "$dir"/libnvsprior-dev_*_"$other".deb qemu-user libc6:"$other"
    dpkg -x "$dir"/nvsprior_*_"$other".deb "$dir/other"
    "qemu-$(dpkg-query -W -f '${Architecture}' libnvsprior1:"$other" | sed 's/arm64/aarch64/')" -L / \
        "$dir/other/usr/bin/nvsprior" --version
    apt-get -qq -y purge libnvsprior1:"$other" libnvsprior-dev:"$other" > "$dir/log" 2>&1
fi

step "removal"
cd /
apt-get -qq -y purge nvsprior libnvsprior-dev libnvsprior1 > "$dir/log" 2>&1 || { cat "$dir/log" >&2; fail "purge"; }
left=$(find / -xdev -name '*nvsprior*' ! -path "$dir/*" ! -path '/proc/*' ! -path '/sys/*')
[ -z "$left" ] || fail "removing leaves $left"
! ldconfig -p | grep -q nvsprior || fail "the loader still knows the library"
echo "deb-test: installed, used and removed"
