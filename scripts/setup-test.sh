#!/bin/sh
# Runs targets of `make help` as a new user would: each in a bare Debian of its own, which has make, git and Rust, on a
# clone of the last commit. So it shows whether scripts/setup.sh installs all that a target needs.
# Usage: setup-test.sh [setup] [TARGET...]; demo, test, lib and deb if none is named.
#
# `setup` before the targets only runs the set-up of each, and asks for the programs that the target calls.
#
# LIMIT: seconds for each target (3600); a target that takes longer fails with status 124. SUITE: another Debian than
# this one. WARM: a target folder to begin with. PROGRAMS: a folder with cargo-c and cbindgen, which take ten minutes to
# build. KEEP: a folder that keeps the bare Debian for the next run. It takes root, and a system that lets root mount.
set -eu
cd "$(dirname "$0")/.."
[ "$(id -u)" = 0 ] || exec sudo --preserve-env=LIMIT,SUITE,WARM,PROGRAMS,KEEP "$0" "$@"
# What is mounted here goes with this script, and nobody else sees it.
[ -n "${NVSPRIOR_SETUP_TEST:-}" ] || NVSPRIOR_SETUP_TEST=1 exec unshare --mount "$0" "$@"
mode=whole
if [ "${1:-}" = setup ]; then
    mode=setup
    shift
fi
[ $# -gt 0 ] || set -- demo test lib deb
limit=${LIMIT:-3600}
cargo_home=${CARGO_HOME:-$HOME/.cargo}
toolchain=$(rustc --print sysroot)
source=$PWD
PATH=$PATH:/usr/sbin:/sbin
command -v mmdebstrap > /dev/null || apt-get install -y -qq --no-install-recommends mmdebstrap > /dev/null
[ -z "$(git status --porcelain)" ] || echo "setup-test: what is not committed is not tried" >&2

work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
bare=${KEEP:-$work}/bare
mirror=$(apt-get indextargets --format '$(LABEL) $(REPO_URI) $(CODENAME)' | sed -n 's/^Debian //p' | head -n 1)
suite=${SUITE:-${mirror#* }}
mirror=${mirror% *}
[ -n "$mirror" ] || { echo "setup-test: apt knows no mirror of Debian here: apt-get update" >&2; exit 1; }

# The bare system: what a clone and rustup need. apt's settings and certificates for this network hold there, too.
if [ ! -e "$bare/made" ]; then
    rm -rf "$bare"
    mkdir -p "$bare"
    apt-config dump | grep '^Acquire::\(http\|https\|Check\|Retries\|ForceIPv\)' > "$work/apt" || true
    mmdebstrap --quiet --variant=apt --format=directory --include=make,git,ca-certificates --aptopt="$work/apt" \
        "$suite" "$bare" "$mirror"
    cp /etc/resolv.conf "$bare/etc/resolv.conf"
    cp /etc/ssl/certs/ca-certificates.crt "$bare/etc/ssl/certs/ca-certificates.crt"
    touch "$bare/made"
fi

# Shows a folder at a place, where changes stay apart from it: as an overlay, or as a copy if that cannot be mounted.
layer() { # The folder, the place, where changes go.
    mkdir -p "$2" "$3/upper" "$3/work"
    mount -t overlay overlay -o "lowerdir=$1,upperdir=$3/upper,workdir=$3/work" "$2" 2> /dev/null || cp -a "$1/." "$2/"
}

# The bare system with Rust as rustup installs it, the crates that cargo has fetched here, and a clone.
system() { # The root, where changes go.
    layer "$bare" "$1" "$2/system"
    home=$1/root
    mkdir -p "$home/.cargo/bin"
    cp "$(command -v rustup)" "$home/.cargo/bin/rustup"
    for name in cargo rustc rustdoc rustfmt cargo-fmt cargo-clippy clippy-driver; do
        ln -s rustup "$home/.cargo/bin/$name"
    done
    layer "$toolchain" "$home/.rustup/toolchains/$(basename "$toolchain")" "$2/toolchain"
    printf 'version = "12"\ndefault_toolchain = "%s"\nprofile = "default"\n' "$(basename "$toolchain")" \
        > "$home/.rustup/settings.toml"
    layer "$cargo_home/registry" "$home/.cargo/registry" "$2/registry"
    [ ! -e "$cargo_home/config.toml" ] || cp "$cargo_home/config.toml" "$home/.cargo/"
    [ -z "${PROGRAMS:-}" ] || for name in cargo-capi cargo-cbuild cargo-cinstall cargo-ctest cbindgen; do
        cp "$PROGRAMS/$name" "$home/.cargo/bin/"
    done
    git -c advice.detachedHead=false -c init.defaultBranch=main clone --quiet "$source" "$1$source"
    [ -z "${WARM:-}" ] || layer "$(realpath "$WARM")" "$1$source/target" "$2/target"
    mount --rbind /dev "$1/dev"
    mount --rbind /sys "$1/sys"
}

# Runs a command in the clone of a root. The limit ends all that it has started: its processes have a namespace.
within() { # The root, the command.
    root=$1
    shift
    for name in http_proxy https_proxy no_proxy; do
        eval "value=\${$name:-}"
        [ -z "$value" ] || set -- "$name=$value" "$@"
    done
    timeout "$limit" unshare --pid --fork --kill-child --mount-proc="$root/proc" chroot "$root" env -i -C "$source" \
        HOME=/root LANG=C.UTF-8 PATH=/root/.cargo/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"
}

# The programs that a target calls, those of a bare system left out.
programs() {
    rust="cargo rustc cc"
    c="gcc clang g++ clang++ cmake pkg-config valgrind nm abidw abidiff cbindgen"
    case $1 in
    demo | demo-prior | tower-prior | package) echo "$rust" ;;
    quick | test) echo "$rust spirv-val" ;;
    gst) echo "$rust pkg-config" ;;
    gst-test) echo "$rust pkg-config gst-inspect-1.0 gst-launch-1.0 python3" ;;
    lint | licences) echo "$rust python3" ;;
    lib) echo "$rust cargo-cbuild" ;;
    install) echo "$rust cargo-cinstall nm ld objcopy as ar readelf" ;;
    c-test | c-test-memory) echo "$rust cargo-cinstall $c ld objcopy as ar readelf" ;;
    firmware | package-test) echo "$rust cargo-cinstall $c ld objcopy as ar readelf strip python3" ;;
    cross-aarch64)
        for name in gcc nm ld objcopy as ar readelf strip; do echo "aarch64-linux-gnu-$name"; done
        echo "$rust cargo-cinstall qemu-aarch64 cmake pkg-config python3"
        ;;
    portability) echo "$rust apt-get dpkg" ;;
    deb)
        echo "$rust cargo-cinstall dh dpkg-buildpackage dpkg-parsechangelog dpkg-shlibdeps dpkg-deb help2man lintian"
        echo "iconv python3 aarch64-linux-gnu-objcopy qemu-aarch64 readelf objdump"
        ;;
    deb-test) echo "$rust mmdebstrap dpkg python3" ;;
    dist) echo "cargo git tar xz" ;;
    dist-test) echo "$rust cargo-cinstall git tar xz unshare pkg-config" ;;
    subproject-test) echo "$rust cargo-cinstall cmake meson ninja" ;;
    abi-check | abi-baseline) echo "gcc nm abidw abidiff awk" ;;
    wheel | python-test | paper-test) echo "$rust python3" ;;
    wheel-aarch64) echo "$rust python3 aarch64-linux-gnu-gcc" ;;
    shader-toolchain | shaders | shaders-check) echo "cargo rustup cc g++ spirv-val spirv-opt" ;;
    *) echo "setup-test: scripts/setup-test.sh does not say which programs $1 calls" >&2; return 1 ;;
    esac
}

try() { # The root, the target.
    if [ $mode = whole ]; then
        within "$1" make "$2"
    else
        wanted=$(programs "$2") || return 1
        # shellcheck disable=SC2086 # Programs are words.
        within "$1" sh -eu -c '
            make --dry-run "$1" | grep "^scripts/setup.sh" > /tmp/setup
            cat /tmp/setup
            sh -eu /tmp/setup
            shift
            for name in "$@"; do command -v "$name" || { echo "not there: $name" >&2; exit 1; }; done
        ' sh "$2" $wanted
    fi
}

passed=0 failed=0
for target in "$@"; do
    started=$(date +%s)
    system "$work/$target" "$work/$target.changes"
    result=ok
    try "$work/$target" "$target" > "$work/$target.log" 2>&1 || result="FAILED ($?)"
    echo "$target: $result, $(($(date +%s) - started)) s: $(tail -n 1 "$work/$target.log")"
    if [ $result = ok ]; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        tail -n 40 "$work/$target.log" | sed 's/^/    /'
    fi
    # shellcheck disable=SC2046 # Places are words.
    umount -l $(awk -v root="$work/$target" 'index($2, root) == 1 { print $2 }' /proc/mounts | sort -r)
    rm -rf --one-file-system "$work/$target" "$work/$target.changes"
done
echo "$passed passed, $failed failed"
[ $failed = 0 ]
