#!/bin/sh
# Installs the C library into a folder, moves that, and builds a program against it by pkg-config and
# by CMake, with the shared and with the static library. Runs the four, and prints sizes.
# Usage: package-test.sh [PROFILE [TARGET]]; programs of a foreign target run under QEMU.
set -eu
cd "$(dirname "$0")/.."

profile=${1:-release}
host=$(rustc --print host-tuple)
target=${2:-$host}
tools="" run="" cc=${CC:-cc}
if [ "$target" != "$host" ]; then
    gnu=$(echo "$target" | sed 's/-unknown//')
    tools=$gnu- run="qemu-${target%%-*} -L /usr/$gnu" cc=$gnu-gcc
fi
fail() { echo "package-test: $1" >&2; exit 1; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
PREFIX=/opt/nvsprior LIBDIR="" INCLUDEDIR="" DESTDIR="$work/stage" \
    scripts/install.sh "$profile" "$target"
mv "$work/stage/opt/nvsprior" "$work/moved"
lib=$work/moved/lib

# The libraries' exports, and the machine that they are for.
machine() { "${tools}readelf" -h "$1" | sed -n 's/ *Machine: *//p'; }
for file in libnvsprior.so libnvsprior.a; do
    [ "$(machine "$lib/$file")" = "$(machine "$("$cc" -print-file-name=crti.o)")" ] ||
        fail "$file is of another machine: $(machine "$lib/$file")"
done
strangers=$("${tools}nm" -D --defined-only "$lib/libnvsprior.so" | sed 's/.* //' | grep -v '^nvsp_') &&
    fail "libnvsprior.so shows more than nvsp_*: $strangers"
# _dl_non_dynamic_init: scripts/refuse-static-glibc.s.
strangers=$("${tools}nm" -g --defined-only "$lib/libnvsprior.a" |
    sed -n 's/^[0-9a-f]* . //p' | grep -v '^nvsp_\|^_dl_non_dynamic_init$') &&
    fail "libnvsprior.a shows more than nvsp_*: $strangers"
glibc=$("${tools}readelf" -V "$lib/libnvsprior.so" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -1)
[ -z "${GLIBC:-}" ] || scripts/glibc-check.sh "$GLIBC" "$lib/libnvsprior.so"
soname=$("${tools}readelf" -d "$lib/libnvsprior.so" | sed -n 's/.*soname: \[\(.*\)\]/\1/p')
abi=$(sed -n 's/^#define NVSP_ABI_VERSION \([0-9]*\).*/\1/p' include/nvsprior.h)
[ "$soname" = "libnvsprior.so.$abi" ] || fail "the soname is $soname, the ABI $abi"

# By pkg-config.
pc() { PKG_CONFIG_LIBDIR=$lib/pkgconfig pkg-config --define-prefix "$@" nvsprior; }
# shellcheck disable=SC2046,SC2086 # Flags are words.
build() { "$cc" -O2 -Wall -Wextra -Werror tests/package/device.c -o "$work/$1" $2; }
build by-pc-shared "$(pc --cflags --libs) -Wl,-rpath,$lib"
static=$(pc --static --cflags --libs | sed 's/-lnvsprior/-l:libnvsprior.a/')
build by-pc-static "$static -Wl,--gc-sections"
# A program with all functions of the library, called or not.
roots=$("${tools}nm" -g --defined-only "$lib/libnvsprior.a" | sed -n 's/.* T \(.*\)/-Wl,-u,\1/p')
build all-static "$static -Wl,--gc-sections $(echo "$roots" | tr '\n' ' ')"

# A static glibc loads no drivers: refused when linked, with the reason.
for mode in -static -static-pie; do
    # shellcheck disable=SC2086
    if "$cc" $mode tests/package/device.c -o "$work/refused" $static 2> "$work/log"; then
        fail "linked with $mode against glibc"
    fi
    grep -q 'libnvsprior.a loads Vulkan drivers' "$work/log" ||
        { cat "$work/log" >&2; fail "$mode against glibc fails for another reason"; }
done

# A folder with blanks: what pkg-config prints is quoted for the shell.
mkdir "$work/with blanks"
cp -r "$work/moved" "$work/with blanks/moved"
flags=$(PKG_CONFIG_LIBDIR="$work/with blanks/moved/lib/pkgconfig" pkg-config --define-prefix --cflags --libs nvsprior)
eval "$cc tests/package/device.c -o '$work/by-pc-blanks' $flags"

# By CMake.
cross=""
[ -z "$tools" ] || cross="-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=${target%%-*}"
# A build of its own: folder, kinds.
cmake_builds() {
    # shellcheck disable=SC2086
    cmake -S tests/package -B "$work/$1" -DCMAKE_C_COMPILER="$cc" $cross -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_PREFIX_PATH="$work/moved" -DKINDS="$2" > "$work/log" 2>&1 &&
        cmake --build "$work/$1" >> "$work/log" 2>&1
}
cmake_builds cmake "shared;static" || { cat "$work/log" >&2; exit 1; }

# With one of the two libraries away, the other is found, and the one that is away is named.
lone() {
    mkdir "$work/away"
    mv "$lib"/libnvsprior."$2"* "$work/away/"
    cmake_builds "cmake-$1" "$1" || { cat "$work/log" >&2; fail "CMake does not find the $1 library alone"; }
    ! cmake_builds "cmake-no-$3" "$3" || fail "CMake finds a $3 library that is not there"
    grep -q "libnvsprior.$2 is missing" "$work/log" || { cat "$work/log" >&2; fail "the missing library is not named"; }
    mv "$work/away"/* "$lib/"
    rmdir "$work/away"
}
lone shared a static
lone static so shared

version=$(pc --modversion)
for program in by-pc-shared by-pc-static all-static cmake/device-shared cmake/device-static; do
    # shellcheck disable=SC2086
    said=$($run "$work/$program") || fail "$program: $said"
    echo "$program: $(echo "$said" | tr '\n' ';')"
    echo "$said" | grep -qx "version $version" || fail "$program is not of version $version"
    case $program in
    *-static) needs=0 ;;
    *) needs=1 ;;
    esac
    [ "$("${tools}readelf" -d "$work/$program" | grep -c 'NEEDED.*libnvsprior')" = $needs ] ||
        fail "$program: linked the wrong way"
done

# Sizes, stripped.
echo 'int main(void) { return 0; }' > "$work/empty.c"
"$cc" -O2 "$work/empty.c" -o "$work/empty"
bytes() { "${tools}strip" -o "$work/stripped" "$1" && wc -c < "$work/stripped"; }
empty=$(bytes "$work/empty")
echo "$target, profile $profile, needs $glibc:"
echo "  libnvsprior.so: $(bytes "$lib/libnvsprior.so") bytes"
echo "  linked statically into a program that opens a device:" \
    "$(($(bytes "$work/by-pc-static") - empty)) bytes"
echo "  linked statically with every function: $(($(bytes "$work/all-static") - empty)) bytes"

if [ -n "${KEEP:-}" ]; then
    rm -rf "$KEEP"
    mkdir -p "$(dirname "$KEEP")"
    cp -a "$work/moved" "$KEEP"
    echo "  left in $KEEP"
fi

# Nothing stays but what is another's.
echo other > "$work/moved/include/other.h"
PREFIX=$work/moved LIBDIR="" INCLUDEDIR="" DESTDIR="" scripts/uninstall.sh > "$work/log"
left=$(find "$work/moved" ! -type d)
[ "$left" = "$work/moved/include/other.h" ] || fail "uninstalling leaves $left"
