#!/bin/sh
# Writes the source archive, target/dist/nvsprior-VERSION.tar.xz: the last commit, with all crates, so that it builds
# without a network. Beside it: the recipes for Conan and vcpkg, with its address and checksums.
# Beside it, too: SHA256SUMS, and with SIGN the signatures *.asc of archive and sums.
# Usage: [ADDRESS=file://...] [SIGN=KEY] dist.sh
# ADDRESS: the folder that the recipes fetch the archive from; by default the one that it is written to.
# SIGN: the key that GnuPG signs with; without it nothing is signed.
set -eu
cd "$(dirname "$0")/.."
version=$(sed -n '/^\[package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
out=$PWD/target/dist
name=nvsprior-$version
[ -z "$(git status --porcelain)" ] || echo "dist: what is not committed is not in the archive" >&2

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
git archive --prefix="$name/" HEAD | tar -x -C "$scratch"
(cd "$scratch/$name" && mkdir .cargo && cargo vendor --locked vendor > .cargo/config.toml 2> "$scratch/log") ||
    { cat "$scratch/log" >&2; exit 1; }

mkdir -p "$out"
tar -C "$scratch" --sort=name --mtime="@$(git log -1 --format=%ct)" --owner=0 --group=0 --numeric-owner \
    --mode=u=rwX,go=rX -c "$name" | xz -T0 -6 > "$out/$name.tar.xz"
echo "$out/$name.tar.xz: $(wc -c < "$out/$name.tar.xz") bytes, $(ls "$scratch/$name/vendor" | wc -l) crates"
(cd "$out" && sha256sum "$name.tar.xz" > SHA256SUMS)
rm -f "$out"/*.asc
if [ -n "${SIGN:-}" ]; then
    for file in "$name.tar.xz" SHA256SUMS; do
        gpg --batch --local-user "$SIGN" --armor --output "$out/$file.asc" --detach-sign "$out/$file"
    done
else
    echo "dist: not signed; SIGN=KEY signs with GnuPG" >&2
fi

# The recipes.
url=${ADDRESS:-file://$out}/$name.tar.xz
sha256=$(sha256sum "$out/$name.tar.xz" | cut -d ' ' -f 1)
sha512=$(sha512sum "$out/$name.tar.xz" | cut -d ' ' -f 1)
rm -rf "$out/conan" "$out/vcpkg"
cp -r packaging/conan packaging/vcpkg "$out/"
printf 'sources:\n  "%s":\n    url: "%s"\n    sha256: "%s"\n' "$version" "$url" "$sha256" > "$out/conan/conandata.yml"
sed -i -e "s|@VERSION@|$version|" -e "s|@URL@|$url|" -e "s|@SHA512@|$sha512|" "$out"/vcpkg/*
echo "$out/conan, $out/vcpkg: $url, SHA-256 $sha256"
