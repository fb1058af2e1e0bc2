//! The prior's unit and origin: metres, millimetres, kilometres; a million units away.

use nvsprior::prior::Splats;
use nvsprior::{Camera, Picture, Pose, Prior, RenderOptions};
use nvsprior_paper::Optimizer;

use super::case::{Bench, Case, Group, Row};
use super::refined::{OPTIMIZERS, Sought, picture};
use super::{poses, scenes};

pub const GROUP: Group = Group {
    name: "units",
    about: "A plane with relief, its unit changed by a factor, its origin moved by so many of those \
            units: the same frame searched for from the same start, at 160×90.",
    cases,
};

const SAME: &str = "the same picture (50 dB), and the pose found in the first unit scaled along, to a \
                    thousandth of the depth and 1e-3 rad";
const FAR: &str = "the pose is found again to a hundredth of the depth, though positions in f32 are \
                   coarser than in the first unit";

const COLLAPSED: &str = "the file cannot hold such a scene: its splats fall together; no search ends worse \
                         than it began";

/// Where the search starts from the true pose, in the first unit.
const OFFSET: [f64; 6] = [0.03, -0.02, 0.04, 0.008, -0.01, 0.02];
/// The scene's depth, in the first unit.
const DEPTH: f64 = 4.0;

/// A unit: the factor of lengths, and how far the origin is moved, in the first unit.
#[derive(Clone, Copy)]
struct Unit {
    factor: f64,
    origin: f64,
}

fn cases(_: &Bench) -> Vec<Case> {
    let mut all: Vec<Case> = [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3]
        .map(|factor| case(format!("× {factor:e}"), SAME, Unit { factor, origin: 0.0 }, 1e-3))
        .into();
    for factor in [1.0, 10.0, 1e3] {
        let name = format!("× {factor:e}, origin 1e6 units away");
        // A step of f32 at a million is 1/16.
        all.push(case(name, FAR, Unit { factor, origin: 1e6 / factor }, 1e-2));
    }
    all.push(Case::new("× 1e-3, origin 1e6 units away", COLLAPSED, collapsed));
    all
}

fn case(name: String, expected: &'static str, unit: Unit, tolerance: f64) -> Case {
    Case::new(name, expected, move |bench| {
        let first = Unit { factor: 1.0, origin: 0.0 };
        let camera = scenes::camera(160, 90);
        let mut rows = Vec::new();
        for optimizer in OPTIMIZERS {
            rows.push(compare(bench, &camera, optimizer, first, unit, tolerance)?);
        }
        Ok(rows)
    })
}

/// The row of an optimiser in a unit, compared with the same optimiser in the first unit.
fn compare(
    bench: &Bench,
    camera: &Camera,
    optimizer: Optimizer,
    first: Unit,
    unit: Unit,
    tolerance: f64,
) -> anyhow::Result<Row> {
    let at_first = first.prior()?;
    let frame = picture(bench, &at_first, camera, &first.pose([0.0; 6]))?;
    let found = |unit: Unit, prior: &Prior| {
        let start = unit.pose(OFFSET);
        Sought { prior, camera: *camera, frame: &frame, start }.refine(bench, optimizer)
    };
    let (one, _) = found(first, &at_first)?;
    let prior = unit.prior()?;
    let (other, mut row) = found(unit, &prior)?;
    let back = unit.back(&other.outcome.pose);
    let off = (back.centre() - one.outcome.pose.centre()).length() / DEPTH;
    let turned = back.angle_to(&one.outcome.pose);
    row.expect(off < tolerance, || format!("{off:.1e} depths off"));
    row.expect(turned < tolerance, || format!("turned by {turned:.1e} rad"));
    let seen: Picture = picture(bench, &prior, camera, &unit.pose([0.0; 6]))?;
    let psnr = seen.psnr(&frame);
    // Moved, the prior itself is rounded.
    row.expect(psnr > 50.0 || unit.origin > 0.0, || format!("its picture is {psnr:.1} dB off"));
    row.note = format!(
        "{}; pose off by {off:.1e} depths, {turned:.1e} rad; picture {psnr:.1} dB",
        row.note
    );
    Ok(row)
}

/// A scene that is smaller than a step of f32 at its place.
fn collapsed(bench: &Bench) -> anyhow::Result<Vec<Row>> {
    let camera = scenes::camera(160, 90);
    let unit = Unit { factor: 1e-3, origin: 1e9 };
    let prior = unit.prior()?;
    let frame = picture(bench, &prior, &camera, &unit.pose([0.0; 6]))?;
    let sought = Sought { prior: &prior, camera, frame: &frame, start: unit.pose(OFFSET) };
    OPTIMIZERS.iter().map(|optimizer| Ok(sought.refine(bench, *optimizer)?.1)).collect()
}

impl Unit {
    fn prior(self) -> anyhow::Result<Prior> {
        let mut splats: Splats = poses::plane(DEPTH as f32, 0.3);
        let scale = |v: f32| ((f64::from(v) + self.origin) * self.factor) as f32;
        for p in &mut splats.positions {
            *p = p.map(scale);
        }
        let grow = self.factor.ln() as f32;
        splats.log_scales.iter_mut().flatten().for_each(|s| *s += grow);
        let near = (f64::from(RenderOptions::GSPLAT.near) * self.factor) as f32;
        Ok(Prior::from_splats(splats, RenderOptions { near, ..RenderOptions::GSPLAT })?)
    }

    /// The pose a step beside the true one, the step in the first unit.
    fn pose(self, step: [f64; 6]) -> Pose {
        let pose = Pose::IDENTITY.stepped(&step);
        let centre = (pose.centre() + glam::DVec3::splat(self.origin)) * self.factor;
        Pose::from_centre(pose.rotation, centre)
    }

    /// A pose of this unit in the first one.
    fn back(self, pose: &Pose) -> Pose {
        let centre = pose.centre() / self.factor - glam::DVec3::splat(self.origin);
        Pose::from_centre(pose.rotation, centre)
    }
}
