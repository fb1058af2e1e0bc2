#!/bin/sh
# Runs the programs of tests/c under many limits of address space, from what a program needs to load to what it needs to
# pass; then as many between the last limit that it fails under and the first that it passes under.
# Usage: c-memory.sh [LIMITS]: half the limits for each program, 16 if no number is named. Run `c-test.sh library
# c_programs` before.
#
# Under a limit a program may pass, or end with a failed check: a call gave a status. It must not be ended by the
# library, hang, or see NVSP_ERR_INTERNAL. A Vulkan driver may end the process for want of memory, and Mesa's does while
# it compiles; fault_origin.c tells that apart, and this script counts it.
set -eu
cd "$(dirname "$0")/.."
limits=${1:-16}
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
work=$target/c-test/programs
scene=${C_SCENE:-$target/tmp/c-scene}
programs=${C_PROGRAMS:-structs nulls images encoding decoding threads unprotected garbage given_device dmabuf}
cc -std=c11 -Wall -Wextra -Wpedantic -Werror -O1 -g -fPIC -shared tests/c/fault_origin.c -o "$work/fault_origin.so" -ldl
export NVSP_TEST_FEW=1
log=$work/memory.log
: > "$log"

# Runs a program under a limit in KiB; its exit code.
limited() { # Program, limit.
    code=0
    (
        ulimit -v "$2"
        # shellcheck disable=SC2086 # No scene is no argument.
        exec timeout 300 env LD_PRELOAD="$work/fault_origin.so" "$work/$1" $3
    ) > "$work/memory.out" 2>&1 || code=$?
    { echo "== $1 with $2 KiB: $code"; cat "$work/memory.out"; } >> "$log"
}

# Runs a program with limits from one to another.
try_between() { # Program, from, to.
    n=0 from=$2 to=$3
    while [ $n -lt "$limits" ]; do
        limit=$((from + (to - from) * n / (limits - 1) + 64))
        n=$((n + 1))
        limited "$1" "$limit" "$scene"
        case $code in
        0)
            passed=$((passed + 1))
            [ "$limit" -gt "$first_passed" ] || first_passed=$limit
            continue
            ;;
        1)
            checks=$((checks + 1))
            ! grep -q 'returned -24\b' "$work/memory.out" || complain "$1"
            ;;
        93) driver=$((driver + 1)) ;;
        *) complain "$1" ;;
        esac
        [ "$limit" -lt "$last_failed" ] || last_failed=$limit
    done
}

complain() {
    failed=1
    echo "$1 with $limit KiB: ended with $code"
    tail -n 5 "$work/memory.out" | sed 's/^/    /'
}

failed=0
for name in $programs; do
    rm -f "$work/memory.peak"
    NVSP_TEST_PEAK=$work/memory.peak LD_PRELOAD=$work/fault_origin.so "$work/$name" "$scene" \
        > "$work/memory.out" 2>&1 ||
        { cat "$work/memory.out"; echo "c-memory: $name fails without a limit" >&2; exit 1; }
    peak=$(cat "$work/memory.peak")
    # Without a scene a program says how it is called: it has loaded then.
    load=8192
    while limited "$name" "$load" "" && ! grep -q '^usage\|usage:' "$work/memory.out"; do
        load=$((load + 2048))
    done
    passed=0 checks=0 driver=0 last_failed=$load first_passed=$peak
    try_between "$name" "$load" "$peak"
    # Once more where it begins to pass.
    try_between "$name" "$last_failed" "$first_passed"
    echo "$name: $((2 * limits)) limits from $((load >> 10)) to $((peak >> 10)) MiB: $passed passed, $checks ended" \
        "with a status, the driver ended $driver"
done
[ $failed = 0 ] || { echo "c-memory: failed; the whole output is in $log" >&2; exit 1; }
