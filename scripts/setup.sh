#!/bin/sh
# Installs what is missing on Debian or Ubuntu, after saying so; explains what to do elsewhere.
# Usage: setup.sh [PART...]; the parts are the cases below. A C compiler and Rust are always looked for.
#
# Every test looks for what the targets use: the program that is called, or the header or library that is read. A folder
# or another file of a package proves nothing, since other packages may make it, too.
set -eu
# Debian's users do not have ldconfig in their PATH.
PATH=$PATH:/usr/sbin:/sbin

# Package, what is used of it, and how to see whether that is there.
need() {
    package=$1 used=$2
    shift 2
    "$@" > /dev/null 2>&1 || missing="$missing$package|$used
"
}
program() { need "${2:-$1}" "$1" command -v "$1"; }
header() { need "$1" "$2" sh -c "echo '#include <$2>' | ${3:-cc} -E -x c -"; }
any() { for file in "$@"; do [ ! -e "$file" ] || return 0; done; return 1; }
vulkan_loader() { ldconfig -p | grep -q 'libvulkan\.so\.1'; }
vulkan_driver() {
    [ -n "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" ] || any /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json
}
radv() {
    manifest=vulkan/icd.d/radeon_icd
    [ -n "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" ] || any /usr/share/$manifest*.json /etc/$manifest*.json
}
validation_layer() {
    layer=vulkan/explicit_layer.d/VkLayer_khronos_validation.json
    [ -n "${VK_LAYER_PATH:-}" ] || any "/usr/share/$layer" "/etc/$layer"
}
sanitizers() { echo 'int main(void) { return 0; }' | clang -fsanitize=address -x c - -o /dev/null; }
# GStreamer, and the plugins that read and write videos.
video() {
    program gst-launch-1.0 gstreamer1.0-tools
    need gstreamer1.0-plugins-base videoconvert gst-inspect-1.0 --exists videoconvert
    need gstreamer1.0-plugins-good multifilesrc gst-inspect-1.0 --exists multifilesrc
    need gstreamer1.0-plugins-ugly x264enc gst-inspect-1.0 --exists x264enc
    need gstreamer1.0-libav avdec_h264 gst-inspect-1.0 --exists avdec_h264
}
# A Python environment of one's own takes what Debian packs beside Python.
python_venv() { need python3-venv "python3 -m venv" python3 -c 'import ensurepip, venv'; }
python() { need python3 "python3 with its library" python3 -c 'import json, struct, subprocess, zlib'; }

# Whether a crate's program is there in the version that the build needs.
crate() { [ "$($2 --version 2>/dev/null)" = "${1%@*} ${1#*@}" ] || crates="$crates $1"; }

look() {
    missing="" crates=""
    program cc gcc
    header libc6-dev stdio.h
    for part in "$@"; do
        case $part in
        run)
            need libvulkan1 libvulkan.so.1 vulkan_loader
            need mesa-vulkan-drivers "a Vulkan driver" vulkan_driver
            ;;
        test)
            need vulkan-validationlayers "the Vulkan validation layer" validation_layer
            program spirv-val spirv-tools
            video
            program ffmpeg
            ;;
        video) # A program that reads and writes videos.
            video
            ;;
        poses | conformance | python) # pycolmap, numpy or maturin is installed into an environment of Python.
            python_venv
            ;;
        browser) # For the console's page.
            program chromium
            ;;
        gpu-check) # A driver that compiles for a GPU that is not there.
            need libvulkan1 libvulkan.so.1 vulkan_loader
            need mesa-vulkan-drivers "Mesa's RADV" radv
            ;;
        lint | licences)
            python
            ;;
        shaders)
            program spirv-val spirv-tools
            program g++
            ;;
        lib) # The C library.
            crate cargo-c@0.10.24+cargo-0.98.0 "cargo cbuild"
            ;;
        c) # Its tests.
            for name in gcc clang cmake g++ make pkg-config valgrind; do program $name; done
            need libclang-rt-dev "clang's AddressSanitizer" sanitizers
            header libvulkan-dev vulkan/vulkan.h
            program abidiff abigail-tools
            crate cbindgen@0.29.4 cbindgen
            python
            ;;
        cross) # Building it for 64-bit ARM, and running it.
            program aarch64-linux-gnu-gcc gcc-aarch64-linux-gnu
            program aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
            header libc6-dev-arm64-cross stdio.h aarch64-linux-gnu-gcc
            program qemu-aarch64 qemu-user
            program mmdebstrap
            ;;
        glibc | paper) # Building for an old glibc: scripts/zig-linker.sh. The paper's learned baselines.
            python_venv
            ;;
        semver) # The API beside that of the last release.
            crate cargo-semver-checks@0.51.0 "cargo semver-checks"
            ;;
        deb) # Debian packages, and a system to try them in.
            program dh debhelper
            program help2man
            program lintian
            program mmdebstrap
            program dpkg-buildpackage dpkg-dev
            python
            ;;
        dist) # The source archive.
            program git
            program xz xz-utils
            ;;
        meson)
            program meson
            ;;
        gst) # The GStreamer plugin, and what the pipelines of docs/gstreamer.md take.
            program pkg-config
            need libgstreamer1.0-dev gstreamer-1.0.pc pkg-config --exists gstreamer-1.0
            need libgstreamer-plugins-base1.0-dev gstreamer-video-1.0.pc pkg-config --exists gstreamer-video-1.0
            video
            python
            ;;
        *)
            echo "setup: no part is called $part" >&2
            exit 2
            ;;
        esac
    done
    case $crates in
    *cargo-c@*) # Speaks to registries by OpenSSL; what else it needs it brings along.
        program pkg-config
        need libssl-dev openssl.pc pkg-config --exists openssl
        ;;
    esac
}

# What is missing, on one line: packages, or what is used of them.
packages() { printf %s "$missing" | cut -d '|' -f 1 | sort -u | paste -sd ' '; }
uses() { printf %s "$missing" | sed 's/\(.*\)|\(.*\)/\2 (\1)/' | paste -sd ',' | sed 's/,/, /g'; }

look "$@"
if [ -n "$missing" ]; then
    if ! command -v apt-get > /dev/null; then
        echo "missing, and this is no Debian or Ubuntu: $(uses); Debian's packages are in brackets." >&2
        echo "Install a C compiler, the Vulkan loader with a driver (your GPU's, or Mesa's lavapipe," >&2
        echo "which needs no GPU), and for tests the Khronos validation layer and SPIRV-Tools." >&2
        exit 1
    fi
    sudo=""
    [ "$(id -u)" = 0 ] || sudo=sudo
    echo "installing with apt-get: $(packages)"
    $sudo apt-get update -qq
    # shellcheck disable=SC2046 # Packages are words.
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends $(packages) > /dev/null
    look "$@"
    [ -z "$missing" ] || { echo "setup: still missing after the installation: $(uses)" >&2; exit 1; }
fi

if ! command -v cargo > /dev/null; then
    echo "Rust is missing: install it with rustup (https://rustup.rs), then run this again." >&2
    exit 1
fi

for crate in $crates; do
    echo "installing $crate with cargo (on two cores cbindgen takes a minute, cargo-c some ten)"
    # Not optimised: they run only for moments, and would take twice as long to build.
    CARGO_PROFILE_DEV_DEBUG=false cargo install --quiet --locked --debug "$crate"
done

case " $* " in
*" lint "*)
    { cargo fmt --version && cargo clippy --version; } > /dev/null || rustup --quiet component add rustfmt clippy
    ;;
esac
case " $* " in
*" cross "*) rustup --quiet target add aarch64-unknown-linux-gnu ;;
esac
