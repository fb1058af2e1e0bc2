//! A small scene with relief and texture at several scales, and frames of it, for the tests of
//! encoder, decoder and command line.
#![allow(dead_code)] // Each test file uses its own part.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use nvsprior::prior::Splats;
use nvsprior::render::{Plan, Scene};
use nvsprior::{Camera, Engine, Picture, Pose, Prior, RenderOptions};

use crate::common::{Random, engine};

pub const CAMERA: Camera =
    Camera { width: 160, height: 90, fx: 130.0, fy: 130.0, cx: 80.0, cy: 45.0 };

/// A number in [0, 1) from an index.
fn noise(index: u64) -> f32 {
    Random::at(index).within(0.0, 1.0)
}

/// A wall of 80 × 60 splats with relief, at z ≈ 4; `seed` changes its colours.
pub fn wall(seed: u64) -> Prior {
    let (columns, rows) = (80, 60);
    let mut splats = Splats::default();
    for i in 0..columns * rows {
        let (x, y) = ((i % columns) as f32 * 0.1 - 4.0, (i / columns) as f32 * 0.1 - 3.0);
        let relief = 0.4 * (1.3 * x).sin() * (1.7 * y).cos();
        splats.positions.push([x, y, 4.0 + relief]);
        splats.log_scales.push([-2.6, -2.6, -5.0]);
        splats.rotations.push([1.0, 0.0, 0.0, 0.0]);
        splats.opacity_logits.push(3.0);
        for channel in 0..3 {
            let patch = (i / columns / 6 * 20 + i % columns / 6) as u64;
            let coarse = noise(seed * 1000 + patch * 3 + channel);
            let fine = noise(seed * 7777 + i as u64 * 3 + channel);
            splats.sh.push((0.6 * coarse + 0.4 * fine - 0.5) * 3.0);
        }
    }
    Prior::from_splats(splats, RenderOptions::INRIA).unwrap()
}

/// The wall, and a chequered box before it.
pub fn wall_with_box(seed: u64) -> Prior {
    let mut splats = wall(seed).splats().clone();
    for k in 0..12 * 9 {
        let (x, y) = (k % 12, k / 12);
        splats.positions.push([-0.6 + 0.1 * x as f32, -0.4 + 0.1 * y as f32, 3.2]);
        splats.log_scales.push([-2.6, -2.6, -5.0]);
        splats.rotations.push([1.0, 0.0, 0.0, 0.0]);
        splats.opacity_logits.push(4.0);
        let light = if (x / 4 + y / 3) % 2 == 0 { 1.4 } else { -1.4 };
        splats.sh.extend([light, -light, 0.9]);
    }
    Prior::from_splats(splats, RenderOptions::INRIA).unwrap()
}

/// The engine of this process, and a prior on its device.
pub fn on_device(prior: &Prior) -> (Engine, Arc<Scene>) {
    let engine = engine();
    let scene = engine.upload(prior).unwrap();
    (engine, scene)
}

/// The pose of frame `t` of a slow dive along the wall.
pub fn pose(t: f64) -> Pose {
    Pose::IDENTITY.stepped(&[0.05 * t, -0.02 * t, 0.01 * t, 0.004 * t, 0.006 * t, -0.003 * t])
}

/// The scene as the camera sees it, with a little noise.
pub fn clean_frame(engine: &Engine, scene: &Arc<Scene>, pose: &Pose) -> Picture {
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    let mut renderer = engine.renderer(scene, &CAMERA, Plan::picture()).unwrap();
    renderer.picture(pose, &mut picture).unwrap();
    for (i, value) in picture.data.iter_mut().enumerate() {
        *value = value.saturating_add((noise(i as u64) * 4.0) as u8);
    }
    picture
}

/// As [`clean_frame`], with a patch that the prior does not know. It moves the best pose a little.
pub fn frame(engine: &Engine, scene: &Arc<Scene>, pose: &Pose) -> Picture {
    let mut picture = clean_frame(engine, scene, pose);
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i / 3 % 160, i / 3 / 160);
        if (30..50).contains(&x) && (20..40).contains(&y) {
            *value = value.saturating_add(60);
        }
    }
    picture
}

pub fn write_prior(path: &Path, prior: &Prior) {
    let mut bytes = Vec::new();
    let (splats, options, key_frames) = (prior.splats(), prior.options(), prior.key_frames());
    let preprocessing = prior.preprocessing();
    nvsprior::prior::ply::write_ply(splats, options, key_frames, preprocessing, &mut bytes)
        .unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// How far the wall's corners and centre move between two poses, pixels. (Poses themselves are a
/// poor measure: in front of a wall, a shift and a turn look nearly the same.)
pub fn pose_error(a: &Pose, b: &Pose) -> f64 {
    let at = |pose: &Pose, p: DVec3| {
        let c = pose.rotation * p + pose.translation;
        c.truncate() / c.z * f64::from(CAMERA.fx)
    };
    let points = [(0.0, 0.0), (-2.0, -1.0), (2.0, -1.0), (-2.0, 1.0), (2.0, 1.0)];
    let moved = points.map(|(x, y)| DVec3::new(x, y, 4.0)).map(|p| (at(a, p) - at(b, p)).length());
    moved.into_iter().fold(0.0, f64::max)
}
