//! Stiff poses: views that leave a part of the pose open, or nearly so.

use nvsprior::prior::Splats;
use nvsprior::{Camera, Pose, RenderOptions};
use nvsprior_paper::Optimizer;

use super::case::{Bench, Case, Group, Row};
use super::measure::{Limits, Scenario};
use super::refined::{Refinement, Sought};
use super::scenes::{self, One, Random};

pub const GROUP: Group = Group {
    name: "poses",
    about: "Views whose normal equations are ill-conditioned, or singular, at 160×90; the frame is the \
            prior's own picture. Notes give the condition of JᵀJ (turns in radians, translations in \
            depths of the scene), the standard deviation along the least determined direction, and how \
            many directions count as open: not determined to a tenth of the depth, or of a radian.",
    cases,
};

const FOUND: &str = "gauss-newton finds the picture again, to 40 dB or better, every direction determined; \
                     BFGS ends no worse than it began";
const STIFF: &str = "drawn and differentiated as by the twin; no search ends worse than it began, or \
                     further off than the scene is deep";
const JUMPS: &str = "the picture depends on which of two splats at one depth is drawn first, and the \
                     coarse sort may take others: equations to a tenth; no search ends worse than it began";
const STAYS: &str =
    "the encoder reports open directions, and along them the pose stays at the start";
const EMPTY: &str = "all six directions open; the pose stays at the start exactly";

/// What a case holds beyond what holds of every search.
#[derive(Clone, Copy, PartialEq)]
enum Holds {
    Found,
    Stiff,
    /// As `Stiff`, but depths are equal: the objective has a jump at the true pose.
    Jumps,
    Open,
    Empty,
}

impl Holds {
    fn limits(self) -> Limits {
        let default = Limits::default();
        match self {
            Holds::Jumps => Limits { equations: 0.1, ..default },
            _ => default,
        }
    }
}

fn cases(_: &Bench) -> Vec<Case> {
    let wide = scenes::camera(160, 90);
    let narrow = Camera { fx: 1500.0, fy: 1500.0, ..wide };
    let near = [0.03, -0.02, 0.04, 0.008, -0.01, 0.02];
    let turned = |degrees: f64| [0.0, 0.0, 0.0, 0.0, 0.0, degrees.to_radians()];
    vec![
        case("plane, head on", FOUND, Holds::Found, || plane(4.0, 0.0), wide, near),
        case("plane of equal depths, head on", JUMPS, Holds::Jumps, flat, wide, near),
        case("plane, head on, 6° across", STIFF, Holds::Stiff, || plane(30.0, 0.0), narrow, near),
        case("plane with relief", FOUND, Holds::Found, || plane(4.0, 0.5), wide, near),
        case("far scene, 1e4 units", FOUND, Holds::Found, || plane(1e4, 0.1), wide, near),
        case("one thin pole", STIFF, Holds::Stiff, pole, wide, near),
        case("one thin pole without texture", STAYS, Holds::Open, plain_pole, wide, near),
        case("one visible splat", STAYS, Holds::Open, one_splat, wide, near),
        case(
            "repeated texture, off by a period",
            STIFF,
            Holds::Stiff,
            tiles,
            wide,
            [0.4, 0.0, 0.0, 0.0, 0.0, 0.0],
        ),
        case("round about the axis, rolled by 20°", STAYS, Holds::Open, round, wide, turned(20.0)),
        case("plane, rolled by 15°", FOUND, Holds::Found, || plane(4.0, 0.0), wide, turned(15.0)),
        case("empty view", EMPTY, Holds::Empty, behind, wide, near),
    ]
}

fn case(
    name: &'static str,
    expected: &'static str,
    holds: Holds,
    splats: fn() -> Splats,
    camera: Camera,
    offset: [f64; 6],
) -> Case {
    Case::new(name, expected, move |bench| {
        let prior = nvsprior::Prior::from_splats(splats(), RenderOptions::GSPLAT)?;
        let limits = Limits { twin_searches: false, ..holds.limits() };
        let pose = Pose::IDENTITY;
        let scenario = Scenario { prior, camera, pose, offset, limits, frame: None };
        let mut rows = scenario.run(bench)?;
        let frame = super::refined::picture(bench, &scenario.prior, &camera, &pose)?;
        let start = pose.stepped(&offset);
        let sought = Sought { prior: &scenario.prior, camera, frame: &frame, start };
        for optimizer in [Optimizer::GaussNewton, Optimizer::Bfgs] {
            let (found, mut row) = sought.refine(bench, optimizer)?;
            let holds = match optimizer {
                Optimizer::Bfgs if holds == Holds::Found => Holds::Stiff,
                _ => holds,
            };
            check(&mut row, &sought, &found, holds);
            rows.push(row);
        }
        Ok(rows)
    })
}

fn check(row: &mut Row, sought: &Sought, found: &Refinement, holds: Holds) {
    let open = found.observability.undetermined().count();
    match holds {
        Holds::Stiff | Holds::Jumps => {}
        Holds::Found => {
            let end = row.descent.map_or(f64::NAN, |d| d.end);
            row.expect(end < 1e-4, || format!("error {end:.2e}"));
            row.expect(open == 0, || format!("{open} directions open"));
        }
        Holds::Open => {
            row.expect(open > 0, || "no direction open".into());
            let along = along_open(sought, found);
            row.expect(along < 0.02, || format!("moved by {along:.1e} along open directions"));
        }
        Holds::Empty => {
            row.expect(open == 6, || format!("{open} directions open"));
            row.expect(sought.moved(found) < 1e-6, || "moved".into());
        }
    }
}

/// How far a search went along directions that the picture does not determine, in depths and radians.
fn along_open(sought: &Sought, found: &Refinement) -> f64 {
    let length = found.observability.length.max(f64::MIN_POSITIVE);
    let motion = found.outcome.pose.after(&sought.start.inverse()).log();
    let along = |direction: &[f64; 6]| -> f64 {
        let scaled = |i: usize| if i < 3 { motion[i] / length } else { motion[i] };
        (0..6).map(|i| scaled(i) * direction[i]).sum()
    };
    found.observability.undetermined().map(|d| along(d).abs()).fold(0.0, f64::max)
}

/// Splats on a grid at depth `z`, beyond the picture's edges at 60° across. Colours vary from patch to patch and from
/// splat to splat. The relief is a share of `z`. Each splat lies a little before or behind its neighbours, so that a
/// small turn does not change their order.
pub fn plane(z: f32, relief: f32) -> Splats {
    let (mut random, mut patches) = (Random::new(41), Random::new(43));
    let patches: Vec<f32> = (0..10 * 7 * 3).map(|_| patches.within(-1.0, 1.0)).collect();
    let mut splats = Splats::default();
    let step = 0.02 * z;
    for i in 0..100 * 70 {
        let (column, row) = (i % 100, i / 100);
        let (x, y) = (column as f32 - 49.5, row as f32 - 34.5);
        let raised =
            relief * z * ((0.21 * x).sin() * (0.17 * y).cos()) + random.within(-step, step);
        let patch = 3 * (row / 10 * 10 + column / 10);
        let colour = std::array::from_fn(|k| patches[patch + k] + random.within(-0.7, 0.7));
        let one = One::at([x * step, y * step, z + raised], (0.6 * step).ln());
        scenes::push(&mut splats, One { logit: 3.0, colour, ..one });
    }
    splats
}

/// The plane with all its splats at the same depth. Seen head on, their index decides the order, and the smallest turn
/// changes it.
fn flat() -> Splats {
    let mut splats = plane(4.0, 0.0);
    splats.positions.iter_mut().for_each(|p| p[2] = 4.0);
    splats
}

/// A pole from top to bottom, of these colours from above to below.
fn pole_of(colour: fn(&mut Random) -> [f32; 3]) -> Splats {
    let mut random = Random::new(42);
    scenes::only((0..200).map(|i| {
        let one = One::at([0.3, (i as f32 - 100.0) * 0.05, 5.0], -3.0);
        One { logit: 4.0, colour: colour(&mut random), ..one }
    }))
}

fn pole() -> Splats {
    pole_of(|random| std::array::from_fn(|_| random.within(-1.7, 1.7)))
}

fn plain_pole() -> Splats {
    pole_of(|_| [1.0, 0.6, -0.5])
}

fn one_splat() -> Splats {
    scenes::only([One { logit: 3.0, ..One::at([0.2, -0.1, 5.0], -2.5) }])
}

/// A plane of 20 × 14 equal tiles, each 0.4 units wide.
pub fn tiles() -> Splats {
    let mut splats = Splats::default();
    for i in 0..120 * 84 {
        let (x, y) = (i % 120, i / 120);
        let colour = match (x % 6 < 3, y % 6 < 3) {
            (true, true) => [1.5, 1.2, 0.2],
            (false, false) => [-1.5, -0.5, 0.4],
            _ => [0.1, -1.2, -1.0],
        };
        let step = 0.4 / 6.0;
        // One before the other, the same in every tile, so that no depths tie.
        let raised = 1e-3 * (7 * (x % 6) + 11 * (y % 6)) as f32;
        let at = [(x as f32 - 59.5) * step, (y as f32 - 41.5) * step, 4.0 + raised];
        scenes::push(&mut splats, One { logit: 3.0, colour, ..One::at(at, -3.2) });
    }
    splats
}

/// Round splats, one behind the other on the optical axis, the widest last.
fn round() -> Splats {
    scenes::only((0..10).map(|k| {
        let colour = [1.4 * (k % 3) as f32 - 1.4, 1.2 * (k % 2) as f32 - 0.5, 0.3];
        let at = [0.0, 0.0, 3.0 + 0.3 * k as f32];
        One { logit: 1.0, colour, ..One::at(at, -2.3 + 0.25 * k as f32) }
    }))
}

fn behind() -> Splats {
    scenes::only([One::at([0.0, 0.0, -5.0], -1.0), One::at([1.0, 0.5, -6.0], -1.0)])
}
