#!/bin/sh
# Writes the source archive, target/dist/nvsprior-VERSION.tar.xz: the last commit, with all crates, so that it builds
# without a network. Prints its SHA-256 and SHA-512, which recipes ask for.
set -eu
cd "$(dirname "$0")/.."
version=$(sed -n '/^\[package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
out=$PWD/target/dist
name=nvsprior-$version
[ -z "$(git status --porcelain)" ] || echo "dist: what is not committed is not in the archive" >&2

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
git archive --prefix="$name/" HEAD | tar -x -C "$scratch"
(cd "$scratch/$name" && mkdir .cargo && cargo vendor --quiet --locked vendor > .cargo/config.toml)
# A C compiler's own choice of Cargo's home must not matter: the crates are here.
grep -q '^directory = "vendor"' "$scratch/$name/.cargo/config.toml"

mkdir -p "$out"
tar -C "$scratch" --sort=name --mtime="@$(git log -1 --format=%ct)" --owner=0 --group=0 --numeric-owner \
    --mode=u=rwX,go=rX -c "$name" | xz -T0 -6 > "$out/$name.tar.xz"
echo "$out/$name.tar.xz: $(wc -c < "$out/$name.tar.xz") bytes, $(ls "$scratch/$name/vendor" | wc -l) crates"
(cd "$out" && sha256sum "$name.tar.xz" && sha512sum "$name.tar.xz")
