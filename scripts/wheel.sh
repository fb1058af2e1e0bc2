#!/bin/sh
# Builds the Python package as a wheel, target/wheels/nvsprior-VERSION-cp39-abi3-PLATFORM.whl.
# Usage: [PROFILE=release] [GLIBC=2.31] [OUT=target/wheels] wheel.sh [TARGET]
# With GLIBC it loads with that glibc and every newer one: scripts/zig-linker.sh. Else with this machine's.
# maturin, which builds it, is installed into an environment of its own.
set -eu
cd "$(dirname "$0")/.."
host=$(rustc --print host-tuple)
target=${1:-$host}
profile=${PROFILE:-release}
built=${CARGO_TARGET_DIR:-target}
case $built in /*) ;; *) built=$PWD/$built ;; esac
out=${OUT:-$built/wheels}
case $out in /*) ;; *) out=$PWD/$out ;; esac

maturin=1.16.0
home=$built/maturin-$maturin
if ! "$home/bin/maturin" --version > /dev/null 2>&1; then
    python3 -m venv --clear "$home"
    "$home/bin/pip" install --quiet --disable-pip-version-check "maturin==$maturin"
fi

name=$(echo "$target" | tr 'a-z-' 'A-Z_')
if [ "$target" != "$host" ]; then
    gnu=$(echo "$target" | sed 's/-unknown//')
    eval "export CARGO_TARGET_${name}_LINKER=\"\${CARGO_TARGET_${name}_LINKER:-${gnu}-gcc}\""
fi
# Unless it is told, maturin names the oldest glibc that the wheel loads with.
platform=""
if [ -n "${GLIBC:-}" ]; then
    zig=$(scripts/zig-linker.sh "$target" "$GLIBC")
    export "CARGO_TARGET_${name}_LINKER=$zig" "CC_$(echo "$target" | tr - _)=$zig"
    # Cargo does not build anew because the linker is another.
    built=$built/glibc-$GLIBC
    platform="--compatibility manylinux_$(echo "$GLIBC" | tr . _)"
fi
# For this machine without a target, so that what was built for other packages is not built again.
[ "$target" = "$host" ] && [ -z "${GLIBC:-}" ] || platform="$platform --target $target"

mkdir -p "$out"
rm -f "$out"/nvsprior-*_"${target%%-*}".whl
# shellcheck disable=SC2086 # Options are words.
CARGO_TARGET_DIR=$built "$home/bin/maturin" build --quiet --locked --manifest-path python/Cargo.toml \
    --profile "$profile" --out "$out" $platform
for wheel in "$out"/nvsprior-*_"${target%%-*}".whl; do
    echo "$wheel: $(wc -c < "$wheel") bytes"
done
