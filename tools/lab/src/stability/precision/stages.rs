//! Errors stage by stage, in bits.

use std::time::Instant;

use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::render::{Jacobian, NormalEquations, Plan};
use nvsprior_kernels::search;
use nvsprior_kernels::shared::CULLED;
use nvsprior_reference::Twin;
use nvsprior_reference::probe::{Probe, SortPrecision};
use nvsprior_reference::project::Projected;

use super::sums::{DAMPING, jtr, solved};
use super::which::{PriorView, Which};
use crate::stability::case::{Bench, Done, Row, Table};
use crate::stability::explained::Explained;
use crate::stability::measure::{sums, upper};
use crate::stability::scenes::Random;

/// Errors of a quantity, relative to its size.
struct Errors {
    stage: &'static str,
    quantity: &'static str,
    relative: Vec<f64>,
}

/// Correct bits, from a relative error; an f32 has 24.
fn bits(relative: f64) -> f64 {
    -relative.max(2f64.powi(-30)).log2()
}

impl Errors {
    fn new(
        stage: &'static str,
        quantity: &'static str,
        relative: impl Iterator<Item = f64>,
    ) -> Errors {
        let mut relative: Vec<f64> = relative.collect();
        relative.sort_by(f64::total_cmp);
        Errors { stage, quantity, relative }
    }

    fn median(&self) -> f64 {
        self.relative.get(self.relative.len() / 2).copied().unwrap_or(0.0)
    }

    fn worst(&self) -> f64 {
        self.relative.last().copied().unwrap_or(0.0)
    }

    fn cells(&self) -> Vec<String> {
        vec![
            self.stage.into(),
            self.quantity.into(),
            format!("{:.1}", bits(self.median())),
            format!("{:.1}", bits(self.worst())),
            format!("{:.1e}", self.worst()),
            self.relative.len().to_string(),
        ]
    }
}

pub fn measure(bench: &Bench, which: Which) -> anyhow::Result<Done> {
    let since = Instant::now();
    let seen = which.seen(bench)?;
    let mut all = projection(bench, &seen)?;
    let picture = picture(bench, &seen)?;
    all.extend(equations(bench, &seen)?);
    all.push(coded_pose(&seen)?);
    let mut row = Row::of("f32", since);
    for errors in &all {
        let right = bits(errors.median());
        row.expect(right >= 16.0, || {
            format!("{} {}: {right:.1} bits in the median", errors.stage, errors.quantity)
        });
    }
    let (errors, excess) = picture;
    row.expect(bits(excess) >= 12.0, || format!("a pixel is off by {excess:.1e}"));
    all.insert(6, errors);
    let header = vec!["stage", "quantity", "bits right, median", "least", "largest error", "of"];
    let table = Table {
        title: format!("Bits right by stage: {}", which.name()),
        about: "Relative errors of the device's values against the twin's: of means against the \
                picture's width, of colours against 1, of sums against what Cauchy–Schwarz bounds them \
                by. An f32 has 24 bits. The picture's worst pixels depend on close decisions.",
        header,
        rows: all.iter().map(Errors::cells).collect(),
    };
    Ok(Done { rows: vec![row], tables: vec![table] })
}

/// Stage `project`, and the order.
fn projection(bench: &Bench, seen: &PriorView) -> anyhow::Result<Vec<Errors>> {
    let PriorView { prior, camera, pose } = seen;
    let scene = bench.engine.upload(prior)?;
    let stages =
        Probe::of(&bench.engine).stages(&scene, camera, pose, 1 << 22, SortPrecision::Exact)?;
    let twin = Twin::new(prior);
    let view = twin.view(camera, pose);
    let projected = twin.project(&view);
    let shown = |s: &&Projected| stages.keys[s.index as usize] != CULLED;
    let of = |error: &dyn Fn(&[f32; 12], &Projected) -> f64| -> Vec<f64> {
        let pairs = projected.iter().filter(shown);
        pairs.map(|s| error(&stages.records[s.index as usize], s)).collect()
    };
    let ratio = |got: f32, expected: f64| (f64::from(got) / expected - 1.0).abs();
    let width = f64::from(camera.width);
    let mean = of(&|r, s| (f64::from(r[0]) - s.mean.x).hypot(f64::from(r[1]) - s.mean.y) / width);
    let conic = of(&|r, s| ratio(r[2], s.factor[0]).max(ratio(r[4], s.factor[2])));
    let opacity = of(&|r, s| ratio(r[5].exp2(), s.opacity));
    let colour = of(&|r, s| {
        let off = |k: usize| (f64::from(r[8 + k]) - s.rgb[k]).abs();
        off(0).max(off(1)).max(off(2))
    });
    let depth = of(&|r, s| ratio(r[11], s.camera.z));
    // How far a splat lies behind one that is drawn after it.
    let mut depths = vec![f64::NAN; prior.len()];
    projected.iter().for_each(|s| depths[s.index as usize] = s.camera.z);
    let pairs = stages.order.windows(2).map(|o| (depths[o[0] as usize], depths[o[1] as usize]));
    let swapped = pairs.filter(|(a, b)| a > b).map(|(a, b)| a / b - 1.0);
    Ok(vec![
        Errors::new("project", "mean", mean.into_iter()),
        Errors::new("project", "conic", conic.into_iter()),
        Errors::new("project", "opacity", opacity.into_iter()),
        Errors::new("project", "colour", colour.into_iter()),
        Errors::new("project", "depth", depth.into_iter()),
        Errors::new("sort", "depth of neighbours in wrong order", swapped),
    ])
}

/// The picture's errors, and the largest that neither rounding nor a close decision explains.
fn picture(bench: &Bench, seen: &PriorView) -> anyhow::Result<(Errors, f64)> {
    let PriorView { prior, camera, pose } = seen;
    let scene = bench.engine.upload(prior)?;
    let mut renderer = bench.engine.renderer(&scene, camera, Plan::picture())?;
    let drawn = renderer.draw(pose)?;
    let explained = Explained::new(prior, camera, pose)?;
    let excess = explained.compare(drawn).excess;
    let pixels = drawn.chunks_exact(5).zip(&explained.picture.pixels);
    let off = pixels.flat_map(|(a, b)| [0, 1, 2].map(|k| (f64::from(a[k]) - b[k]).abs()));
    Ok((Errors::new("splat", "colour of a pixel", off), excess))
}

/// The normal equations with either Jacobian, and the step that follows.
fn equations(bench: &Bench, seen: &PriorView) -> anyhow::Result<Vec<Errors>> {
    let PriorView { prior, camera, pose } = seen;
    let scene = bench.engine.upload(prior)?;
    let jacobians = vec![Jacobian::Flow, Jacobian::Exact];
    let plan = Plan { jacobians: jacobians.clone(), ..Plan::picture() };
    let mut renderer = bench.engine.renderer(&scene, camera, plan)?;
    let mut random = Random::new(41);
    let frame: Vec<f32> = (0..camera.pixels() * 3).map(|_| random.within(0.0, 1.0)).collect();
    renderer.set_frame(0, &frame);
    let twin = Twin::new(prior);
    let mut all = Vec::new();
    for (jacobian, stage) in std::iter::zip(jacobians, ["splat_flow", "splat_exact"]) {
        let got = renderer.normal_equations(0, jacobian, pose)?;
        let expected = twin.normal_equations(camera, pose, &frame, jacobian);
        all.extend(of_equations(stage, &got, &expected));
        let f32s = sums(&got).map(|v| v as f32);
        let step = search::damped_step(&f32s, DAMPING).tau;
        let exact = solved(&got, DAMPING.into());
        let size = exact.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let off = std::iter::zip(step, exact).map(|(a, b)| (f64::from(a) - b).abs() / size);
        all.push(Errors::new("solve", "step", off.collect::<Vec<_>>().into_iter()));
    }
    Ok(all)
}

fn of_equations(stage: &'static str, got: &NormalEquations, twin: &NormalEquations) -> [Errors; 3] {
    let length = |k: usize| twin.jtj[k][k].sqrt();
    let jtj = upper().map(|(i, j)| (got.jtj[i][j] - twin.jtj[i][j]).abs() / length(i) / length(j));
    let residual = twin.square.sqrt();
    let jtr = (0..6).map(|k| (jtr(got)[k] - jtr(twin)[k]).abs() / length(k) / residual);
    let square = (got.square / twin.square - 1.0).abs();
    [
        Errors::new(stage, "JᵀJ", jtj),
        Errors::new(stage, "Jᵀr", jtr),
        Errors::new(stage, "r²", std::iter::once(square)),
    ]
}

/// The pose that a packet's code stands for, as the device and as the host take it.
fn coded_pose(seen: &PriorView) -> anyhow::Result<Errors> {
    let frame = seen.prior.coordinate_frame();
    let centre = glam::DVec3::from(frame.centre.map(f64::from));
    let anchor = search::Anchor { centre: frame.centre, step: frame.step() as f32 };
    let mut relative = Vec::new();
    for k in 0..200 {
        let t = f64::from(k) * 0.01;
        let pose = seen.pose.stepped(&[0.3 * t, 0.1, -0.2 * t, 0.5 * t, 0.1 * t, -0.3 * t]);
        let code = QuantisedPose::quantise(&pose, &frame, PoseProfile::Compact)?;
        let host = code.dequantise(&frame);
        let device = search::placed(&code.words(), &anchor);
        let expected = host.translation + host.rotation * centre;
        let got = glam::DVec3::from(device.translation.map(f64::from));
        relative.push((got - expected).length() / expected.length().max(frame.unit()));
    }
    Ok(Errors::new("coded pose", "translation", relative.into_iter()))
}
