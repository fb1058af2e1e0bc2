//! `nvsprior encode`: what it writes, at every kind of rate, from every kind of start.

use serde_json::{Value, json};

use crate::dive::{Dive, FRAMES, INPUT, name, pictures, save};
use crate::scene::{CAMERA, pose};

/// Bytes of the first packet's latent part, of the other packets' latent part, and of the session part that the first
/// packet carries too.
const LATENT: u64 = 24;
const SHORT_LATENT: u64 = 20;
const SESSION_PART: u64 = 25;

fn frames(summary: &Value) -> &[Value] {
    summary["frames"].as_array().unwrap()
}

fn packet(dive: &Dive, t: usize) -> Vec<u8> {
    dive.bytes(&format!("packets/{t}.nvsp"))
}

#[test]
fn a_dive_is_encoded_and_decoded_by_two_processes() {
    let dive = Dive::new();
    let summary = dive.encode(
        "--optimizer gauss-newton --quality 10 --threshold 1 --frames-out seen --sheet sheet.png",
    );
    check_summary(&dive, &summary);
    dive.run("decode --prior prior.ply --packets packets --overwrite --frames topside")
        .ends_with(0);
    for (t, row) in frames(&summary).iter().enumerate() {
        let decoded = dive.picture(&format!("topside/{t}.png"));
        assert_eq!(decoded, dive.picture(&format!("seen/{t}.png")), "frame {t}");
        let psnr = decoded.psnr(&pictures()[t]);
        assert!((psnr - row["psnr"].as_f64().unwrap()).abs() < 1e-9, "frame {t}: {psnr} dB");
        assert!(psnr > 30.0, "frame {t}: {psnr} dB");
    }
    assert!(!dive.path("topside/3.png").exists(), "a frame of another split");
    let sheet = dive.picture("sheet.png");
    let gap = 4;
    let width = 4 * (CAMERA.width + gap) + gap;
    assert_eq!((sheet.width, sheet.height), (width, 3 * (CAMERA.height + gap) + gap));
}

/// Names, order and figures of the frames, and their means.
fn check_summary(dive: &Dive, summary: &Value) {
    let rows = frames(summary);
    assert_eq!(rows.len(), FRAMES);
    for (t, row) in rows.iter().enumerate() {
        assert_eq!(row["file"], name(t));
        assert_eq!(row["bytes"], packet(dive, t).len());
        assert_eq!(row["latent_bytes"], if t == 0 { LATENT } else { SHORT_LATENT });
        assert!(row["psnr"].as_f64() > row["render_psnr"].as_f64());
        assert_eq!(row["start"], ["external", "previous", "predicted"][t]);
        assert_eq!((&row["certain"], &row["lost_frames"]), (&Value::Bool(true), &json!(0)));
        assert_eq!(row["time"], Value::Null);
    }
    for figure in ["bytes", "latent_bytes", "render_psnr", "psnr", "full_renders", "milliseconds"] {
        let values = rows.iter().map(|row| row[figure].as_f64().unwrap());
        let mean = values.clone().sum::<f64>() / FRAMES as f64;
        assert!((summary["mean"][figure].as_f64().unwrap() - mean).abs() < 1e-9, "{figure}");
        assert!(values.into_iter().all(|v| v > 0.0), "{figure}");
    }
    assert_eq!(summary["mean"]["certain"], 1.0);
}

#[test]
fn the_same_frames_give_the_same_packets() {
    let dive = Dive::new();
    dive.encode("");
    let whole: Vec<_> = (0..FRAMES).map(|t| packet(&dive, t)).collect();
    std::fs::remove_dir_all(dive.path("packets")).unwrap();
    let summary = dive.encode("--limit 2");
    assert_eq!(frames(&summary).len(), 2);
    assert_eq!([packet(&dive, 0), packet(&dive, 1)], whole[..2]);
    assert!(!dive.path("packets/2.nvsp").exists());
}

#[test]
fn a_budget_is_never_exceeded() {
    let dive = Dive::new();
    for budget in [49, 300] {
        let summary = dive.encode(&format!("--bytes {budget}"));
        for (t, row) in frames(&summary).iter().enumerate() {
            assert!(packet(&dive, t).len() <= budget, "frame {t} at {budget}");
            assert!(row["rate_kept"].is_boolean());
        }
    }
}

#[test]
fn a_wanted_psnr_is_reached_at_fewer_bytes_than_a_higher_one() {
    let dive = Dive::new();
    let mut bytes = Vec::new();
    for wanted in [36.0, 41.0] {
        let summary = dive.encode(&format!("--psnr {wanted}"));
        for row in frames(&summary) {
            assert_eq!(row["rate_kept"], true, "{row}");
            assert!(row["psnr"].as_f64().unwrap() >= wanted, "{row}");
        }
        bytes.push(summary["mean"]["bytes"].as_f64().unwrap());
    }
    assert!(bytes[0] < bytes[1], "{bytes:?}");
}

#[test]
fn without_residual_a_packet_is_a_pose_and_the_first_one_a_camera_too() {
    let dive = Dive::new();
    let summary = dive.encode("--residual none");
    let bytes: Vec<_> = frames(&summary).iter().map(|row| row["bytes"].as_u64().unwrap()).collect();
    assert_eq!(bytes, [LATENT + SESSION_PART, SHORT_LATENT, SHORT_LATENT]);
}

/// A row of poses.csv.
fn row(t: usize) -> String {
    let pose = pose(t as f64);
    let ([w, x, y, z], p) = (pose.wxyz(), pose.translation);
    format!("{},{w},{x},{y},{z},{},{},{}", name(t), p.x, p.y, p.z)
}

#[test]
fn without_any_pose_the_first_frame_is_named() {
    let dive = Dive::new();
    let encode = format!("encode {INPUT} --packets p --overwrite --starts none");
    dive.run(&encode).ends_with(1).says("images/0.png").says("no pose to start from");
}

/// The table marks them, the summary tells them and their share.
#[test]
fn frames_that_are_not_certain_are_told() {
    let dive = Dive::new();
    // Of the later frames nothing is to be seen.
    for index in 1..FRAMES {
        let path = dive.path(&format!("images/{index}.png"));
        let size = image::image_dimensions(&path).unwrap();
        image::RgbImage::from_pixel(size.0, size.1, image::Rgb([110; 3])).save(&path).unwrap();
    }
    let args = "--packets p --overwrite --residual none --summary summary.json";
    let table = dive.run(&format!("encode {INPUT} {args}")).ends_with(0).stdout;
    let marked: Vec<_> = table.lines().map(|line| line.contains("NOT CERTAIN")).collect();
    assert_eq!(marked[..=FRAMES], [false, false, true, true], "{table}");
    assert!(table.contains("not certain: 2 of 3 frames"), "{table}");
    let summary = dive.json("summary.json");
    let told = |row: &Value| (row["certain"].as_bool(), row["lost_frames"].as_u64());
    let told: Vec<_> = frames(&summary).iter().map(told).collect();
    assert_eq!(told, [(Some(true), Some(0)), (Some(false), Some(1)), (Some(false), Some(2))]);
    assert!((summary["mean"]["certain"].as_f64().unwrap() - 1.0 / 3.0).abs() < 1e-12);
}

/// As OpenCV's order in memory, taken for RGB, makes them.
#[test]
fn frames_with_red_and_blue_exchanged_are_told_once() {
    let dive = Dive::new();
    let encode = format!("encode {INPUT} --packets p --overwrite --starts camera-file");
    let told = |run: String| run.matches("red and blue exchanged").count();
    assert_eq!(told(dive.run(&encode).ends_with(0).stderr), 0);
    for (t, picture) in pictures().iter().enumerate() {
        let mut exchanged = picture.clone();
        exchanged.data.chunks_exact_mut(3).for_each(|pixel| pixel.reverse());
        save(&exchanged, &dive.path(&format!("images/{t}.png")));
    }
    let run = dive.run(&encode).ends_with(0).says("images/0.png: fits the prior much better");
    assert_eq!(told(run.stderr), 1);
}

/// Gives the camera file's frames these times.
fn set_times(dive: &Dive, times: [f64; FRAMES]) {
    let mut cameras = dive.json("cameras.json");
    for image in cameras["images"].as_array_mut().unwrap() {
        let index = image["index"].as_u64().unwrap() as usize;
        if let Some(time) = times.get(index) {
            image["time"] = json!(time);
        }
    }
    dive.write_json("cameras.json", &cameras);
}

#[test]
fn times_come_from_the_csv_file_or_the_camera_file_and_do_not_go_back() {
    let dive = Dive::new();
    let times = |dive: &Dive, args: &str| -> Vec<_> {
        let summary = dive.encode(&format!("--residual none {args}"));
        frames(&summary).iter().map(|row| row["time"].as_f64()).collect()
    };
    let header = "file,qw,qx,qy,qz,tx,ty,tz,time,age,srx,sry,srz,sax,say,saz";
    let write = |times: [&str; 2]| {
        let [first, last] = times;
        let rows = [
            format!("{},{first},0.1,0.01,0.01,0.01,0.5,0.5,0.5", row(0)),
            format!("{},{last},,,,,,,", row(2)),
        ];
        std::fs::write(dive.path("poses.csv"), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
    };
    write(["7", "7.5"]);
    assert_eq!(times(&dive, "--starts poses.csv"), [Some(7.0), None, Some(7.5)]);
    let encode = format!("encode {INPUT} --packets none --overwrite --starts poses.csv");
    write(["7", "6.5"]);
    dive.run(&encode).ends_with(1).says("images/2.png: its time, 6.5 s").says("images/0.png, 7 s;");
    write(["7", "soon"]);
    dive.run(&encode).ends_with(1).says("poses.csv: row 2: time");
    assert!(!dive.path("none").exists(), "no work was done");
    // The camera file's own come first.
    write(["9", "1"]);
    set_times(&dive, [1.0, 1.5, 2.0]);
    assert_eq!(times(&dive, "--starts poses.csv"), [1.0, 1.5, 2.0].map(Some));
    set_times(&dive, [1.0, 0.5, 2.0]);
    dive.run(&encode).ends_with(1).says("images/1.png: its time, 0.5 s");
}

#[test]
fn tracks_are_written_and_read_again() {
    let dive = Dive::new();
    set_times(&dive, [1.0, 1.5, 2.0]);
    let summary = dive.encode("--residual none --track vehicle.csv");
    let rows = |name: &str| -> Vec<Vec<String>> {
        let text = String::from_utf8(dive.bytes(name)).unwrap();
        text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
    };
    let own = rows("vehicle.csv");
    let header = "file,time,qw,qx,qy,qz,tx,ty,tz,srx,sry,srz,sax,say,saz";
    assert_eq!(own[0].join(","), header);
    assert_eq!(own.len(), 1 + FRAMES);
    for (row, frame) in own[1..].iter().zip(frames(&summary)) {
        assert_eq!(
            (&row[0], row[1].parse().ok()),
            (&frame["file"].as_str().unwrap().to_owned(), frame["time"].as_f64())
        );
        assert_eq!(frame["position_known"], json!(frame["certain"].as_bool().unwrap()));
        for (axis, stated) in frame["pose_deviation"].as_array().unwrap().iter().enumerate() {
            let unit = if axis < 3 { 1.0 } else { 1f64.to_radians() };
            let read = row[9 + axis].parse::<f64>().unwrap() * unit;
            assert!(
                (read - stated.as_f64().unwrap_or(f64::INFINITY)).abs() < 1e-9
                    || read.is_infinite()
            );
        }
    }
    // It says what `--starts` reads.
    let again = dive.encode("--residual none --starts vehicle.csv");
    assert!(frames(&again).iter().all(|frame| frame["certain"] == json!(true)));
    let decode = "decode --prior prior.ply --packets packets --overwrite --frames topside --cameras cameras.json";
    dive.run(&format!("{decode} --track topside.csv")).ends_with(0);
    let told = rows("topside.csv");
    assert_eq!(told[0].join(","), "file,time,qw,qx,qy,qz,tx,ty,tz,known,known_angle");
    for (t, (row, frame)) in told[1..].iter().zip(frames(&again)).enumerate() {
        let known = frame["known_within"].as_array();
        let number = |of: Option<&Value>| of.and_then(Value::as_f64);
        let (position, angle) = (known.map(|known| &known[0]), known.map(|known| &known[1]));
        assert_eq!((row[0].clone(), row[1].as_str()), (t.to_string(), ""));
        assert_eq!(row[9].parse().ok(), number(position));
        let degrees = number(angle).map(|v| format!("{:.9}", v.to_degrees()));
        assert_eq!(row[10].parse::<f64>().ok().map(|v| format!("{v:.9}")), degrees);
    }
    dive.run(&format!("{decode} --track topside.txt")).ends_with(2).says("must end in .csv");
    let known = nvsprior_inputs::frame_file::read_known(&dive.path("topside.csv")).unwrap();
    assert_eq!(known.len(), FRAMES);
}

#[test]
fn frames_of_a_stream_are_predicted_from_frames_and_say_so() {
    let dive = Dive::new();
    // The camera stands still.
    (1..FRAMES).for_each(|t| save(&pictures()[0], &dive.path(&name(t))));
    let alone = dive.encode("--quality 70");
    assert!(frames(&alone).iter().all(|row| row["reference"] == Value::Null));
    let stream = "--quality 70 --mode stream:2 --pictures seen";
    let summary = dive.encode(stream);
    let references: Vec<_> = frames(&summary).iter().map(|row| row["reference"].clone()).collect();
    assert_eq!(references, [Value::Null, json!(0), Value::Null]);
    let bytes = |summary: &Value| frames(summary)[1]["bytes"].as_u64();
    assert!(bytes(&summary) < bytes(&alone));
    let decode = "decode --prior prior.ply --packets packets --overwrite --frames topside --cameras cameras.json";
    dive.run(decode).ends_with(0);
    for t in 0..FRAMES {
        assert_eq!(dive.bytes(&format!("topside/{t}.png")), dive.bytes(&format!("seen/{t}.png")));
    }
    // Without the first packet, the second is the render alone; the third is an intra frame.
    std::fs::remove_file(dive.path("packets/0.nvsp")).unwrap();
    dive.run(decode)
        .ends_with(0)
        .says("is predicted from that of frame 0")
        .says("the render alone");
    assert_ne!(dive.bytes("topside/1.png"), dive.bytes("seen/1.png"));
    assert_eq!(dive.bytes("topside/2.png"), dive.bytes("seen/2.png"));
}
