#!/bin/sh
# Removes what install.sh installs, and nothing else. Give it the same variables.
# Usage: [PREFIX=/usr/local] [LIBDIR=PREFIX/lib] [INCLUDEDIR=PREFIX/include] [DESTDIR=] uninstall.sh
set -eu
prefix=${PREFIX:-/usr/local}
libdir=${DESTDIR:-}${LIBDIR:-$prefix/lib}
includedir=${DESTDIR:-}${INCLUDEDIR:-$prefix/include}

removed=0
for file in "$libdir"/libnvsprior.so "$libdir"/libnvsprior.so.[0-9]* "$libdir/libnvsprior.a" \
    "$libdir/pkgconfig/nvsprior.pc" "$libdir"/cmake/nvsprior/nvspriorConfig.cmake \
    "$libdir"/cmake/nvsprior/nvspriorConfigVersion.cmake "$includedir/nvsprior.h" \
    "$includedir/nvsprior_extra.h"; do
    if [ -e "$file" ] || [ -L "$file" ]; then
        rm "$file"
        echo "removed $file"
        removed=$((removed + 1))
    fi
done
# Of the folders only the library's own is removed: others may share the rest.
[ ! -d "$libdir/cmake/nvsprior" ] || rmdir "$libdir/cmake/nvsprior"
[ "$removed" != 0 ] || { echo "uninstall: nothing of nvsprior in $libdir and $includedir" >&2; exit 1; }
