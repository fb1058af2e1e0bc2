#!/bin/sh
# A new user's way from a survey's video to a decoded dive, each step with its time: docs/first-dive.md.
# Usage: first-dive.sh OUT [PROGRAMS]; PROGRAMS: the folder of nvsprior and nvsprior-lab
set -eu
out=$1
programs=${2:-target/release}
mkdir -p "$out"
times=$out/times.txt
: > "$times"

step() {
    name=$1
    shift
    echo
    echo "== $name: $*"
    begin=$(date +%s)
    "$programs/$@"
    printf '%6s s  %s\n' "$(($(date +%s) - begin))" "$name" | tee -a "$times"
}

step "draw a survey's video" nvsprior-lab draw --video "$out/quay.mp4"
step "map it" nvsprior map "$out/quay.mp4" --out "$out/quay.nvsg" --report "$out/map"
step "draw a dive's video" nvsprior-lab draw --video "$out/dive.mp4" --later --seconds 12 --fps 2
step "encode the dive" nvsprior encode --prior "$out/quay.nvsg" --cameras "$out/quay.nvsg.colmap" \
    --video "$out/dive.mp4" --starts none --psnr 33 --packets "$out/packets" --summary "$out/encode.json" \
    --pictures "$out/vehicle" --overwrite
step "decode it" nvsprior decode --prior "$out/quay.nvsg" --packets "$out/packets" --pictures "$out/topside" --overwrite
same=0
for frame in "$out"/topside/*.png; do
    cmp -s "$frame" "$out/vehicle/$(basename "$frame")" || { echo "$frame differs" >&2; exit 1; }
    same=$((same + 1))
done
echo
echo "$same pictures, the same on both sides"
cat "$times"
