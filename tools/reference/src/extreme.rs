//! Random extreme priors, poses and cameras.

use nvsprior::prior::Splats;
use nvsprior::random::Random;
use nvsprior::{Camera, Pose, RenderOptions};

/// One of `count` numbers from 0 on.
fn below(random: &mut Random, count: u64) -> u64 {
    random.bits() % count
}

/// One of some.
pub fn one_of<T: Copy>(random: &mut Random, all: &[T]) -> T {
    all[below(random, all.len() as u64) as usize]
}

pub struct Extreme {
    pub splats: Splats,
    pub options: RenderOptions,
    pub camera: Camera,
    pub pose: Pose,
    /// The step from the pose to the start of a search.
    pub offset: [f64; 6],
}

impl Extreme {
    pub fn new(seed: u64) -> Extreme {
        let mut random = Random::new(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
        let r = &mut random;
        let count = match below(r, 8) {
            0 => 1,
            1 => 200,
            _ => 1 + below(r, 120),
        };
        // The whole scene may be small, large, or far from its origin.
        let unit = one_of(r, &[1.0, 1.0, 1.0, 1e-3, 1e3, 1e6]);
        let place = one_of(r, &[0.0, 0.0, 0.0, 1e2, 1e4]) * unit;
        let wildness = one_of(r, &[0.0, 0.1, 0.5, 1.0]);
        let mut splats = Splats { sh_degree: below(r, 4) as u32, ..Splats::default() };
        for _ in 0..count {
            push(&mut splats, r, unit, place, wildness);
        }
        Extreme {
            splats,
            options: options(r, unit),
            camera: camera(r),
            pose: pose(r, unit, place),
            offset: offset(r, unit),
        }
    }
}

/// Appends a splat, with a chance of `wildness` that each of its fields is extreme.
fn push(splats: &mut Splats, r: &mut Random, unit: f32, place: f32, wildness: f32) {
    let wild = |r: &mut Random| r.within(0.0, 1.0) < wildness;
    let z = r.within(-1.0, 8.0);
    let spread = 0.7 * z.abs().max(1.0);
    let mut position = [r.within(-spread, spread), r.within(-spread, spread), z];
    if wild(r) {
        position = match below(r, 6) {
            0 => [0.0; 3],
            1 => [0.0, 0.0, r.within(0.009, 0.02)],
            2 => [r.within(-1e6, 1e6), r.within(-1e6, 1e6), r.within(-1e6, 1e6)],
            3 => [0.5, -0.25, 2.0],
            4 => [r.within(-1e15, 1e15), 1.0, 1e15],
            _ => [one_of(r, &[f32::NAN, f32::INFINITY, f32::MAX, f32::MIN_POSITIVE]), 0.0, 3.0],
        };
    }
    splats.positions.push(position.map(|v| v * unit + place));
    let shift = unit.ln();
    let mut scale: [f32; 3] = std::array::from_fn(|_| r.within(-4.0, -1.0));
    if wild(r) {
        let extreme =
            |r: &mut Random| one_of(r, &[-40.0, -20.0, -13.8, -5.0, 0.0, 3.0, 13.8, 20.0, 40.0]);
        scale = std::array::from_fn(|_| extreme(r));
        if below(r, 3) == 0 {
            scale = [scale[0]; 3];
        }
    }
    splats.log_scales.push(scale.map(|v| (v + shift).clamp(-40.5, 40.5)));
    let mut rotation: [f32; 4] = std::array::from_fn(|_| r.within(-1.0, 1.0));
    if wild(r) {
        let length = one_of(r, &[0.0, 1e-7, 1e-5, 1.0, 1e10, 1e30, f32::NAN]);
        rotation = rotation.map(|v| v * length);
    }
    splats.rotations.push(rotation);
    let logit = if wild(r) {
        one_of(r, &[-100.0, -5.537_334, 4.595_12, 100.0, f32::INFINITY, f32::NEG_INFINITY, 0.0])
    } else {
        r.within(-5.0, 8.0)
    };
    splats.opacity_logits.push(logit);
    let loud = if wild(r) { one_of(r, &[0.0, 10.0, 1e3, 1e6, 1e20, f32::MAX]) } else { 1.0 };
    let values = splats.sh_stride();
    splats.sh.extend(
        std::iter::repeat_with(|| r.within(-1.5, 1.5).clamp(-1.0, 1.0) * loud).take(values),
    );
}

fn options(r: &mut Random, unit: f32) -> RenderOptions {
    RenderOptions {
        near: one_of(r, &[0.01, 0.01, 0.2, 1e-3]) * unit,
        alpha_max: one_of(r, &[0.99, 0.99, 0.999, 0.5]),
        antialiased: below(r, 3) == 0,
        background: one_of(r, &[[0.0; 3], [1.0; 3], [0.25, 0.5, 0.75]]),
        trained_focal: None,
    }
}

fn camera(r: &mut Random) -> Camera {
    let side = |r: &mut Random| match below(r, 6) {
        0 => 1 + below(r, 3) as u32,
        1 => one_of(r, &[8, 16, 17, 31, 48]),
        _ => 4 + below(r, 45) as u32,
    };
    let (width, height) = (side(r), side(r));
    let (w, h) = (width as f32, height as f32);
    let focal = match below(r, 8) {
        0 => one_of(r, &[0.02, 0.5, 1e3, 1e5]),
        _ => r.within(0.4, 2.0) * w.max(h),
    };
    let (mut cx, mut cy) = (w * r.within(0.3, 0.7), h * r.within(0.3, 0.7));
    if below(r, 10) == 0 {
        (cx, cy) = (one_of(r, &[-1e3, 0.0, 1e3, 1e6]), one_of(r, &[-50.0, 0.0, 500.0]));
    }
    Camera { width, height, fx: focal, fy: focal * one_of(r, &[1.0, 1.0, 0.9, 20.0]), cx, cy }
}

fn pose(r: &mut Random, unit: f32, place: f32) -> Pose {
    let turn = one_of(r, &[0.0, 0.2, 0.2, 3.0]);
    let shift = one_of(r, &[0.0, 0.3, 0.3, 3.0, 1e3]);
    let mut value = |limit: f32| f64::from(r.within(-1.0, 1.0) * limit);
    let tau = [0, 1, 2, 3, 4, 5].map(|k| value(if k < 3 { shift * unit } else { turn }));
    let aside = Pose::exp(&tau);
    let away = glam::DVec3::splat(-f64::from(place));
    Pose { translation: aside.translation + aside.rotation * away, ..aside }
}

fn offset(r: &mut Random, unit: f32) -> [f64; 6] {
    let far = one_of(r, &[0.0, 0.01, 0.05, 0.5]);
    [0, 1, 2, 3, 4, 5]
        .map(|k| f64::from(r.within(-1.0, 1.0) * far * if k < 3 { unit } else { 1.0 }))
}
