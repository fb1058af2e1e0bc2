#!/bin/sh
# Fetches Mesa from Debian 12's backports into a folder, beside the installed one. Prints the
# environment in which both are there as two devices: eval "$(scripts/second-driver.sh DIR)" &&
# nvsprior-lab stability --group devices
set -eu

[ $# = 1 ] || { echo "usage: second-driver.sh DIR" >&2; exit 2; }
mkdir -p "$1/lists/partial" "$1/archives/partial" "$1/root"
dir=$(cd "$1" && pwd)
. /etc/os-release
[ "$VERSION_CODENAME" = bookworm ] || { echo "this is no Debian 12: take any other driver" >&2; exit 1; }
mirror=$(grep -rhs '^URIs:.*/debian$' /etc/apt/sources.list.d | head -n 1 | cut -d' ' -f2)
key=/usr/share/keyrings/debian-archive-keyring.gpg
echo "deb [signed-by=$key] ${mirror:-http://deb.debian.org/debian} bookworm-backports main" \
    >"$dir/sources.list"
apt() {
    apt-get -qq -o "Dir::Etc::sourcelist=$dir/sources.list" -o Dir::Etc::sourceparts=/dev/null \
        -o "Dir::State::Lists=$dir/lists" -o "Dir::Cache::archives=$dir/archives" \
        -o APT::Sandbox::User=root "$@"
}
apt update >&2
(cd "$dir" && for package in mesa-vulkan-drivers libdrm2 libdrm-amdgpu1; do
    apt download "$package/bookworm-backports" >&2
done)
for package in "$dir"/*.deb; do dpkg -x "$package" "$dir/root"; done

libraries="$dir/root/usr/lib/$(uname -m)-linux-gnu"
sed "s#\"libvulkan_lvp.so\"#\"$libraries/libvulkan_lvp.so\"#" \
    "$dir/root/usr/share/vulkan/icd.d/lvp_icd.json" >"$dir/second.json"
echo "export LD_LIBRARY_PATH=$libraries"
echo "export VK_DRIVER_FILES=$(ls /usr/share/vulkan/icd.d/lvp_icd.*.json | head -n 1):$dir/second.json"
