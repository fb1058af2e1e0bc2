#!/bin/sh
# Runs programs of tests/c on 64-bit ARM, under QEMU, with Mesa's CPU driver of Debian for that machine.
# Usage: c-hosts-aarch64.sh PREFIX PROGRAM...; PREFIX: where the C library for that machine is installed.
set -eu
cd "$(dirname "$0")/.."
prefix=$(realpath "$1")
shift
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
system=$target/bookworm-arm64
work=$target/c-hosts-aarch64
if [ ! -e "$system/made" ]; then
    rm -rf "$system"
    mmdebstrap --quiet --architectures=arm64 --variant=extract --include=libvulkan1,mesa-vulkan-drivers \
        bookworm "$system"
    touch "$system/made"
fi
mkdir -p "$work"
cargo test --quiet --workspace --exclude nvsprior-gst --exclude nvsprior-python --test capi scene_is_written
for name in "$@"; do
    aarch64-linux-gnu-gcc -std=c11 -Wall -Wextra -Werror -O1 -g -pthread -I include "tests/c/$name.c" tests/c/common.c \
        -o "$work/$name" -L "$prefix/lib" -lnvsprior -lm -ldl
    qemu-aarch64 -L "$system" -E LD_LIBRARY_PATH="$prefix/lib" -E NVSP_TEST_FEW=1 \
        -E VK_ICD_FILENAMES=/usr/share/vulkan/icd.d/lvp_icd.aarch64.json "$work/$name" "$target/tmp/c-scene"
done
