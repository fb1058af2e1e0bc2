#!/bin/sh
# Installs what is missing on Debian or Ubuntu, after saying so; explains what to do elsewhere.
# Usage: setup.sh [run] [test] [shaders] [lib] [c] [cross] [glibc] [deb] [meson] [gst]
set -eu

missing=""
crates=""
need() { missing="$missing $1"; }
any() { for file in "$@"; do [ ! -e "$file" ] || return 0; done; return 1; }

# Whether a crate's program is there in the version that the build needs.
crate() { [ "$($2 --version 2>/dev/null)" = "${1%@*} ${1#*@}" ] || crates="$crates $1"; }

command -v cc >/dev/null || need gcc
for part in "$@"; do
    case $part in
    run)
        ldconfig -p 2>/dev/null | grep -q 'libvulkan\.so\.1' || need libvulkan1
        any /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json || need mesa-vulkan-drivers
        ;;
    test)
        layer=vulkan/explicit_layer.d/VkLayer_khronos_validation.json
        any "/usr/share/$layer" "/etc/$layer" || need vulkan-validationlayers
        command -v spirv-val >/dev/null || need spirv-tools
        ;;
    shaders)
        command -v spirv-val >/dev/null || need spirv-tools
        command -v g++ >/dev/null || need g++
        ;;
    lib) # The C library.
        crate cargo-c@0.10.24+cargo-0.98.0 "cargo cbuild"
        ;;
    c) # Its tests.
        for program in clang cmake g++ make pkg-config valgrind; do
            command -v $program >/dev/null || need $program
        done
        any /usr/lib/llvm-*/lib/clang/*/lib/linux/libclang_rt.asan-*.a || need libclang-rt-dev
        any /usr/include/vulkan/vulkan.h || need libvulkan-dev
        command -v abidiff >/dev/null || need abigail-tools
        crate cbindgen@0.29.4 cbindgen
        ;;
    cross) # Building it for 64-bit ARM, and running it.
        command -v aarch64-linux-gnu-gcc >/dev/null || need gcc-aarch64-linux-gnu
        command -v aarch64-linux-gnu-g++ >/dev/null || need g++-aarch64-linux-gnu
        any /usr/aarch64-linux-gnu/include/stdio.h || need libc6-dev-arm64-cross
        command -v qemu-aarch64 >/dev/null || need qemu-user
        ;;
    glibc) # Building it for an old glibc: scripts/zig-linker.sh.
        python3 -c 'import ensurepip' 2>/dev/null || need python3-venv
        ;;
    deb) # Debian packages, and a system to try them in.
        any /usr/share/perl5/Debian/Debhelper || need debhelper
        command -v help2man >/dev/null || need help2man
        command -v lintian >/dev/null || need lintian
        command -v mmdebstrap >/dev/null || need mmdebstrap
        command -v dpkg-buildpackage >/dev/null || need dpkg-dev
        ;;
    meson)
        command -v meson >/dev/null || need meson
        ;;
    gst) # The GStreamer plugin, and what the pipelines of docs/gstreamer.md take.
        command -v pkg-config >/dev/null || need pkg-config
        pkg-config --exists gstreamer-1.0 2>/dev/null || need libgstreamer1.0-dev
        pkg-config --exists gstreamer-video-1.0 2>/dev/null || need libgstreamer-plugins-base1.0-dev
        command -v gst-launch-1.0 >/dev/null || need gstreamer1.0-tools
        gst-inspect-1.0 --exists videoconvert 2>/dev/null || need gstreamer1.0-plugins-base
        gst-inspect-1.0 --exists multifilesrc 2>/dev/null || need gstreamer1.0-plugins-good
        gst-inspect-1.0 --exists x264enc 2>/dev/null || need gstreamer1.0-plugins-ugly
        command -v python3 >/dev/null || need python3-minimal
        ;;
    esac
done

case $crates in
*cargo-c@*) # Speaks to registries by OpenSSL; what else it needs it brings along.
    any /usr/include/openssl/ssl.h || need libssl-dev
    command -v pkg-config >/dev/null || need pkg-config
    ;;
esac

if [ -n "$missing" ]; then
    if command -v apt-get >/dev/null; then
        sudo=""
        [ "$(id -u)" = 0 ] || sudo=sudo
        echo "installing with apt-get:$missing"
        $sudo apt-get update -qq
        # shellcheck disable=SC2086
        DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends \
            $missing libc6-dev >/dev/null
    else
        echo "missing, and this is no Debian or Ubuntu:$missing (Debian's names)." >&2
        echo "Install a C compiler, the Vulkan loader with a driver (your GPU's, or Mesa's lavapipe," >&2
        echo "which needs no GPU), and for tests the Khronos validation layer and SPIRV-Tools." >&2
        exit 1
    fi
fi

if ! command -v cargo >/dev/null; then
    echo "Rust is missing: install it with rustup (https://rustup.rs), then run this again." >&2
    exit 1
fi

for crate in $crates; do
    echo "installing $crate with cargo (on two cores cbindgen takes a minute, cargo-c some ten)"
    # Not optimised: they run only for moments, and would take twice as long to build.
    CARGO_PROFILE_DEV_DEBUG=false cargo install --quiet --locked --debug "$crate"
done

case " $* " in
*" cross "*) rustup --quiet target add aarch64-unknown-linux-gnu ;;
esac
