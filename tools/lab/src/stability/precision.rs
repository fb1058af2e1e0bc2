//! What f32 loses, by stage, by storage, by the width of keys, by the way of summing.

mod stages;
mod storage;
mod sums;

use nvsprior::prior::Splats;
use nvsprior::{Camera, Pose, Prior, RenderOverrides};

use super::case::{Bench, Case, Group};
use super::scenes::{self, cloud};

pub const GROUP: Group = Group {
    name: "precision",
    about: "The device's f32 against the twin's f64, at 160×90, on 3,000 random splats, the same a \
            million units from the origin, and the prior given by `--prior`, seen from three times its \
            spread away.",
    cases,
};

/// As searches begin with.
const DAMPING: f32 = 1e-3;

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
    fn name(self) -> &'static str {
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

fn cases(bench: &Bench) -> Vec<Case> {
    let mut which = vec![Which::Random, Which::Moved];
    which.extend(bench.prior.is_some().then_some(Which::Given));
    let mut all = Vec::new();
    for which in which {
        all.push(Case::new(
            format!("stages, {}", which.name()),
            "medians of 16 bits right and more in every stage, 12 of the picture's worst pixel but for \
             close decisions",
            move |bench| stages::measure(bench, which),
        ));
        all.push(Case::new(
            format!("f16 storage, {}", which.name()),
            "coefficients and axes in f16 leave 45 dB and more; positions are not asked for any",
            move |bench| storage::measure(bench, which),
        ));
        all.push(Case::new(
            format!("key width, {}", which.name()),
            "two digits of three leave 35 dB and more",
            move |bench| storage::keys(bench, which),
        ));
        all.push(Case::new(
            format!("sums, {}", which.name()),
            "summing tiles in f32 in a fixed order changes the step by less than 1e-3 of it",
            move |bench| sums::measure(bench, which),
        ));
    }
    all
}
