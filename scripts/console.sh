#!/bin/sh
# Starts a working link on the demo's run T2: console, channel and vehicle. Prints the page's address. Ctrl-C ends all.
# Usage: console.sh [OUT]; the program is target/release/nvsprior, or the one that NVSPRIOR names.
set -eu
cd "$(dirname "$0")/.."
nvsprior=${NVSPRIOR:-target/release/nvsprior}
out=${1:-demo-out}
page=${PAGE:-127.0.0.1:8080} topside=${TOPSIDE_PORT:-5700} modem=${MODEM_PORT:-5701}

[ -e "$out/prior.ply" ] || "$nvsprior" demo --out "$out" --frames 1
if ! [ -e "$out/T2/T2/0060.png" ]; then
    "$nvsprior" demo --run T2 --draw-only --frames 60 --out "$out"
fi

running=""
trap '[ -z "$running" ] || kill $running 2> /dev/null || true' EXIT
trap 'exit 130' INT TERM
"$nvsprior" console --prior "$out/prior.ply" --udp "127.0.0.1:$topside" --listen "$page" --keep "$out/kept" &
running="$!"
"$nvsprior" channel --from "127.0.0.1:$modem" --to "127.0.0.1:$topside" --bit-rate 8000 --loss 0.1 --delay 0.5 &
running="$running $!"
"$nvsprior" vehicle --prior "$out/prior.ply" --cameras "$out/T2/cameras.json" --split T2 --to "127.0.0.1:$modem" \
    --bit-rate 8000 --frame-rate 3 --forth-and-back &
running="$running $!"
wait
