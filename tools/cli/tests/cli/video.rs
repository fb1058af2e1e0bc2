//! `nvsprior map VIDEO` and `encode --video`.

use std::os::unix::fs::PermissionsExt;

use nvsprior::geometry::{Distortion, Intrinsics, Lens};
use nvsprior::prior::{Extras, extras_file};
use nvsprior::{Camera, Picture, Prior};
use nvsprior_basin::{Conditions, Site, mapping_run};
use nvsprior_inputs::video::{DecoderChoice, encode_video, frame_name};
use serde_json::Value;

use crate::dive::{Dive, FRAMES, pictures, save};
use crate::scene::{CAMERA, pose};

/// Writes pictures as a video, each so many times, one a second.
fn video<'a>(
    dive: &Dive,
    name: &str,
    pictures: impl IntoIterator<Item = &'a Picture>,
    times: usize,
) {
    let folder = tempfile::tempdir().unwrap();
    let all = pictures.into_iter().flat_map(|picture| std::iter::repeat_n(picture, times));
    for (i, picture) in all.enumerate() {
        save(picture, &folder.path().join(frame_name(i)));
    }
    let made = encode_video(folder.path(), 1.0, &dive.path(name), DecoderChoice::Auto);
    made.expect("scripts/setup.sh test installs what makes videos");
}

/// A program of the dive's folder `bin`.
fn program(dive: &Dive, name: &str, script: &str) {
    std::fs::create_dir_all(dive.path("bin")).unwrap();
    let file = dive.path("bin").join(name);
    std::fs::write(&file, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&file, PermissionsExt::from_mode(0o755)).unwrap();
}

fn path_with(dive: &Dive, others: &str) -> String {
    format!("{}:{others}", dive.path("bin").display())
}

#[test]
fn a_video_becomes_a_folder_of_pictures() {
    let dive = Dive::without_frames();
    // The first row of the quay's mapping run: each picture has most of the one before.
    let run: Vec<Picture> =
        mapping_run(Site::Quay, Conditions::CALM).take(8).map(|frame| frame.picture).collect();
    video(&dive, "dive.mp4", &run, 1);
    // COLMAP lists what it was given, and fails.
    program(
        &dive,
        "colmap",
        "case \"$1\" in help) echo COLMAP 9; echo global_mapper;; *) [ \"$2\" = -h ] || \
            { cat pictures.txt >&2; exit 3; };; esac",
    );
    let path = path_with(&dive, "/usr/bin:/bin");
    let map = || dive.run_with("map dive.mp4 --out p.ply --frames 5", &[("PATH", &path)]);
    let run = map()
        .ends_with(1)
        .says("frames are in p.ply.frames")
        .says("COLMAP feature_extractor failed");
    let run = run.says("dive.mp4: 320×180, 8.0 s").says("01-dive/000000.jpg");
    let shown = run.stderr.contains("ffmpeg -nostdin") || run.stderr.contains("gst-launch-1.0 -q");
    assert!(shown, "the decoder's arguments: {}", run.stderr);
    let record: Value = dive.json("p.ply.frames/frames.json");
    let frames = record["frames"].as_array().unwrap();
    assert!((3..=5).contains(&frames.len()), "{record}");
    let overlaps: Vec<f64> = frames[1..].iter().map(|of| of["overlap"].as_f64().unwrap()).collect();
    assert!(overlaps.iter().all(|overlap| (0.5..0.95).contains(overlap)), "{record}");
    assert_eq!((&frames[0]["time"], &frames[0]["overlap"]), (&0.0.into(), &Value::Null));
    assert_eq!(record["videos"][0]["frames"], 8);
    map().says("(chosen before)");
    // FFmpeg counts otherwise when it reads the video again: the same frames are written.
    program(
        &dive,
        "ffmpeg",
        "for word; do set -- \"$@\" \"$(echo \"$word\" | sed 's/+eq(n,/+eq(n+1,/g')\"; shift; done\n\
            exec /usr/bin/ffmpeg \"$@\"",
    );
    dive.run_with("map dive.mp4 --out q.ply --frames 5", &[("PATH", &path)]).ends_with(1);
    for frame in frames {
        let file = frame["file"].as_str().unwrap();
        let [first, again] = ["p", "q"].map(|out| dive.bytes(&format!("{out}.ply.frames/{file}")));
        assert_eq!(first, again, "{file}");
    }
}

/// Stands for COLMAP. Its models have the pictures that are compared with each other, then all.
const STAND_IN: &str = r#"
case "$1 $2" in
  "help ") echo "COLMAP 9.9"; echo "  global_mapper"; exit 0;;
  *" -h") echo "--Mapper.random_seed"; exit 0;;
esac
echo "$*" >> ../calls
[ -f ../fail-$1 ] && exit 3
model() {
  mkdir -p "$1"; cp ../points3D.txt "$1"; echo "1 PINHOLE 320 180 260 260 160 90" > "$1/cameras.txt"
  awk '{ print NR, 1, 0, 0, 0, -0.004 * NR, 0, 0, 1, $0; print "" }' > "$1/images.txt"
}
case "$1" in
  matches_importer) cat pairs-auto.txt >> database.db;;
  global_mapper) tr ' ' '\n' < pairs-auto.txt | sort -u | model sparse.part/0;;
  mapper) model sparse.part < pictures.txt;;
esac
"#;

#[test]
fn poses_are_found_on_few_frames_and_many_are_trained_on() {
    let dive = Dive::without_frames();
    // A camera that moves along a wall, by a fiftieth of the picture from frame to frame.
    let grain = |x: u32, y: u32| {
        let hash = (x * 7919) ^ (y * 104_729);
        (hash ^ (hash >> 7)).wrapping_mul(0x9E37_79B1) >> 26
    };
    let pan = |i: u32| {
        let mut picture = Picture::new(320, 180);
        for (at, value) in picture.data.chunks_mut(3).enumerate() {
            let (x, y) = (at as u32 % 320 + 6 * i, at as u32 / 320);
            let all = [40, 12, 4].map(|cell| grain(x / cell, y / cell)).iter().sum::<u32>();
            value.fill(20 + all as u8);
        }
        picture
    };
    let frames: Vec<Picture> = (0..40).map(pan).collect();
    video(&dive, "clip.mp4", &frames, 1);
    program(&dive, "colmap", STAND_IN);
    let point = |i: usize| {
        let (x, y) = (0.004 * (i % 8) as f64 - 0.01, 0.003 * (i / 8) as f64 - 0.006);
        format!("{i} {x} {y} 0.04 90 120 150 0.5 1 0 2 0\n")
    };
    std::fs::write(dive.path("points3D.txt"), (0..40).map(point).collect::<String>()).unwrap();
    let path = path_with(&dive, "/usr/bin:/bin");
    let map = || {
        let args =
            "map clip.mp4 --out p.ply --splats 300 --iterations 20 --held-out 0 --rehearsal 0";
        dive.run_with(args, &[("PATH", &path)])
    };
    let calls = || {
        let text = std::fs::read_to_string(dive.path("calls")).unwrap_or_default();
        let _ = std::fs::remove_file(dive.path("calls"));
        text.lines().map(str::to_owned).collect::<Vec<String>>()
    };
    // The last step fails at first.
    std::fs::write(dive.path("fail-mapper"), "").unwrap();
    map().ends_with(1).says("COLMAP mapper failed");
    let made = calls();
    let names: Vec<_> = made.iter().map(|call| call.split(' ').next().unwrap()).collect();
    let importer = "matches_importer";
    assert_eq!(names, ["feature_extractor", importer, "global_mapper", importer, "mapper"]);
    let last = &made[4];
    assert!(last.contains("/first/0 --output_path sparse.part --Mapper.random_seed 1"), "{last}");
    std::fs::remove_file(dive.path("fail-mapper")).unwrap();
    map().ends_with(0).says("poses of 40 of 40 pictures");
    assert_eq!(calls(), made[4..]);
    map().ends_with(0).says("poses of 40 of 40 pictures").says("other frames' poses: done before");
    assert_eq!(calls(), Vec::<String>::new());
    // All frames are trained on. Few have poses first, and each of the others is compared with some of these.
    let record: Value = dive.json("p.ply.frames/frames.json");
    let frames = record["frames"].as_array().unwrap();
    let (first, others): (Vec<&Value>, Vec<&Value>) =
        frames.iter().partition(|frame| frame["first"].as_bool().unwrap());
    assert!(frames.len() == 40 && (3..=6).contains(&first.len()), "{record}");
    let pairs = std::fs::read_to_string(dive.path("p.ply.colmap/pairs-joining.txt")).unwrap();
    for frame in others {
        let name = frame["file"].as_str().unwrap();
        let with = |of: &&Value| {
            let other = of["file"].as_str().unwrap();
            pairs
                .lines()
                .any(|pair| pair == format!("{other} {name}") || pair == format!("{name} {other}"))
        };
        assert!(first.iter().filter(|of| with(of)).count() >= 2, "{name}: {pairs}");
    }
}

#[test]
fn wrong_paths_and_arguments_are_refused() {
    let dive = Dive::without_frames();
    std::fs::create_dir(dive.path("images")).unwrap();
    std::fs::write(dive.path("a.mp4"), "no video").unwrap();
    let map = |args: &str| dive.run(&format!("map {args} --out p.ply"));
    map("images a.mp4").ends_with(2).says("one folder of pictures, or one or more videos");
    map("a.mp4 --frames 1").ends_with(2).says("at least two");
    map("images --frames 5").ends_with(2).says("--frames is for videos");
    map("a.mp4 none.mp4").ends_with(1).says("none.mp4: neither a folder of pictures nor a video");
    map("a.mp4 --cameras c.json").ends_with(2);
    map("a.mp4").ends_with(1).says("a.mp4: no frame can be read");
    let encode = |args: &str| {
        dive.run(&format!(
            "encode --prior prior.ply --cameras c.json --packets p --overwrite {args}"
        ))
    };
    encode("--video a.mp4 --starts camera-file").ends_with(2).says("no poses of a video's frames");
    encode("--fps 3").ends_with(2);
}

#[test]
fn decoders_that_are_missing_or_fail_are_named() {
    let dive = Dive::without_frames();
    std::fs::write(dive.path("a.mp4"), "some video").unwrap();
    std::fs::create_dir(dive.path("bin")).unwrap();
    let only = dive.path("bin").display().to_string();
    let map = |args: &str, path: &str| {
        dive.run_with(&format!("map a.mp4 --out p.ply {args}"), &[("PATH", path)])
    };
    map("", &only)
        .ends_with(1)
        .says("neither ffmpeg nor gst-launch-1.0 is on the PATH")
        .says("apt-get install");
    map("--decoder ffmpeg", &only).ends_with(1).says("ffmpeg is not on the PATH");
    // GStreamer's program hangs now and then after it failed.
    program(
        &dive,
        "gst-launch-1.0",
        "echo 'ERROR: from element /p/x: It broke.' >&2; exec sleep 100",
    );
    let path = path_with(&dive, "/usr/bin:/bin");
    map("--decoder gstreamer", &path).ends_with(1).says("gst-launch-1.0 says: It broke.");
    program(&dive, "ffmpeg", "echo 'it broke, too' >&2; exit 1");
    program(&dive, "ffprobe", "exit 1");
    let both = map("", &path).ends_with(1);
    both.says("ffmpeg says: it broke, too").says("gst-launch-1.0 says: It broke.");
}

#[test]
fn a_video_is_encoded_with_its_times() {
    let dive = Dive::new();
    video(&dive, "dive.mp4", pictures(), 2);
    // The poses that are known, by the frames' numbers.
    let row = |t: usize| {
        let (pose, index) = (pose(t as f64), 2 * t);
        let ([w, x, y, z], p) = (pose.wxyz(), pose.translation);
        format!("{index:06},{w},{x},{y},{z},{},{},{}\n", p.x, p.y, p.z)
    };
    let rows: String = (0..FRAMES).map(row).collect();
    std::fs::write(dive.path("starts.csv"), format!("file,qw,qx,qy,qz,tx,ty,tz\n{rows}")).unwrap();
    let fixed = "encode --prior prior.ply --cameras cameras.json --packets packets --overwrite --summary summary.json";
    dive.run(&format!("{fixed} --video dive.mp4 --fps 0.5 --starts starts.csv --limit {FRAMES}"))
        .ends_with(0);
    let summary = dive.json("summary.json");
    let frames = summary["frames"].as_array().unwrap();
    assert_eq!(frames.len(), FRAMES);
    for (t, frame) in frames.iter().enumerate() {
        assert_eq!(frame["file"], format!("{:06}", 2 * t));
        assert!((frame["time"].as_f64().unwrap() - 2.0 * t as f64).abs() < 1e-3, "{frame}");
        assert!(frame["psnr"].as_f64().unwrap() > 25.0, "{frame}");
        assert!(dive.path(&format!("packets/{:06}.nvsp", 2 * t)).is_file());
    }
    assert_eq!(frames[0]["start"], "external");
    // The same by the poses' times, in place of numbers.
    let by_time: String =
        (0..FRAMES).zip(rows.lines()).map(|(t, row)| format!("{}{}\n", 2 * t, &row[6..])).collect();
    std::fs::write(dive.path("times.csv"), format!("time,qw,qx,qy,qz,tx,ty,tz\n{by_time}"))
        .unwrap();
    dive.run(&format!("{fixed} --video dive.mp4 --fps 0.5 --starts times.csv --limit {FRAMES}"))
        .ends_with(0);
    for (known, frame) in frames.iter().zip(dive.json("summary.json")["frames"].as_array().unwrap())
    {
        assert_eq!((&known["start"], &known["bytes"]), (&frame["start"], &frame["bytes"]));
    }
    // The lens is the camera file's, or the prior's.
    let lensless = "encode --video dive.mp4 --starts starts.csv --fps 0.5 --limit 1 --packets";
    dive.run(&format!("{lensless} p --prior prior.ply")).ends_with(1).says("it states no lens");
    let known = Prior::open(&dive.path("prior.ply"), &Default::default()).unwrap();
    let Camera { width, height, fx, fy, cx, cy } = CAMERA;
    let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(f64::from);
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
    let lens = Lens::new(intrinsics, Distortion::None).ok();
    let extras = Extras { lens, ..Extras::default() };
    let beside = extras_file::to_bytes(&extras, known.id(), known.len());
    std::fs::write(dive.path("prior.ply.nvsx"), beside).unwrap();
    dive.run(&format!("{lensless} p --prior prior.ply")).ends_with(0);
    dive.run(&format!("{lensless} q --prior prior.ply --cameras cameras.json")).ends_with(0);
    assert_eq!(dive.bytes("p/000000.nvsp"), dive.bytes("q/000000.nvsp"));
    dive.run("encode --prior prior.ply --packets p").ends_with(2).says("--cameras");
}

#[test]
fn a_video_of_another_shape_than_the_lens_is_refused() {
    let dive = Dive::new();
    video(&dive, "dive.mp4", pictures(), 1);
    let mut cameras = dive.json("cameras.json");
    cameras["height"] = (CAMERA.height * 2).into();
    dive.write_json("cameras.json", &cameras);
    let args = "encode --prior prior.ply --cameras cameras.json --packets packets --overwrite --video dive.mp4";
    dive.run(args).ends_with(1).says("dive.mp4: 160×90 is of another shape");
}
