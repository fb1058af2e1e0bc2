//! Optimisers on objectives without a slope, with false ones, and over a long run.

use std::time::Instant;

use nvsprior::prior::Splats;
use nvsprior::tracking::Stop;
use nvsprior::{Encoder, EncoderOptions, Picture, Pose, Prior, RenderOptions};
use nvsprior_paper::Optimizer;

use super::case::{Bench, Case, Done, Group, Row};
use super::refined::{OPTIMIZERS, Sought, picture};
use super::scenes::{self, Random};
use super::{poses, refined};

pub const GROUP: Group = Group {
    name: "optimisers",
    about: "Every optimiser on flat, noisy and deceiving objectives, at 160×90; and runs of a thousand \
            frames, whose last poses are compared with the first.",
    cases,
};

const ENDS: &str = "ends by itself, with a reason, at numbers, no worse than it began";
const NO_DRIFT: &str = "the pose of a frame that comes again is the one found before, to a thousandth \
                        of the depth and 1e-3 rad: nothing adds up over the run";
const STAYS: &str = "the pose stays within a twentieth of the depth, and 0.05 rad, of the first one: what \
                     the picture leaves open does not wander off";

/// What a frame is made of, from the prior's own picture.
type Frame = fn(&mut Picture, &mut Random);

fn cases(bench: &Bench) -> Vec<Case> {
    let noisy = |p: &mut Picture, r: &mut Random| {
        for v in &mut p.data {
            *v = (f32::from(*v) + r.within(-60.0, 60.0)) as u8;
        }
    };
    let noise = |p: &mut Picture, r: &mut Random| {
        p.data.iter_mut().for_each(|v| *v = (r.bits() >> 56) as u8);
    };
    let far = [0.4, -0.3, 0.5, 0.15, -0.1, 0.2];
    let near = [0.03, -0.02, 0.04, 0.008, -0.01, 0.02];
    let textured = || poses::plane(4.0, 0.3);
    let frames = if bench.quick { 60 } else { 1000 };
    vec![
        each("flat: one colour everywhere", one_colour, |_, _| {}, near),
        each("flat: a frame of one colour", textured, |p, _| p.data.fill(120), near),
        each("noisy: ± 60 of 255", textured, noisy, near),
        each("noise alone", textured, noise, near),
        each("wrong valley: far off", textured, |_, _| {}, far),
        each(
            "wrong valley: repeated texture",
            poses::tiles,
            |_, _| {},
            [0.25, 0.2, 0.0, 0.0, 0.0, 0.0],
        ),
        each("at the optimum", textured, |_, _| {}, [0.0; 6]),
        run("a run along a circle", NO_DRIFT, textured, frames, circle, 1e-3),
        run("a run at one place, noisy", NO_DRIFT, textured, frames, |_| Pose::IDENTITY, 1e-3),
        run("a run before one splat", STAYS, lone, frames, |_| Pose::IDENTITY, 0.05),
    ]
}

fn each(name: &'static str, splats: fn() -> Splats, spoil: Frame, offset: [f64; 6]) -> Case {
    Case::new(name, ENDS, move |bench| {
        let camera = scenes::camera(160, 90);
        let prior = Prior::from_splats(splats(), RenderOptions::GSPLAT)?;
        let mut frame = picture(bench, &prior, &camera, &Pose::IDENTITY)?;
        spoil(&mut frame, &mut Random::new(51));
        let start = Pose::IDENTITY.stepped(&offset);
        let sought = Sought { prior: &prior, camera, frame: &frame, start };
        OPTIMIZERS
            .iter()
            .map(|optimizer| ended(bench, &sought, *optimizer))
            .collect::<Result<Vec<_>, _>>()
    })
}

fn ended(bench: &Bench, sought: &Sought, optimizer: Optimizer) -> anyhow::Result<Row> {
    let (found, mut row) = sought.refine(bench, optimizer)?;
    // Adam's thousand epochs are its own end.
    let used_up = found.outcome.stop == Stop::Iterations && optimizer == Optimizer::Bfgs;
    row.expect(!used_up, || "1200 iterations were not enough".into());
    Ok(row)
}

/// Encodes a run of frames with a little noise, along a path of poses. Every twentieth frame shows
/// the first place again.
fn run(
    name: &'static str,
    expected: &'static str,
    splats: fn() -> Splats,
    frames: usize,
    path: fn(f64) -> Pose,
    tolerance: f64,
) -> Case {
    Case::new(name, expected, move |bench| {
        let since = Instant::now();
        let camera = scenes::camera(160, 90);
        let prior = Prior::from_splats(splats(), RenderOptions::GSPLAT)?;
        let scene = bench.engine.upload(&prior)?;
        let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(&bench.engine, &scene, &camera, options)?;
        let mut row = Row::of("gauss-newton", since);
        let (mut first, mut max) = (None, [0.0_f64; 2]);
        let shown: Vec<Picture> = (0..LAP)
            .map(|t| refined::picture(bench, &prior, &camera, &path(t as f64 / LAP as f64)))
            .collect::<anyhow::Result<_>>()?;
        for t in 0..frames {
            let mut frame = shown[t % LAP].clone();
            // The first place looks the same each time. At other places the noise differs.
            let seed = if t % LAP == 0 { 0 } else { t as u64 };
            let mut random = Random::new(seed);
            for v in &mut frame.data {
                *v = (f32::from(*v) + random.within(-8.0, 8.0)) as u8;
            }
            let start = (t == 0).then(|| path(0.0));
            let encoded = encoder.encode(&frame, start)?;
            row.expect(encoded.pose.is_finite(), || format!("frame {t}: no pose"));
            if t > 0 && t % LAP == 0 {
                let before: Pose = *first.get_or_insert(encoded.pose);
                let moved = (encoded.pose.centre() - before.centre()).length() / 4.0;
                max = [max[0].max(moved), max[1].max(encoded.pose.angle_to(&before))];
            }
        }
        let [moved, turned] = max;
        row.expect(moved < tolerance && turned < tolerance, || "drifts".into());
        row.note = format!("{frames} frames; off by {moved:.1e} depths, {turned:.1e} rad at most");
        row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
        Ok(Done::from(vec![row]))
    })
}

/// Frames after which a path comes round.
const LAP: usize = 20;

/// A path around a circle, of one round.
fn circle(share: f64) -> Pose {
    let (s, c) = (std::f64::consts::TAU * share).sin_cos();
    Pose::exp(&[0.3 * (c - 1.0), 0.2 * s, 0.05 * s, 0.02 * s, -0.03 * (c - 1.0), 0.04 * s])
}

fn one_colour() -> Splats {
    let mut splats = poses::plane(4.0, 0.0);
    splats.sh.chunks_exact_mut(3).for_each(|c| c.copy_from_slice(&[0.4, -0.2, 0.9]));
    splats
}

fn lone() -> Splats {
    use super::scenes::One;
    scenes::only([One { logit: 3.0, ..One::at([0.2, -0.1, 4.0], -2.5) }])
}
