//! Priors in other containers against the same scenes as plain PLY files. What a compact prior loses in pictures. Key
//! frames in every container. The first two need the data beside the project.

mod common;

use std::path::PathBuf;

use common::{
    REEF_CAMERA, assert_silent, engine, random_pose, random_prior, reef_file, reef_prior,
};
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{Besides, Extras, KeyFrames, PriorFormat, Splats, ply};
use nvsprior::render::Plan;
use nvsprior::{Camera, Picture, Pose, Prior, RenderOptions, RenderOverrides};

/// Pictures of a prior from some poses.
fn pictures(prior: &Prior, camera: &Camera, poses: &[Pose]) -> Vec<Picture> {
    let engine = engine();
    let scene = engine.upload(prior).unwrap();
    let mut renderer = engine.renderer(&scene, camera, Plan::picture()).unwrap();
    let mut draw = |pose| {
        let mut picture = Picture::new(camera.width, camera.height);
        renderer.picture(pose, &mut picture).unwrap();
        picture
    };
    poses.iter().map(&mut draw).collect()
}

/// Every eighth training frame of the reef set, with its pose.
fn training_frames(cameras: &PathBuf) -> Vec<(Picture, Pose)> {
    let text = std::fs::read_to_string(cameras).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let views = file["images"].as_array().unwrap().iter().filter(|v| v["split"] == "train");
    let read = |view: &serde_json::Value| {
        let file = cameras.with_file_name(view["file"].as_str().unwrap());
        let rgb = image::open(file).unwrap().to_rgb8();
        let q = std::array::from_fn(|i| number(&view["qvec"][i]));
        let t = std::array::from_fn(|i| number(&view["tvec"][i]));
        let frame = Picture::from_rgb(rgb.width(), rgb.height(), rgb.into_raw()).unwrap();
        (frame, Pose::from_wxyz(q, t).unwrap())
    };
    views.step_by(8).map(read).collect()
}

#[test]
fn a_compact_prior_is_an_eighth_and_shows_the_same() {
    let (Some(prior), Some(cameras)) = (reef_prior(), reef_file("cameras.json")) else { return };
    let (frames, poses): (Vec<_>, Vec<_>) = training_frames(&cameras).into_iter().unzip();
    let mut bytes = Vec::new();
    let quantisation = Quantisation::default();
    let (splats, besides) = (prior.splats(), prior.besides());
    let id = compact::write(splats, &besides, &quantisation, &mut bytes).unwrap();
    let small = Prior::from_bytes(&bytes, "reef.nvsg", &RenderOverrides::default()).unwrap();
    assert_eq!((small.id(), small.len()), (id, prior.len()));
    assert!(bytes.len() * 8 <= 104 * prior.len(), "{} bytes", bytes.len());
    let before = pictures(&prior, &REEF_CAMERA, &poses);
    let after = pictures(&small, &REEF_CAMERA, &poses);
    let mut loss = 0.0;
    for ((frame, before), after) in frames.iter().zip(&before).zip(&after) {
        assert!(after.psnr(before) >= 45.0, "{} dB", after.psnr(before));
        loss += (before.psnr(frame) - after.psnr(frame)) / frames.len() as f64;
    }
    println!("{} bytes, {loss:.4} dB lost", bytes.len());
    assert!(loss <= 0.1, "{loss} dB");
    assert_silent(&engine());
}

/// The greatest difference of two sets of splats: positions, scales, rotations, opacities, colours.
fn differences(a: &Splats, b: &Splats) -> [f32; 5] {
    let max = |a: &[f32], b: &[f32]| {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    [
        max(a.positions.as_flattened(), b.positions.as_flattened()),
        max(a.log_scales.as_flattened(), b.log_scales.as_flattened()),
        max(a.rotations.as_flattened(), b.rotations.as_flattened()),
        max(&a.opacity_logits, &b.opacity_logits),
        max(&a.sh, &b.sh),
    ]
}

#[test]
fn other_containers_hold_the_same_scenes() {
    let Some(reef) = reef_file("prior.ply") else { return };
    let folder = reef.parent().unwrap().with_file_name("formats");
    for (packed, plain, format) in [
        ("biker.spz", "biker.ply", PriorFormat::Foreign("SPZ", Some(4))),
        ("guitar.compressed.ply", "guitar.ply", PriorFormat::Foreign("PLY, compressed", None)),
    ] {
        if !folder.join(packed).exists() {
            println!("skipped: {packed} is not here");
            continue;
        }
        let open =
            |name: &str| nvsprior_formats::open(&folder.join(name), &Default::default()).unwrap();
        let (packed, plain) = (open(packed), open(plain));
        assert_eq!(packed.report().format, format);
        let found = differences(packed.splats(), plain.splats());
        println!("{format}: {found:?}");
        assert_eq!(found[0], 0.0);
        assert!(found.iter().all(|difference| *difference <= 1e-6), "{found:?}");
        // From the front, two and a half spreads away.
        let [x, y, z] = plain.coordinate_frame().centre.map(f64::from);
        let away = 2.5 * f64::from(plain.coordinate_frame().spread);
        let pose = Pose::from_wxyz([1.0, 0.0, 0.0, 0.0], [-x, -y, away - z]).unwrap();
        let [a, b] = [&packed, &plain].map(|p| pictures(p, &REEF_CAMERA, &[pose]).swap_remove(0));
        let shown = b.data.iter().filter(|byte| **byte > 0).count();
        assert!(shown > b.data.len() / 100, "{shown} bytes are not black");
        assert!(a.psnr(&b) > 60.0, "{} dB", a.psnr(&b));
    }
    assert_silent(&engine());
}

/// tests/formats has twelve random splats of degree 1, and what PlayCanvas's splat-transform 2.7.1 made of them.
#[test]
fn other_programs_files_are_read_as_they_are_meant() {
    let open = |name: &str| {
        let file = format!("{}/tests/formats/{name}", env!("CARGO_MANIFEST_DIR"));
        nvsprior_formats::open(file.as_ref(), &Default::default()).unwrap()
    };
    let (plain, gltf, sog) = (open("twelve.ply"), open("twelve.glb"), open("twelve.sog"));
    assert_eq!(
        [gltf.report().format, sog.report().format],
        [PriorFormat::Foreign("glTF, binary", None), PriorFormat::Foreign("SOG", Some(2))]
    );
    // Its glTF is turned about z by half a turn. Then y and x of degree 1 change their signs.
    let mut turned = plain.splats().clone();
    for [x, y, _] in &mut turned.positions {
        (*x, *y) = (-*x, -*y);
    }
    // k (w + x i + y j + z k) = -z - y i + x j + w k.
    let about_z = |[w, x, y, z]: [f32; 4]| [-z, -y, x, w];
    turned.rotations.iter_mut().for_each(|q| *q = about_z(*q));
    for sh in turned.sh.chunks_exact_mut(12) {
        sh[3..6].iter_mut().for_each(|v| *v = -*v);
        sh[9..12].iter_mut().for_each(|v| *v = -*v);
    }
    let found = differences(&turned, gltf.splats());
    assert!(found.iter().all(|difference| *difference < 2e-6), "{found:?}");
    // What it makes of its own SOG archive.
    let found = differences(sog.splats(), open("twelve.sog.ply").splats());
    assert!(found.iter().all(|difference| *difference < 2e-6), "{found:?}");
}

#[test]
fn key_frames_go_from_container_to_container() {
    let key_frames = KeyFrames::new((0..50).map(random_pose).collect()).unwrap();
    let prior = random_prior(7, 300, 1);
    let id = prior.id();
    let prior = prior.with_key_frames(key_frames.clone());
    let open = |bytes: &[u8]| Prior::from_bytes(bytes, "prior", &Default::default()).unwrap();
    // As text, bit for bit.
    let mut bytes = Vec::new();
    let (splats, options, none) = (prior.splats(), prior.options(), prior.preprocessing());
    ply::write_ply(splats, options, prior.key_frames(), none, &mut bytes).unwrap();
    let plain = open(&bytes);
    assert_eq!((plain.id(), plain.key_frames()), (id, &key_frames));
    // In ten bytes each: within half a step of the poses' bounds, and 0.28°.
    let (mut bytes, mut without) = (Vec::new(), Vec::new());
    let (splats, besides, q) = (plain.splats(), plain.besides(), Quantisation::default());
    let id = compact::write(splats, &besides, &q, &mut bytes).unwrap();
    let bare = Besides { extras: &Extras::default(), ..besides };
    assert_eq!(compact::write(splats, &bare, &q, &mut without).unwrap(), id);
    assert_eq!(bytes.len(), without.len() + 21 + 28 + 50 * 10);
    let small = open(&bytes);
    assert_eq!(small.id(), id);
    assert_eq!(small.splats(), open(&without).splats());
    let [min, max] = key_frames.bounds().unwrap();
    let limit = 0.51 * (max - min).length() / 65_535.0 + 1e-6;
    for (a, b) in key_frames.poses().iter().zip(small.key_frames().poses()) {
        assert!((a.centre() - b.centre()).length() <= limit, "{a:?} {b:?}");
        assert!(a.angle_to(b).to_degrees() <= 0.28, "{a:?} {b:?}");
    }
    // The device keeps what the file says.
    let scene = engine().upload(&small).unwrap();
    assert_eq!(scene.key_frames(), small.key_frames());
    assert_eq!(scene.id(), id);
    assert!(engine().upload(&open(&without)).unwrap().key_frames().is_empty());
    assert_silent(&engine());
}

#[test]
fn what_people_give_for_a_scene_is_told() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content, told) in [
        (
            "a.ply",
            "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n",
            "git lfs pull",
        ),
        ("b.ply", "<!DOCTYPE html><html></html>", "a web page"),
        ("c.splat", "0123456789012345678901234567890123456789", "a .splat"),
        ("d.ksplat", "\0\0\0\0", "a .ksplat"),
        ("e.bin", "0123", "neither a PLY file"),
        ("f", "", "neither a PLY file"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let error = Prior::open(&path, &RenderOverrides::default()).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(told), "{error}");
    }
}

#[test]
fn a_view_of_which_nothing_is_left_is_told() {
    let wall = |z: f32| {
        let positions = (0..9).map(|i| [(i % 3) as f32 * 0.01, (i / 3) as f32 * 0.01, z]);
        let mut splats = Splats { positions: positions.collect(), ..Splats::default() };
        splats.log_scales = vec![[-5.0; 3]; 9];
        splats.rotations = vec![[1.0, 0.0, 0.0, 0.0]; 9];
        splats.opacity_logits = vec![2.0; 9];
        splats.sh = vec![0.0; 27];
        Prior::from_splats(splats, RenderOptions::INRIA).unwrap()
    };
    let camera = Camera { width: 32, height: 18, fx: 30.0, fy: 30.0, cx: 16.0, cy: 9.0 };
    let near = f64::from(RenderOptions::INRIA.near);
    let is_cut = |z: f64| wall(z as f32).is_cut_by_near_plane(&camera, &Pose::IDENTITY);
    assert!(is_cut(near / 2.0));
    assert!(!is_cut(near * 2.0));
    assert!(!is_cut(-1.0), "nothing is looked at");
}
