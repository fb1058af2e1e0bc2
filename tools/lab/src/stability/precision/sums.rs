//! Ways of summing the normal equations.

use std::time::Instant;

use nvsprior::render::{Jacobian, NormalEquations, Plan};
use nvsprior_kernels::shared::{SUMS, TILE};
use nvsprior_reference::{Sample, Twin};

use super::which::{PriorView, Which};
use crate::stability::case::{Bench, Done, Row, Table};
use crate::stability::measure::{jtj_error, sums};
use crate::stability::scenes::Random;

/// As searches begin with.
pub const DAMPING: f32 = 1e-3;

/// The 28 sums.
type Sums<T> = [T; SUMS as usize];

/// Jᵀr of normal equations.
pub fn jtr(e: &NormalEquations) -> [f64; 6] {
    e.jtr
}

/// The damped step in f64: Gaussian elimination of `(JᵀJ + λ diag JᵀJ) δ = −Jᵀr`.
pub fn solved(e: &NormalEquations, damping: f64) -> [f64; 6] {
    let mut a = e.jtj;
    let mut x = e.jtr.map(|v| -v);
    (0..6).for_each(|k| a[k][k] *= 1.0 + damping);
    for k in 0..6 {
        for row in k + 1..6 {
            let factor = a[row][k] / a[k][k];
            a[row] = std::array::from_fn(|column| a[row][column] - factor * a[k][column]);
            x[row] -= factor * x[k];
        }
    }
    for k in (0..6).rev() {
        let known: f64 = (k + 1..6).map(|j| a[k][j] * x[j]).sum();
        x[k] = (x[k] - known) / a[k][k];
    }
    x
}

struct Way {
    name: &'static str,
    sum: fn(&[f32]) -> f64,
}

const WAYS: [Way; 5] = [
    Way { name: "f32, in order", sum: |v| f64::from(v.iter().fold(0.0_f32, |sum, v| sum + v)) },
    Way { name: "f32, eight strands (the device's)", sum: |v| f64::from(strands(v)) },
    Way { name: "f32, pairwise", sum: |v| f64::from(pairwise(v)) },
    Way { name: "f32, compensated (Neumaier)", sum: |v| f64::from(compensated(v)) },
    Way { name: "f64", sum: |v| v.iter().map(|v| f64::from(*v)).sum() },
];

fn strands(values: &[f32]) -> f32 {
    let strand = |k: usize| values.iter().skip(k).step_by(8).sum::<f32>();
    (0..8).map(strand).sum()
}

fn pairwise(values: &[f32]) -> f32 {
    match values {
        [] => 0.0,
        [one] => *one,
        _ => {
            let (a, b) = values.split_at(values.len() / 2);
            pairwise(a) + pairwise(b)
        }
    }
}

/// Neumaier 1974.
fn compensated(values: &[f32]) -> f32 {
    let (mut sum, mut lost) = (0.0_f32, 0.0_f32);
    for value in values {
        let next = sum + value;
        let smaller =
            if sum.abs() >= value.abs() { (sum - next) + value } else { (value - next) + sum };
        (sum, lost) = (next, lost + smaller);
    }
    sum + lost
}

pub fn measure(bench: &Bench, which: Which) -> anyhow::Result<Done> {
    let since = Instant::now();
    let seen = which.seen(bench)?;
    let PriorView { prior, camera, pose } = &seen;
    let mut random = Random::new(42);
    let frame: Vec<f32> = (0..camera.pixels() * 3).map(|_| random.within(0.0, 1.0)).collect();
    let samples = Twin::new(prior).samples(camera, pose, Jacobian::Flow);
    let exact = nvsprior_reference::reduce::reduce(&samples, &frame);
    let partials = partials(&samples, &frame, camera.width);
    let step = solved(&exact, DAMPING.into());
    let mut row = Row::default();
    let mut rows = Vec::new();
    for way in &WAYS {
        let (equations, nanoseconds) = summed(way, &partials, exact.residuals);
        let change = change(&equations, &step);
        if way.name.contains("device's") {
            row.expect(change < 1e-3, || format!("the step changes by {change:.1e}"));
            row.jtj = Some(jtj_error(&equations, &exact));
        }
        rows.push(vec![
            way.name.into(),
            format!("{:.1e}", jtj_error(&equations, &exact)),
            format!("{change:.1e}"),
            format!("{nanoseconds:.2}"),
        ]);
    }
    rows.push(on_device(bench, &seen, &frame, &exact, &step)?);
    let table = Table {
        title: format!("Ways of summing: {}", which.name()),
        about: "The twin's tiles, rounded to f32 as the device has them, summed on the host. The step's \
                change is relative to its largest component. The device's row holds all its errors, from \
                projection on.",
        header: vec!["way", "JᵀJ error", "change of the step", "ns per value"],
        rows,
    };
    row.path = "host";
    row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
    Ok(Done { rows: vec![row], tables: vec![table] })
}

/// What the device itself gives.
fn on_device(
    bench: &Bench,
    seen: &PriorView,
    frame: &[f32],
    exact: &NormalEquations,
    step: &[f64; 6],
) -> anyhow::Result<Vec<String>> {
    let scene = bench.engine.upload(&seen.prior)?;
    let plan = Plan { jacobians: vec![Jacobian::Flow], ..Plan::picture() };
    let mut renderer = bench.engine.renderer(&scene, &seen.camera, plan)?;
    renderer.set_frame(0, frame);
    let got = renderer.normal_equations(0, Jacobian::Flow, &seen.pose)?;
    let (jtj, change) = (jtj_error(&got, exact), change(&got, step));
    Ok(vec![
        "the device, all stages".into(),
        format!("{jtj:.1e}"),
        format!("{change:.1e}"),
        "–".into(),
    ])
}

/// How far a step is from another, relative to its largest component.
fn change(equations: &NormalEquations, step: &[f64; 6]) -> f64 {
    let size = step.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let other = solved(equations, DAMPING.into());
    std::iter::zip(other, step).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs() / size))
}

/// The sums of each tile, by sum.
fn partials(samples: &[Sample], frame: &[f32], width: u32) -> Vec<Vec<f32>> {
    let across = width.div_ceil(TILE) as usize;
    let rows = (samples.len() as u32 / width).div_ceil(TILE) as usize;
    let mut tiles = vec![[0.0; SUMS as usize]; across * rows];
    for (at, (sample, target)) in samples.iter().zip(frame.chunks_exact(3)).enumerate() {
        let (x, y) = (at % width as usize, at / width as usize);
        let tile = &mut tiles[y / TILE as usize * across + x / TILE as usize];
        let own = nvsprior_reference::reduce::reduce(std::slice::from_ref(sample), target);
        let values: Sums<f64> = sums(&own);
        tile.iter_mut().zip(values).for_each(|(to, v)| *to += v);
    }
    (0..SUMS as usize).map(|k| tiles.iter().map(|tile| tile[k] as f32).collect()).collect()
}

/// The normal equations by a way of summing, and nanoseconds a value.
fn summed(way: &Way, partials: &[Vec<f32>], residuals: usize) -> (NormalEquations, f64) {
    const RUNS: usize = 20;
    let mut out: Sums<f64> = [0.0; SUMS as usize];
    let since = Instant::now();
    for _ in 0..RUNS {
        for (to, values) in out.iter_mut().zip(partials) {
            *to = (way.sum)(std::hint::black_box(values));
        }
    }
    let values = RUNS * partials.iter().map(Vec::len).sum::<usize>();
    let nanoseconds = since.elapsed().as_secs_f64() * 1e9 / values as f64;
    (NormalEquations::from_sums(&out, residuals), nanoseconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_ways_sum() {
        let values: Vec<f32> = (0..1001).map(|i| ((i * 37) % 101) as f32 - 50.0).collect();
        let expected: f64 = values.iter().map(|v| f64::from(*v)).sum();
        for way in &WAYS {
            assert_eq!((way.sum)(&values), expected, "{}", way.name);
        }
        let lossy = [1e8, 1.0, -1e8, 1.0];
        assert_eq!((compensated(&lossy), lossy.iter().sum::<f32>()), (2.0, 1.0));
    }

    #[test]
    fn the_step_solves_the_system() {
        let mut e = NormalEquations {
            jtj: [[0.1; 6]; 6],
            jtr: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            square: 1.0,
            residuals: 3,
        };
        (0..6).for_each(|k| e.jtj[k][k] = 2.0 + k as f64);
        let x = solved(&e, 0.0);
        for row in 0..6 {
            let left: f64 = (0..6).map(|k| e.jtj[row][k] * x[k]).sum();
            assert!((left + e.jtr[row]).abs() < 1e-12, "{x:?}");
        }
    }
}
