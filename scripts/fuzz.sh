#!/bin/sh
# Fuzzes targets of fuzz/, each so many executions: fuzz/README.md. Usage: fuzz.sh RUNS TARGET...
# Inputs that fail lie in fuzz/artifacts/TARGET; what a run adds to a corpus is dropped.
set -eu
cd "$(dirname "$0")/.."
runs=$1
shift
[ $# -gt 0 ] || set -- $(ls fuzz/src | sed -n 's/\.rs$//p' | grep -vx -e predicted -e vehicle)
command -v cargo-fuzz > /dev/null || cargo install cargo-fuzz
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for target in "$@"; do
    mkdir "$work/$target"
    cargo +nightly fuzz run -s none --no-trace-compares "$target" "$work/$target" "fuzz/corpus/$target" -- \
        -max_len=2048 -runs="$runs" -print_final_stats=1 -verbosity=0 -timeout=20
done
