#!/bin/bash
# Starts a working link on the demo's run T2: console, channel and vehicle. The console prints the page's address.
# Ctrl-C ends all three. If one ends by itself, the others end, too.
# Usage: console.sh [OUT]; the program is target/release/nvsprior, or the one that NVSPRIOR names.
# PAGE, TOPSIDE_PORT and MODEM_PORT choose other ports.
set -euo pipefail
cd "$(dirname "$0")/.."
nvsprior=${NVSPRIOR:-${CARGO_TARGET_DIR:-target}/release/nvsprior}
out=${1:-demo-out}
page=${PAGE:-127.0.0.1:8080} topside=${TOPSIDE_PORT:-5700} modem=${MODEM_PORT:-5701}

if ! [ -e "$out/T2/T2/0060.png" ] || ! [ -e "$out/prior.nvsg" ]; then
    "$nvsprior" demo --run T2 --draw-only --frames 60 --out "$out"
fi

end() {
    # shellcheck disable=SC2046 # Numbers are words.
    kill $(jobs -p) 2> /dev/null || true
    wait
}
trap end EXIT
trap 'exit 130' INT TERM
"$nvsprior" console --prior "$out/prior.nvsg" --udp "127.0.0.1:$topside" --listen "$page" --keep "$out/kept" &
"$nvsprior" channel --from "127.0.0.1:$modem" --to "127.0.0.1:$topside" --bit-rate 2000 --loss 0.1 --delay 1 &
"$nvsprior" vehicle --prior "$out/prior.nvsg" --cameras "$out/T2/cameras.json" --split T2 --to "127.0.0.1:$modem" \
    --bit-rate 2000 --delay 1.5 --latency 3 --frame-rate 3 --forth-and-back &
wait -n || {
    echo "console.sh: one of the three has ended, as told above, so the others end, too. For other ports:" \
        "make console PAGE=127.0.0.1:8081 TOPSIDE_PORT=5702 MODEM_PORT=5703" >&2
    exit 1
}
