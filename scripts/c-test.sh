#!/bin/sh
# Tests the C library as a vendor gets it: installed into a folder, with its header, the examples, and the programs of
# tests/c. Usage: c-test.sh [quick|full|GROUP...]; full adds figures, sanitizers and a soak. If you name groups,
# `library` must have installed the library before, except for sanitizers, memcheck, memcheck_all and soak; and
# `c_programs` must have compiled the programs for every_allocation and limits.
#
# Each group's output goes to a file. The script prints one line per group, and the end of the
# output if a group fails.
set -eu
cd "$(dirname "$0")/.."
quick="library header symbols abi readme examples c_programs"
case ${1:-quick} in
quick) groups=$quick ;;
full) groups="$quick figures sanitizers soak" ;;
*) groups=$* ;;
esac

target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
work=$target/c-test
prefix=$work/prefix
scene=$target/tmp/c-scene
programs="structs nulls images encoding lens_and_mask pipelined decoding truth blocks threads unprotected keys"
programs="$programs shares"
programs="$programs garbage given_device dmabuf"
# Whose threads are not as most are.
hosts="float_environment small_stack"
export PKG_CONFIG_PATH="$prefix/lib/pkgconfig"
c_flags="-std=c11 -Wall -Wextra -Wpedantic -Werror -O1 -g -pthread"
example_flags="-Wall -Wextra -Wpedantic -Werror -O1"
mkdir -p "$work"

# The library, and the scene that the programs work on.
library() {
    make install PREFIX="$prefix" LIBDIR="$prefix/lib" INCLUDEDIR="$prefix/include" DESTDIR=
    # The tests' profile and packages, so that nothing is built twice.
    CARGO_TARGET_DIR=$target cargo test --quiet --workspace --exclude nvsprior-gst --exclude nvsprior-python \
        --test capi scene_is_written
    echo "installed: $(stat -Lc %s "$prefix/lib/libnvsprior.so") bytes shared"
}

# Each header alone, in every language that it is for. They must be what the sources give.
header() {
    for header in include/*.h; do
        for compiler in gcc clang; do
            for language in c99 c11 c++17; do
                case $language in c++*) x=c++ ;; *) x=c ;; esac
                $compiler -x $x -std=$language -Wall -Wextra -Wpedantic -Werror -fsyntax-only "$header"
            done
        done
    done
    rm -rf "$work/headers"
    mkdir "$work/headers"
    scripts/header.py "$work/headers"
    diff -ru include "$work/headers"
    diff -ru include "$prefix/include"
    echo "$(ls include | xargs): gcc and clang, C99, C11 and C++17; as the sources have them"
}

# The library's exports: no less and no more.
symbols() {
    nm -D --defined-only "$prefix/lib/libnvsprior.so" | sed 's/.* //' | LC_ALL=C sort > "$work/symbols"
    diff -u tests/c/symbols.txt "$work/symbols"
    echo "$(wc -l < "$work/symbols") functions"
}

# The ABI against the committed one: `make abi-baseline` renews that.
abi() {
    scripts/abi.sh selftest
    scripts/abi.sh check
}

# README's program: the text between the fences after the comment that names this script.
readme() {
    sed -n '/^<!-- make c-test/,/^```$/p' README.md | sed '/^<!--/d; /^```/d' > "$work/readme.c"
    [ -s "$work/readme.c" ]
    # shellcheck disable=SC2046 # Flags are words.
    cc -Wall -Wextra -Werror "$work/readme.c" -o "$work/readme" $(pkg-config --cflags --libs nvsprior)
    c++ -std=c++20 -Wall -Wpedantic -Werror -fsyntax-only $(pkg-config --cflags nvsprior) -x c++ "$work/readme.c"
    echo "$(wc -l < "$work/readme.c") lines compiled and linked, and compiled as C++20"
}

# The examples by pkg-config and by CMake, shared and static; each pair of compilers once.
examples() {
    export LD_LIBRARY_PATH="$prefix/lib"
    for link in shared static; do
        out=$work/examples-$link
        mkdir -p "$out"
        libs=$(pkg-config --libs nvsprior)
        if [ $link = static ]; then
            libs="$prefix/lib/libnvsprior.a $(pkg-config --static --libs-only-l nvsprior |
                sed 's/-lnvsprior//')"
        fi
        for compiler in gcc clang; do
            cxx=$([ $compiler = gcc ] && echo g++ || echo clang++)
            # shellcheck disable=SC2046,SC2086
            for name in encode_frame decode_frame; do
                $compiler -std=c99 $example_flags c-examples/$name.c -o "$out/$name" \
                    $(pkg-config --cflags nvsprior) $libs
            done
            # shellcheck disable=SC2046,SC2086
            for name in modem_link camera_ring; do
                $cxx -std=c++17 $example_flags -pthread c-examples/$name.cpp -o "$out/$name" \
                    $(pkg-config --cflags nvsprior) $libs
            done
            # shellcheck disable=SC2046,SC2086
            for name in unet_link firmware_loop; do
                $compiler -std=c99 $example_flags -fsyntax-only -I tests/c/mock \
                    $(pkg-config --cflags nvsprior) c-examples/$name.c
            done
            # shellcheck disable=SC2046,SC2086
            $cxx -std=c++17 $example_flags -fsyntax-only -I tests/c/mock \
                $(pkg-config --cflags nvsprior) c-examples/goby_link.cpp
        done
        run_examples "$out"
        rm -rf "$work/cmake-$link"
        cmake -S c-examples -B "$work/cmake-$link" -DCMAKE_PREFIX_PATH="$prefix" \
            -DNVSPRIOR_STATIC=$([ $link = static ] && echo ON || echo OFF)
        cmake --build "$work/cmake-$link"
        run_examples "$work/cmake-$link"
    done
    echo "encode_frame, decode_frame, modem_link, camera_ring: pkg-config and CMake, shared and static"
}

# Each example once: packet and picture must be those of the library as it is tested, and the pictures must arrive.
run_examples() {
    camera=$(sed -n 1p "$scene/scene.txt")
    start=$(sed -n 2p "$scene/scene.txt")
    prior=$scene/prior.ply
    "$1/encode_frame" "$prior" "$scene/frame-0.ppm" "$camera" "$start" "$work/0.nvsp"
    "$1/decode_frame" "$prior" "$work/0.nvsp" "$work/0.ppm"
    # The tests' profile wrote these: another one gives the same packet and the same picture.
    cmp "$scene/expected-0.nvsp" "$work/0.nvsp"
    cmp "$scene/expected-0.ppm" "$work/0.ppm"
    "$1/modem_link" "$prior" "$camera" "$start" 40000,4,0.1 "$scene"/frame-*.ppm > "$work/modem_link.log"
    cat "$work/modem_link.log"
    grep -q '^topside: [5-8] of 8 pictures' "$work/modem_link.log"
    # Packets stand one modem frame in five that is lost: by chance one of them may not.
    "$1/modem_link" "$prior" "$camera" "$start" 20000,4,0.2 "$scene"/frame-*.ppm > "$work/modem_link.log"
    cat "$work/modem_link.log"
    [ "$(grep -c '^vehicle: frame' "$work/modem_link.log")" -ge 7 ]
    grep -q '^topside: [6-8] of 8 pictures' "$work/modem_link.log"
    "$1/camera_ring" "$prior" "$camera" "$start" 15 1 "$scene"/frame-*.ppm
    if "$1/decode_frame" "$prior" "$scene/scene.txt" "$work/none.ppm"; then
        echo "decoded what is no packet"
        return 1
    fi
}

# Compiles a program of tests/c: folder, compiler, name, flags.
compile() {
    mkdir -p "$work/$1"
    # One program makes a Vulkan device itself.
    vulkan=$([ "$3" != given_device ] || echo -lvulkan)
    # shellcheck disable=SC2086
    $2 $c_flags $4 -I "$prefix/include" "tests/c/$3.c" tests/c/common.c -o "$work/$1/$3" \
        -L "$prefix/lib" -lnvsprior $vulkan -lm -ldl -Wl,-rpath,"$prefix/lib"
}

c_programs() {
    for name in $programs $hosts allocations held_memory no_memory lost_device hung_device; do
        compile clang clang "$name" ""
        compile programs gcc "$name" ""
    done
    for name in $programs $hosts allocations held_memory no_memory; do
        "$work/programs/$name" "$scene"
    done
    # shellcheck disable=SC2086
    cc $c_flags -fPIC -shared tests/c/lost_device_layer.c -o "$work/programs/liblost_device_layer.so"
    cp tests/c/lost_device_layer.json "$work/programs/"
    for name in lost_device hung_device; do
        VK_LAYER_PATH=$work/programs VK_INSTANCE_LAYERS=VK_LAYER_NVSPRIOR_lost_device \
            "$work/programs/$name" "$scene"
    done
    echo "$programs $hosts allocations held_memory no_memory lost_device hung_device"
}

# What docs/c-libraries.md states: time of the calling thread, of a poll, size, allocations.
figures() {
    compile programs gcc figures ""
    "$work/programs/figures" "$scene"
}

# Each allocation of the calls that take memory fails once, alone and with all after it.
every_allocation() {
    NVSP_TEST_EVERY=1 "$work/programs/no_memory" "$scene"
}

# The programs under limits of address space.
limits() {
    C_PROGRAMS=$programs scripts/c-memory.sh
}

# The programs under AddressSanitizer and UndefinedBehaviorSanitizer. The library is built as usual. It uses the same
# malloc, so leaks and uses after free show, its own and the driver's. None are suppressed.
sanitizers() {
    export ASAN_OPTIONS=detect_leaks=1:strict_string_checks=1 UBSAN_OPTIONS=halt_on_error=1
    for name in $programs; do
        compile sanitizers clang "$name" "-fsanitize=address,undefined -fno-sanitize-recover=all"
        "$work/sanitizers/$name" "$scene"
    done
    echo "address, undefined, leaks: $programs"
}

# Mesa's CPU driver compiles its shaders while the program runs, hence --smc-check. It runs on one
# thread, without vectors that valgrind does not know. Most of the time goes into that compiling.
#
# These are the programs that encode few frames; they take minutes. `memcheck_all` takes half an hour.
memcheck() {
    check_memory structs nulls decoding unprotected keys shares garbage
}

memcheck_all() {
    # shellcheck disable=SC2086
    check_memory $programs
}

check_memory() {
    for name in "$@"; do
        compile programs gcc "$name" ""
    done
    printf '%s\n' "$@" | NVSP_TEST_FEW=1 LP_NATIVE_VECTOR_WIDTH=128 LP_NUM_THREADS=1 \
        xargs -P "$(nproc)" -I NAME valgrind --quiet --error-exitcode=9 --smc-check=all-non-file \
        --fair-sched=yes --leak-check=full --num-callers=40 \
        --errors-for-leak-kinds=definite,indirect --show-leak-kinds=definite,indirect \
        --suppressions=tests/c/valgrind.supp "$work/programs/NAME" "$scene"
    echo "memory and leaks: $*"
}

soak() {
    compile programs gcc soak ""
    "$work/programs/soak" "$scene" 2000
    tail -n 2 "$work/soak.log" | head -n 1
}

failed=""
group() {
    started=$(date +%s)
    # A group ends at its first failure, as it is not itself what `if` looks at; its last line says what
    # was done.
    (set -e; "$1") > "$work/$1.log" 2>&1 &
    if wait $!; then
        result=ok
    else
        result=FAILED
    fi
    printf '%-11s %-6s %4d s  %s\n' "$1" "$result" $(($(date +%s) - started)) \
        "$(tail -n 1 "$work/$1.log")"
}

for name in $groups; do
    group "$name"
    if [ "$result" = FAILED ]; then
        tail -n 20 "$work/$name.log" | sed 's/^/    /'
        failed="$failed $name"
        [ "$name" != library ] || break
    fi
done
[ -z "$failed" ] || { echo "failed:$failed; the whole output is in $work" >&2; exit 1; }
