//! Tests of scenes that change, on a device. What they share: an engine, random splats, a camera and its poses.

#[cfg(feature = "training")]
mod behind;
mod updates;

use std::sync::OnceLock;

use crate::prior::Splats;
use crate::random::Random;
use crate::vulkan::{DeviceOptions, Error};
use crate::{Camera, Engine, Pose};

const CAMERA: Camera = Camera { width: 61, height: 43, fx: 52.0, fy: 54.0, cx: 30.8, cy: 21.3 };

/// The engine of this process, under the validation layer if that is installed.
fn engine() -> Engine {
    static ENGINE: OnceLock<Engine> = OnceLock::new();
    let open = || {
        let checked = DeviceOptions { validation: true, ..DeviceOptions::default() };
        match Engine::new(&checked) {
            Err(Error::NoValidationLayer) => {
                println!("skipped: validation, as its layer is not installed");
                Engine::new(&DeviceOptions::default()).expect("a Vulkan device")
            }
            engine => engine.expect("a Vulkan device"),
        }
    };
    ENGINE.get_or_init(open).clone()
}

/// Fails if the validation layer had anything to say.
fn assert_silent(engine: &Engine) {
    assert_eq!(engine.validation_messages(), Vec::<String>::new(), "validation messages");
}

/// Splats in front of the camera. Of each coordinate more than half are alike: so the prior's coordinate frame, and
/// with it every rounding, stays as it is when some splats come or go. The first one is the farthest.
fn splats(seed: u64, count: usize, sh_degree: u32) -> Splats {
    let mut random = Random::new(seed);
    let mut splats = Splats { sh_degree, ..Splats::default() };
    for i in 0..count {
        let mut coordinate = |middle: f32, reach: f32| {
            let away = random.within(-reach, reach);
            if random.within(0.0, 1.0) < 0.62 { middle } else { middle + away }
        };
        let position = [coordinate(0.0, 1.5), coordinate(0.0, 1.2), coordinate(4.0, 1.5)];
        splats.positions.push(if i == 0 { [3.0, 2.0, 9.0] } else { position });
        splats.log_scales.push(random.triple(-3.0, -1.2));
        splats.rotations.push(std::array::from_fn(|_| random.within(-1.0, 1.0)));
        splats.opacity_logits.push(random.within(-3.0, 2.0));
        splats.sh.extend(random.triple(-1.5, 1.5));
        let rest = splats.sh_stride() - 3;
        splats.sh.extend(std::iter::repeat_with(|| random.within(-0.25, 0.25)).take(rest));
    }
    splats
}

fn pose(seed: u64) -> Pose {
    let mut random = Random::new(seed ^ 0x706f_7365);
    let [a, b, c] = random.triple(-0.2, 0.2).map(f64::from);
    let [d, e, f] = random.triple(-0.1, 0.1).map(f64::from);
    Pose::exp(&[a, b, c, d, e, f])
}
