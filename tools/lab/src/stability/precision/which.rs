//! The priors that are measured on, each as a camera sees it.

use nvsprior::prior::Splats;
use nvsprior::{Camera, Pose, Prior, RenderOverrides};

use crate::stability::case::Bench;
use crate::stability::scenes::{self, cloud};

/// A prior as a camera sees it.
pub struct PriorView {
    pub prior: Prior,
    pub camera: Camera,
    pub pose: Pose,
}

#[derive(Clone, Copy)]
pub enum Which {
    Random,
    Moved,
    Given,
}

impl Which {
    pub fn name(self) -> &'static str {
        match self {
            Which::Random => "random",
            Which::Moved => "random, moved by 1e6",
            Which::Given => "given prior",
        }
    }

    pub fn seen(self, bench: &Bench) -> anyhow::Result<PriorView> {
        let camera = scenes::camera(160, 90);
        let splats = || -> Splats {
            let mut splats = cloud(40, 3_000, 3);
            splats.log_scales.iter_mut().flatten().for_each(|s| *s -= 0.7);
            splats
        };
        match (self, &bench.prior) {
            (Which::Given, Some(path)) => {
                let prior = Prior::open(path, &RenderOverrides::default())?;
                let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
                let away = 3.0 * f64::from(prior.coordinate_frame().spread);
                let translation = glam::DVec3::new(0.0, 0.0, away) - centre;
                Ok(PriorView { prior, camera, pose: Pose { translation, ..Pose::IDENTITY } })
            }
            (Which::Moved, _) => {
                let mut splats = splats();
                // So far that an f32 tells only sixteenths apart. The prior's own positions are rounded there, so the
                // twin sees them rounded too.
                splats.positions.iter_mut().for_each(|p| p[0] += 1e6);
                let pose = scenes::pose();
                let away = pose.rotation * glam::DVec3::new(-1e6, 0.0, 0.0);
                let pose = Pose { translation: pose.translation + away, ..pose };
                Ok(PriorView { prior: scenes::prior(splats)?, camera, pose })
            }
            _ => Ok(PriorView { prior: scenes::prior(splats())?, camera, pose: scenes::pose() }),
        }
    }
}
