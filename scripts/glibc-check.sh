#!/bin/sh
# Fails if a program or library asks for a newer glibc than the given one. Usage: glibc-check.sh GLIBC FILE...
set -eu
[ $# -gt 1 ] || { echo "usage: glibc-check.sh GLIBC FILE..." >&2; exit 2; }
most=$1
shift
for file in "$@"; do
    # GLIBC_ABI_DT_RELR and its like are marks of newer versions, without a number.
    asked=$(readelf --version-info --wide "$file" | grep -o 'GLIBC_[0-9A-Z][0-9A-Z_.]*' | sort -uV)
    [ -n "$asked" ] || { echo "glibc-check: $file names no version of glibc" >&2; exit 1; }
    newest=$(echo "$asked" | sed 's/GLIBC_//' | tail -n 1)
    if [ "$(printf '%s\n%s\n' "$newest" "$most" | sort -V | tail -n 1)" != "$most" ]; then
        echo "glibc-check: $file asks for glibc $newest, newer than $most:" >&2
        objdump -T "$file" 2>/dev/null | grep "GLIBC_$newest" >&2 || true
        exit 1
    fi
    echo "$(basename "$file"): glibc $newest or newer"
done
