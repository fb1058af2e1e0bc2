//! Camera files and pictures of every kind.

use image::imageops::FilterType;
use nvsprior::{Camera, Picture, Pose};
use serde_json::{Value, json};

use crate::dive::{Dive, camera_file, pictures, save, view};
use crate::scene::{CAMERA, pose};

/// The dive at four times the size.
const LARGE: Camera =
    Camera { width: 640, height: 360, fx: 520.0, fy: 520.0, cx: 320.0, cy: 180.0 };

fn large(t: usize) -> Picture {
    let small = &pictures()[t];
    let image = image::RgbImage::from_raw(CAMERA.width, CAMERA.height, small.data.clone()).unwrap();
    let (width, height) = (LARGE.width, LARGE.height);
    let image = image::imageops::resize(&image, width, height, FilterType::CatmullRom);
    Picture::from_rgb(width, height, image.into_raw()).unwrap()
}

/// OpenGL camera-to-world: the axes y and z of the camera turned round.
fn opengl(pose: &Pose) -> Value {
    let inverse = pose.inverse();
    let (m, t) = (inverse.matrix(), inverse.translation);
    let row = |i: usize| {
        let r = m.row(i);
        [r.x, -r.y, -r.z, t[i]]
    };
    json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

#[test]
fn nerfstudio_scenes_are_reduced_to_the_width_asked_for() {
    let dive = Dive::new();
    for t in 0..2 {
        save(&large(t), &dive.path(&format!("images/large{t}.jpg")));
    }
    // The second name has no ending, as nerfstudio writes it at times.
    let names = ["images/large0.jpg", "images/large1"];
    let frame =
        |t: usize| json!({"file_path": names[t], "transform_matrix": opengl(&pose(t as f64))});
    let transforms = json!({
        "w": LARGE.width, "h": LARGE.height, "fl_x": LARGE.fx, "fl_y": LARGE.fy,
        "cx": LARGE.cx, "cy": LARGE.cy, "k1": 0.0, "frames": [frame(0), frame(1)]
    });
    dive.write_json("transforms.json", &transforms);
    let encode = "encode --prior prior.ply --cameras transforms.json --summary s.json";
    dive.run(&format!("{encode} --packets packets --overwrite --pictures seen")).ends_with(0);
    for t in 0..2 {
        let seen = dive.picture(&format!("seen/large{t}.png"));
        assert_eq!((seen.width, seen.height), (320, 180));
        let summary = dive.json("s.json");
        assert!(summary["frames"][t]["render_psnr"].as_f64().unwrap() > 25.0, "{summary}");
    }
    dive.run("decode --prior prior.ply --packets packets --overwrite --frames out").ends_with(0);
    assert_eq!(dive.picture("out/large1.png"), dive.picture("seen/large1.png"));
    // A topside that missed the camera takes it from the file, reduced in the same way.
    std::fs::remove_file(dive.path("packets/large0.nvsp")).unwrap();
    dive.run("decode --prior prior.ply --packets packets --overwrite --frames late --cameras transforms.json")
        .ends_with(0);
    assert_eq!(dive.bytes("late/large1.png"), dive.bytes("out/large1.png"));
    dive.run(&format!("{encode} --packets full --overwrite --pictures full --width 0 --limit 1"))
        .ends_with(0);
    assert_eq!(dive.picture("full/large0.png").width, LARGE.width);
}

#[test]
fn jpeg_and_webp_frames_are_read_and_equal_stems_stay_apart() {
    let dive = Dive::new();
    let files = ["a/0.jpg", "b/0.webp"];
    let mut views = Vec::new();
    for (t, file) in files.into_iter().enumerate() {
        std::fs::create_dir(dive.path(&file[..1])).unwrap();
        save(&pictures()[t], &dive.path(file));
        views.push(view(file, t, "mixed", &pose(t as f64)));
    }
    dive.write_json("mixed.json", &camera_file(&CAMERA, views));
    dive.run("encode --prior prior.ply --cameras mixed.json --packets packets --overwrite --pictures seen")
        .ends_with(0);
    for (t, name) in ["a_0", "b_0"].into_iter().enumerate() {
        assert!(dive.path(&format!("packets/{name}.nvsp")).exists());
        let psnr = dive.picture(&format!("seen/{name}.png")).psnr(&pictures()[t]);
        assert!(psnr > 28.0, "{name}: {psnr} dB");
    }
}

#[test]
fn a_check_reads_all_and_trains_nothing() {
    let dive = Dive::new();
    let check = "map --check --cameras cameras.json";
    let run = dive.run(check).ends_with(0);
    assert!(run.stdout.contains("train on") && run.stdout.contains("lens"), "{}", run.stdout);
    let transparent = image::RgbaImage::from_pixel(160, 90, image::Rgba([9, 9, 9, 0]));
    transparent.save(dive.path("images/0.png")).unwrap();
    assert!(dive.run(check).ends_with(0).stdout.contains("1: parts"));
    std::fs::write(dive.path("images/1.png"), b"no picture").unwrap();
    let run = dive.run(check).ends_with(1).says("1 of ");
    assert!(run.stdout.contains("images/1.png"), "{}", run.stdout);
    let run = dive.run("map --check images").ends_with(1).says("images/1.png");
    assert!(run.stdout.is_empty(), "{}", run.stdout);
    std::fs::remove_file(dive.path("images/1.png")).unwrap();
    assert!(dive.run("map --check images").ends_with(0).stdout.contains("without poses"));
    assert!(!dive.path("checked.nvsg").exists());
}

#[test]
fn a_folder_of_priors_is_looked_through() {
    let dive = Dive::without_frames();
    std::fs::create_dir_all(dive.path("site/deep")).unwrap();
    dive.run("import prior.ply --out site/deep/same.nvsg").ends_with(0);
    std::fs::copy(dive.path("prior.ply"), dive.path("site/a.ply")).unwrap();
    let one = dive.run("inspect prior.ply").ends_with(0).stdout;
    let identity = one.lines().find_map(|line| line.strip_prefix("identity")).unwrap().trim();
    let all = dive.run("inspect site").ends_with(0).stdout;
    assert_eq!(all.matches(identity).count(), 2, "{all}");
    std::fs::write(dive.path("site/b.ply"), "version https://git-lfs.github.com/spec/v1\n")
        .unwrap();
    let run = dive.run("inspect site").ends_with(1).says("1 of 3 scenes");
    assert!(run.stdout.contains("git lfs pull"), "{}", run.stdout);
    std::fs::create_dir(dive.path("empty")).unwrap();
    dive.run("inspect empty").ends_with(1).says("empty: no scene");
}
