#!/bin/sh
# The GStreamer plugin's tests, and the lines of docs/gstreamer.md on the demo's frames.
# Usage: gst-test.sh; FRAMES: how many frames, FPS: how many of them per second (a CPU's driver takes its time).
set -eu
cd "$(dirname "$0")/.."
frames=${FRAMES:-8}
fps=${FPS:-1}

cargo clippy --package nvsprior-gst --all-targets -- -D warnings
cargo test --package nvsprior-gst --no-run
# Pipelines have threads: one that never ends fails here, with its name in the last line.
timeout 900 cargo test --package nvsprior-gst
cargo build --package nvsprior-gst --lib --examples
built=$PWD/${CARGO_TARGET_DIR:-target}/debug
case ${CARGO_TARGET_DIR:-} in /*) built=$CARGO_TARGET_DIR/debug ;; esac

work=$(mktemp -d)
pids=""
finish() {
    for pid in $pids; do kill "$pid" 2>/dev/null || true; done
    rm -rf "$work"
}
trap finish EXIT
fail() {
    echo "gst-test: $1" >&2
    for log in "$work"/*.log; do echo "--- $log" >&2; tail -n 15 "$log" >&2; done
    exit 1
}

export GST_PLUGIN_PATH="$built" GST_REGISTRY="$work/registry" GST_DEBUG_NO_COLOR=1
gst-inspect-1.0 nvsprior > "$work/inspect.log" || fail "the plugin does not load"
for element in nvspvehicle nvsptopside nvspenc nvspdec; do
    gst-inspect-1.0 "$element" > "$work/$element.log" || fail "$element is not there"
    grep -q "stats" "$work/$element.log" || fail "$element has no statistics"
done

"$built/examples/demo_frames" "$work/demo-out" "$frames"
cp "$work/demo-out/prior.ply" "$work/prior.ply"

# The lines of a name, as the document has them.
lines() {
    awk -v name="runs this: $1 -->" 'index($0, name) { found = 1; next } found && /^```sh/ { on = 1; next }
        on && /^```/ { exit } on' docs/gstreamer.md
}
count() { find "$1" -name "$2" -size +0 | wc -l; }

# The whole way on one machine: word for word.
lines local > "$work/local.sh"
(cd "$work" && timeout 300 sh -eu local.sh > local.log 2>&1) || fail "the line that needs no vehicle"
[ "$(count "$work/seen" '*.png')" = "$frames" ] || fail "not every frame was seen"

# Camera, frame rate and window are others here: frames from files, slower ones, and a folder.
camera=$(python3 -c 'import json; c = json.load(open("'"$work"'/demo-out/T1/cameras.json"))
print(1280, 720, *(4 * c[name] for name in ["fx", "fy", "cx", "cy"]), sep=",")')
start=$(python3 -c 'import json; i = json.load(open("'"$work"'/demo-out/T1/cameras.json"))["images"][0]
print(*i["qvec"], *i["tvec"], sep=",")')
export camera start
source="multifilesrc location=$work/demo-out/T1/T1/%04d.png index=1 caps=image/png,framerate=$fps/1 ! pngdec"
source="$source ! videoconvert ! videoscale ! video/x-raw,width=1280,height=720 ! jpegenc quality=95"
# As a camera does, it gives frames in their time.
source="$source ! identity sync=true"
mkdir "$work/window"
replaced() {
    lines "$1" | sed -e "s#v4l2src device=/dev/video0#$source#" -e "s#framerate=5/1#framerate=$fps/1#" \
        -e "s#autovideosink#pngenc ! multifilesink location=window/%04d.png#" \
        -e "s#gst-launch-1.0#exec gst-launch-1.0 -m#" \
        > "$work/$1.sh"
    [ -s "$work/$1.sh" ] || fail "docs/gstreamer.md has no lines of the name $1"
}
replaced vehicle
grep -q multifilesrc "$work/vehicle.sh" || fail "the vehicle's line has another camera"
for side in window station; do
    replaced $side
    (cd "$work" && exec timeout 300 sh -eu $side.sh > $side.log 2>&1) &
    side_pid=$!
    pids="$pids $side_pid"
    mkdir -p "$work/h264"
    if [ $side = station ]; then
        # What a ground station does.
        timeout 300 gst-launch-1.0 udpsrc port=5600 \
            caps="application/x-rtp,media=video,encoding-name=H264,clock-rate=90000,payload=96" \
            ! rtph264depay ! video/x-h264,stream-format=byte-stream,alignment=au \
            ! multifilesink location="$work/h264/%04d.h264" > "$work/ground.log" 2>&1 &
        pids="$pids $!"
    fi
    # It plays once the device is ready.
    for _ in $(seq 60); do
        grep -q "PLAYING" "$work/$side.log" && break
        sleep 1
    done
    (cd "$work" && timeout 300 sh -eu vehicle.sh > "vehicle-$side.log" 2>&1) || fail "the vehicle's line"
    grep -q topside-heard "$work/vehicle-$side.log" || fail "no report came to the vehicle: $side"
    sleep 4
    kill -0 $side_pid 2>/dev/null || fail "the topside's line has ended: $side"
    kill -INT $side_pid 2>/dev/null || true
    wait $side_pid 2>/dev/null || true
done
seen=$(count "$work/window" '*.png')
streamed=$(count "$work/h264" '*.h264')
least=$((frames / 2))
[ "$seen" -ge $least ] || fail "$seen of $frames frames in the window"
[ "$streamed" -ge $least ] || fail "$streamed of $frames frames at the ground station"
echo "gst-test: $frames frames, $seen in the window, $streamed at the ground station"
