#!/bin/sh
# Draws the same scenes on every available device, and decodes packets of one on the others: no byte may differ.
# Devices: Mesa's CPU driver as installed and from Debian's backports, each with vectors of 128, 256 and 512 bits, and
# SwiftShader. The drivers are fetched into a folder, not installed.
# Usage: portability.sh [swiftshader]; swiftshader: that driver beside the installed one, with fewer scenes
set -eu
cd "$(dirname "$0")/.."
drivers=target/drivers
scenes=200

# If a driver cannot be fetched, it is named and left out.
mesa="" mesa_libraries="" swiftshader=""
if [ "${1:-}" = swiftshader ]; then
    scenes=50
elif environment=$(scripts/second-driver.sh "$drivers/mesa"); then
    eval "$environment"
    mesa=${VK_DRIVER_FILES#*:}
    mesa_libraries=$LD_LIBRARY_PATH
    unset VK_DRIVER_FILES LD_LIBRARY_PATH
else
    echo "skipped: Mesa of Debian's backports, which could not be fetched"
fi
swiftshader=$(scripts/swiftshader.sh "$drivers/swiftshader") ||
    { swiftshader=""; echo "skipped: SwiftShader, which could not be fetched"; }

# The profile of `make test`, so that nothing is built twice.
all="--workspace --exclude nvsprior-gst --exclude nvsprior-python"
# shellcheck disable=SC2086 # Words. The test needs the program; `cargo build` alone would build most crates anew.
cargo test $all --test cli --no-run
program=${CARGO_TARGET_DIR:-target}/debug/nvsprior
verify() { "$program" devices --check "$scenes"; }
for bits in $([ $scenes = 50 ] && echo 256 || echo 128 256 512); do
    LP_NATIVE_VECTOR_WIDTH=$bits verify
    [ -z "$mesa" ] ||
        LP_NATIVE_VECTOR_WIDTH=$bits LD_LIBRARY_PATH=$mesa_libraries VK_DRIVER_FILES=$mesa verify
done
# shellcheck disable=SC2086
packets() { cargo test $all --test cli -- other_devices portable_device; }
if [ -n "$swiftshader" ]; then
    VK_DRIVER_FILES=$swiftshader verify
    NVSPRIOR_OTHER_DRIVERS=$swiftshader packets
fi
if [ -n "$mesa" ]; then
    LD_LIBRARY_PATH=$mesa_libraries NVSPRIOR_OTHER_DRIVERS=$mesa packets
fi
