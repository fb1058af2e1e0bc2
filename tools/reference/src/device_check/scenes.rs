//! The scenes that devices are compared on.

use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::prior::Splats;
use nvsprior::random::Random;
use nvsprior::render::definition::Definition;
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::search::PoseCode;

use crate::extreme::Extreme;

/// Check sums (CRC-32) of what the host draws of the first scenes; 0 if a scene has no valid splat.
pub const GOLDEN: [u32; 16] = [
    0xd776_8a41,
    0x706a_b901,
    0x9347_5d81,
    0x4c58_fc39,
    0xd065_0db3,
    0x271a_0eb6,
    0x7b29_c2d9,
    0xd5ed_2f62,
    0xd228_5fbc,
    0xdeb9_0d7b,
    0x31fa_1ceb,
    0x4101_06f7,
    0xf6ba_8e3a,
    0xf784_826e,
    0x3398_6637,
    0xa75f_369e,
];

/// A prior, and the camera and pose that it is seen from.
pub struct Scene {
    pub prior: Prior,
    pub camera: Camera,
    pub pose: Pose,
}

impl Scene {
    /// The scene of a seed: even ones are ordinary, odd ones extreme. `None` if all splats are refused.
    pub fn of(seed: u64) -> Option<Scene> {
        if seed.is_multiple_of(2) {
            return Some(Scene::ordinary(seed));
        }
        let Extreme { splats, options, camera, pose, .. } = Extreme::new(seed);
        let prior = Prior::from_splats(splats, options).ok()?;
        Some(Scene { prior, camera, pose })
    }

    /// Some hundred splats of all degrees and sizes in front of a small camera.
    fn ordinary(seed: u64) -> Scene {
        let mut random = Random::new(seed);
        let r = &mut random;
        let mut splats = Splats { sh_degree: (seed / 2 % 4) as u32, ..Splats::default() };
        for _ in 0..1 + r.bits() % 600 {
            let z = r.within(-0.5, 9.0);
            splats.positions.push([
                r.within(-0.8, 0.8) * z.abs(),
                r.within(-0.6, 0.6) * z.abs(),
                z,
            ]);
            splats.log_scales.push(r.triple(-5.5, -1.2));
            splats.rotations.push(std::array::from_fn(|_| r.within(-1.0, 1.0)));
            splats.opacity_logits.push(r.within(-6.0, 7.0));
            splats.sh.extend(r.triple(-1.8, 1.8));
            let rest = splats.sh_stride() - 3;
            splats.sh.extend(std::iter::repeat_with(|| r.within(-0.3, 0.3)).take(rest));
        }
        let options = RenderOptions {
            antialiased: seed / 8 % 2 == 1,
            background: if seed / 16 % 2 == 1 { [0.1, 0.5, 0.9] } else { [0.0; 3] },
            ..if seed / 32 % 2 == 1 { RenderOptions::INRIA } else { RenderOptions::GSPLAT }
        };
        let (width, height) = (8 + (r.bits() % 90) as u32, 8 + (r.bits() % 60) as u32);
        let (w, h) = (width as f32, height as f32);
        let focal = r.within(0.5, 1.5) * w;
        let camera = Camera {
            width,
            height,
            fx: focal,
            fy: focal * r.within(0.9, 1.1),
            cx: 0.5 * w,
            cy: 0.47 * h,
        };
        let step: [f64; 6] = std::array::from_fn(|_| 0.3 * r.even());
        let q = [1.0, step[3], step[4], step[5]];
        let pose = Pose::from_wxyz(q, [step[0], step[1], step[2]]).unwrap_or(Pose::IDENTITY);
        let prior =
            Prior::from_splats(splats, options).unwrap_or_else(|e| panic!("scene {seed}: {e}"));
        Scene { prior, camera, pose }
    }
}

/// The pose as a packet would hold it; `None` if none can.
pub fn code(prior: &Prior, pose: &Pose) -> Option<PoseCode> {
    let quantised = QuantisedPose::quantise(pose, &prior.coordinate_frame(), PoseProfile::Compact);
    quantised.ok().map(|pose| pose.words())
}

/// Check sum of what the host draws of a scene: floats and bytes, at both poses.
pub fn check_sum(seed: u64) -> u32 {
    let Some(scene) = Scene::of(seed) else { return 0 };
    let definition = Definition::new(&scene.prior);
    let drawn = definition.draw(&scene.camera, &scene.pose);
    let coded = code(&scene.prior, &scene.pose).map(|c| definition.draw_coded(&scene.camera, &c));
    let mut check = crc32fast::Hasher::new();
    for drawn in [Some(drawn), coded].into_iter().flatten() {
        drawn.image.iter().for_each(|v| check.update(&v.to_bits().to_le_bytes()));
        check.update(&drawn.rgb8);
    }
    check.finalize()
}
