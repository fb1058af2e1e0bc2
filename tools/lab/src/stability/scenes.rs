//! What the cases are made of: splats, cameras, poses, frames.

use nvsprior::prior::Splats;
use nvsprior::{Camera, Picture, Pose, Prior, RenderOptions};

pub use nvsprior::random::Random;

/// One splat, as files hold it; grey.
#[derive(Clone, Copy)]
pub struct One {
    pub position: [f32; 3],
    pub log_scale: [f32; 3],
    pub rotation: [f32; 4],
    pub logit: f32,
    pub colour: [f32; 3],
}

impl One {
    /// A round splat of a size, half opaque.
    pub fn at(position: [f32; 3], log_scale: f32) -> One {
        let rotation = [1.0, 0.0, 0.0, 0.0];
        One { position, log_scale: [log_scale; 3], rotation, logit: 1.0, colour: [0.8, 0.2, -0.6] }
    }
}

/// Appends a splat; its higher harmonics are zero.
pub fn push(splats: &mut Splats, one: One) {
    splats.positions.push(one.position);
    splats.log_scales.push(one.log_scale);
    splats.rotations.push(one.rotation);
    splats.opacity_logits.push(one.logit);
    splats.sh.extend(one.colour);
    splats.sh.extend(std::iter::repeat_n(0.0, splats.sh_stride() - 3));
}

/// Those splats alone.
pub fn only(all: impl IntoIterator<Item = One>) -> Splats {
    let mut splats = Splats::default();
    all.into_iter().for_each(|one| push(&mut splats, one));
    splats
}

/// `count` splats in front of a camera at the origin, 2 to 8 units away. Each is visible or nearly
/// so. They have every opacity.
pub fn cloud(seed: u64, count: usize, sh_degree: u32) -> Splats {
    let mut random = Random::new(seed);
    let mut splats = Splats { sh_degree, ..Splats::default() };
    for _ in 0..count {
        let z = random.within(2.0, 8.0);
        let (x, y) = (random.within(-0.7, 0.7) * z, random.within(-0.5, 0.5) * z);
        push(
            &mut splats,
            One {
                position: [x, y, z],
                log_scale: std::array::from_fn(|_| random.within(-3.5, -1.2)),
                rotation: std::array::from_fn(|_| random.within(-1.0, 1.0)),
                logit: random.within(-3.0, 6.0),
                colour: std::array::from_fn(|_| random.within(-1.7, 1.7)),
            },
        );
        let rest = splats.sh_stride() - 3;
        let end = splats.sh.len();
        splats.sh[end - rest..].iter_mut().for_each(|v| *v = random.within(-0.25, 0.25));
    }
    splats
}

/// A cloud's splats, and others behind, among or before them.
pub fn with(mut cloud: Splats, all: impl IntoIterator<Item = One>) -> Splats {
    all.into_iter().for_each(|one| push(&mut cloud, one));
    cloud
}

/// A prior on a grey background, as gsplat renders.
pub fn prior(splats: Splats) -> anyhow::Result<Prior> {
    Ok(Prior::from_splats(
        splats,
        RenderOptions { background: [0.25, 0.5, 0.75], ..RenderOptions::GSPLAT },
    )?)
}

/// A camera of about 60° across, its principal point beside the middle.
pub fn camera(width: u32, height: u32) -> Camera {
    let (w, h) = (width as f32, height as f32);
    Camera { width, height, fx: 0.86 * w, fy: 0.88 * w, cx: 0.5 * w + 0.3, cy: 0.5 * h - 0.2 }
}

/// A pose near the origin that looks into the clouds.
pub fn pose() -> Pose {
    Pose::exp(&[0.05, -0.08, 0.1, 0.03, -0.02, 0.04])
}

pub fn noise(seed: u64, camera: &Camera) -> Picture {
    let mut random = Random::new(seed);
    let data = (0..camera.pixels() * 3).map(|_| (random.bits() >> 56) as u8).collect();
    Picture { width: camera.width, height: camera.height, data }
}
