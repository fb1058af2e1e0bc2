#!/bin/sh
# Installs what is missing on Debian or Ubuntu, after saying so; explains what to do elsewhere.
# Usage: setup.sh [run] [test] [shaders]
set -eu

missing=""
need() { missing="$missing $1"; }
any() { for file in "$@"; do [ ! -e "$file" ] || return 0; done; return 1; }

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
    esac
done

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
