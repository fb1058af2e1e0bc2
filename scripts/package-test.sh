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
strangers=$("${tools}nm" -g --defined-only "$lib/libnvsprior.a" |
    sed -n 's/^[0-9a-f]* . //p' | grep -v '^nvsp_') &&
    fail "libnvsprior.a shows more than nvsp_*: $strangers"
glibc=$("${tools}readelf" -V "$lib/libnvsprior.so" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -1)

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

# By CMake.
cross=""
[ -z "$tools" ] || cross="-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=${target%%-*}"
# shellcheck disable=SC2086
cmake -S tests/package -B "$work/cmake" -DCMAKE_C_COMPILER="$cc" $cross -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_PREFIX_PATH="$work/moved" > "$work/log" || { cat "$work/log" >&2; exit 1; }
cmake --build "$work/cmake" > "$work/log" || { cat "$work/log" >&2; exit 1; }

version=$(pc --modversion)
for program in by-pc-shared by-pc-static all-static cmake/device-nvsprior cmake/device-static; do
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
