#!/bin/sh
# Builds a program that has nvsprior as a subproject, by CMake and by Meson, and runs it. Usage: subproject-test.sh
set -eu
cd "$(dirname "$0")/.."
source=$PWD
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
check() { # A program.
    said=$("$1") || { echo "subproject-test: $1: $said" >&2; exit 1; }
    echo "${1#"$work"/}: $(echo "$said" | head -n 1)"
}

cmake -S tests/package/subproject -B "$work/cmake" -DNVSPRIOR="$source"
cmake --build "$work/cmake"
check "$work/cmake/device-nvsprior"
check "$work/cmake/device-static"

# Meson wants the subproject within the project. It links what it builds there.
mkdir -p "$work/project/subprojects"
cp tests/package/subproject/meson.build tests/package/device.c "$work/project/"
ln -s "$source" "$work/project/subprojects/nvsprior"
meson setup "$work/meson" "$work/project"
meson compile -C "$work/meson"
check "$work/meson/device-nvsprior"
check "$work/meson/device-nvsprior-static"
echo "subproject-test: CMake and Meson"
