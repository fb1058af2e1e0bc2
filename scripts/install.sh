#!/bin/sh
# Builds and installs the C library: shared and static, header, files for pkg-config and CMake.
# Usage: [PREFIX=/usr/local] [LIBDIR=PREFIX/lib] [INCLUDEDIR=PREFIX/include] [DESTDIR=] [GLIBC=]
#        install.sh [PROFILE [TARGET]]
# GLIBC=2.31 builds a library that loads with that glibc and every newer one: scripts/zig-linker.sh.
set -eu
cd "$(dirname "$0")/.."

profile=${1:-release}
host=$(rustc --print host-tuple)
target=${2:-$host}
prefix=${PREFIX:-/usr/local}
libdir=${LIBDIR:-$prefix/lib}
includedir=${INCLUDEDIR:-$prefix/include}
destdir=${DESTDIR:-}

case $target in
*-musl*) echo "install: cargo-c's libraries for musl export nothing: docs/packaging.md" >&2; exit 1 ;;
esac

# For a foreign target, Debian's cross compiler of that name, unless the environment names another.
binutils=""
name=$(echo "$target" | tr 'a-z-' 'A-Z_')
if [ "$target" != "$host" ]; then
    binutils=$(echo "$target" | sed 's/-unknown//')-
    eval "export CARGO_TARGET_${name}_LINKER=\"\${CARGO_TARGET_${name}_LINKER:-${binutils}gcc}\""
fi
if [ -n "${GLIBC:-}" ]; then
    zig=$(scripts/zig-linker.sh "$target" "$GLIBC")
    export "CARGO_TARGET_${name}_LINKER=$zig" "CC_$(echo "$target" | tr - _)=$zig"
    # Cargo does not build anew because the linker is another.
    export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-target}/glibc-$GLIBC"
fi

# cargo-c compiles anew for other folders, although nvsprior.pc alone has them. So it gets the same ones each time, and
# what it has made is copied.
stage=${CARGO_TARGET_DIR:-target}/stage/$target-$profile
echo "install: builds the library ($profile, $target); the first time that takes some minutes" >&2
cargo cinstall -p nvsprior-capi --profile "$profile" --target "$target" \
    --prefix /usr --libdir /usr/lib --includedir /usr/include --destdir "$stage"

installed=$destdir$libdir
echo "install: to $installed and $destdir$includedir" >&2
mkdir -p "$installed/pkgconfig" "$destdir$includedir"
cp -d --preserve=mode,links "$stage"/usr/lib/libnvsprior.so* "$installed/"
install -m 644 "$stage"/usr/include/nvsprior*.h "$destdir$includedir/"
# A folder as pkg-config has it: below the prefix, if it is; blanks are escaped, and that twice, for sed.
below() { case $1 in "$prefix"/*) echo "\${prefix}${1#"$prefix"}" ;; *) echo "$1" ;; esac | sed 's/ /\\\\ /g'; }
# The compiler adds -lgcc_s by itself, or what fits -static.
sed -e "s|^prefix=.*|prefix=$(echo "$prefix" | sed 's/ /\\\\ /g')|" -e "s|^libdir=.*|libdir=$(below "$libdir")|" \
    -e "s|^includedir=.*|includedir=$(below "$includedir")|" -e 's| -lgcc_s\b||g' \
    "$stage/usr/lib/pkgconfig/nvsprior.pc" > "$installed/pkgconfig/nvsprior.pc"

# The static library as one object that exports only nvsp_*. As rustc leaves it, libwebp's functions
# and Rust's own would clash with those of the program.
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"${binutils}nm" -D --defined-only "$installed/libnvsprior.so" |
    sed -n 's/.* T \(nvsp_.*\)/-u \1/p' > "$scratch/roots"
"${binutils}ld" -r --gc-sections -o "$scratch/all.o" @"$scratch/roots" "$stage/usr/lib/libnvsprior.a"
"${binutils}objcopy" --wildcard --keep-global-symbol='nvsp_*' --strip-debug \
    --remove-section=.llvmbc --remove-section=.llvmcmd "$scratch/all.o" "$scratch/nvsprior.o"
case $target in
*-gnu)
    "${binutils}as" -o "$scratch/refuse.o" scripts/refuse-static-glibc.s
    mv "$scratch/nvsprior.o" "$scratch/code.o"
    "${binutils}ld" -r -o "$scratch/nvsprior.o" "$scratch/code.o" "$scratch/refuse.o"
    ;;
esac
"${binutils}ar" rcsD "$scratch/libnvsprior.a" "$scratch/nvsprior.o"
install -m 644 "$scratch/libnvsprior.a" "$installed/libnvsprior.a"

# CMake's package.
field() { sed -n "s/^$1: *//p" "$installed/pkgconfig/nvsprior.pc"; }
package=$libdir/cmake/nvsprior
compatible=$(field Version | sed 's/^\(0\.[0-9]*\|[0-9]*\).*/\1/')
soversion=$("${binutils}readelf" -d "$installed/libnvsprior.so" |
    sed -n 's/.*\[libnvsprior\.so\.\(.*\)\]/\1/p')
width=$(rustc --print cfg --target "$target" | sed -n 's/^target_pointer_width="\(.*\)"/\1/p')
mkdir -p "$destdir$package"
for file in nvspriorConfig.cmake nvspriorConfigVersion.cmake; do
    sed -e "s|@VERSION@|$(field Version)|" -e "s|@SOVERSION@|$soversion|" \
        -e "s|@COMPATIBLE@|$compatible|" \
        -e "s|@STATIC_LIBS@|$(field Libs.private | tr ' ' ';')|" \
        -e "s|@POINTER_BYTES@|$((width / 8))|" \
        -e "s|@INCLUDE_FROM_HERE@|$(realpath -ms --relative-to="$package" "$includedir")|" \
        "cmake/$file.in" > "$scratch/$file"
    install -m 644 "$scratch/$file" "$destdir$package/$file"
done
