#!/bin/sh
# Fetches SwiftShader, a Vulkan driver for the CPU that shares no code with Mesa, from Debian's package of Chromium
# into a folder, and prints its ICD file:
#   VK_DRIVER_FILES=$(scripts/swiftshader.sh DIR) nvsprior devices --check
set -eu

[ $# = 1 ] || { echo "usage: swiftshader.sh DIR" >&2; exit 2; }
mkdir -p "$1"
cd "$1"
dir=$PWD
library=$dir/root/usr/lib/chromium/libvk_swiftshader.so
if [ ! -e "$library" ]; then
    # The mirror keeps a version of Chromium only until the next one: the list must be new.
    sudo=""
    [ "$(id -u)" = 0 ] || sudo=sudo
    $sudo apt-get update -qq >&2
    apt-get download -o APT::Sandbox::User=root chromium-common >&2
    dpkg -x chromium-common_*.deb root
fi
sed "s#\"library_path\": *\"[^\"]*\"#\"library_path\": \"$library\"#" \
    root/usr/lib/chromium/vk_swiftshader_icd.json >icd.json
echo "$dir/icd.json"
