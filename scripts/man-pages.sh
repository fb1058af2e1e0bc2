#!/bin/sh
# Writes the manual pages of the program and of its subcommands, from what they print for --help.
# Usage: man-pages.sh PROGRAM TARGET DIR; a program of a foreign target runs under QEMU.
set -eu
export LC_ALL=C.UTF-8
[ $# = 3 ] || { echo "usage: man-pages.sh PROGRAM TARGET DIR" >&2; exit 2; }
program=$1
run=""
if [ "$2" != "$(rustc --print host-tuple)" ]; then
    run="qemu-${2%%-*} -L /usr/$(echo "$2" | sed 's/-unknown//') "
fi
dir=$3
mkdir -p "$dir"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# help2man would take the page's name from the usage: the same for all.
page() { # Name, subcommand.
    # In ASCII: help2man takes no other characters without Perl's gettext.
    printf '#!/bin/sh\n%s"%s" %s "$@" | iconv -f UTF-8 -t ASCII//TRANSLIT\n' "$run" "$program" "$2" > "$scratch/$1"
    chmod +x "$scratch/$1"
    # The first line says what it is for. It begins with a capital and may end with a full stop.
    about=$("$scratch/$1" -h | head -n 1 | sed 's/\.$//')
    printf '[name]\n%s \\- %s\n' "$1" "$about" > "$scratch/name"
    help2man --no-info --section=1 --manual="nvsprior" --source="$version" --version-string="$version" \
        --include="$scratch/name" "$scratch/$1" > "$dir/$1.1"
}
printf '#!/bin/sh\nexec %s"%s" "$@"\n' "$run" "$program" > "$scratch/run"
chmod +x "$scratch/run"
version=$("$scratch/run" --version)
page nvsprior ""
# The subcommands of the program, or of one of its subcommands.
below() {
    "$scratch/run" "$@" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z][a-z-]*\) .*/\1/p' | grep -v '^help$' || true
}
pages=0
for name in $(below); do
    page "nvsprior-$name" "$name"
    pages=$((pages + 1))
    for own in $(below "$name"); do
        page "nvsprior-$name-$own" "$name $own"
        pages=$((pages + 1))
    done
done
echo "manual pages: $pages subcommands"
