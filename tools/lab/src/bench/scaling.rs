//! `nvsprior-lab scaling`: time against the number of splats and the size of the picture.

use nvsprior::prior::Splats;
use nvsprior::render::{Jacobian, Plan};
use nvsprior::{Camera, Picture, Prior};
use serde::Serialize;

use super::configurations::chosen;
use super::context::Context;
use super::forward::timed;
use super::perturbed::even;
use super::plot::Curve;
use super::{RunArgs, optimum, plot};
use nvsprior_inputs::args::with_progress;
use nvsprior_inputs::report::{Table, fixed_or_empty, write_json};
use nvsprior_inputs::statistics::median;

const SPLATS: [usize; 5] = [5_000, 20_000, 80_000, 320_000, 2_000_000];
const SIZES: [(u32, u32); 4] = [(160, 90), (320, 180), (640, 360), (1280, 720)];
/// Runs; their median counts.
const RUNS: usize = 3;

/// A number of splats at a size.
#[derive(Serialize)]
pub struct Row {
    pub splats: usize,
    pub width: u32,
    pub height: u32,
    /// Milliseconds of a forward render, submission and wait included.
    pub forward_ms: Option<f64>,
    /// Of the normal equations with the flow Jacobian at full resolution.
    pub evaluation_ms: Option<f64>,
    /// Why it cannot be done.
    pub error: Option<String>,
}

const COUNT: usize = SPLATS.len() * SIZES.len();

/// Measure time against the number of splats (to 2 million) and pixels (to 1280×720)
///
/// Writes scaling.json, scaling.csv and scaling.svg.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| {
        optimum::find(context)?;
        let rows = with_progress(COUNT, "sizes", |done| measure(context, done));
        let table = table(&rows);
        table.print();
        table.write_csv(&folder.join("scaling.csv"))?;
        write_json(&folder.join("scaling.json"), &rows)?;
        plot::scaling(&folder.join("scaling.svg"), curves(&rows))
    })
}

/// Measures all, at the first frame's best known pose.
fn measure(context: &Context, done: impl Fn()) -> Vec<Row> {
    let mut rows = Vec::new();
    for splats in SPLATS {
        let prior =
            Prior::from_splats(resized(context.prior.splats(), splats), *context.prior.options());
        for (width, height) in SIZES {
            let camera = context.shots[0].camera.resized(width, height);
            let times = match &prior {
                Ok(prior) => time(context, prior, &camera).map_err(|e| format!("{e:#}")),
                Err(error) => Err(error.to_string()),
            };
            let ([forward_ms, evaluation_ms], error) = match times {
                Ok(times) => (times.map(Some), None),
                Err(error) => ([None; 2], Some(error)),
            };
            rows.push(Row { splats, width, height, forward_ms, evaluation_ms, error });
            done();
        }
    }
    rows
}

/// Times against sizes.
fn table(rows: &[Row]) -> Table {
    Table::of(
        rows,
        &[
            ("splats", &|r| r.splats.to_string()),
            ("width", &|r| r.width.to_string()),
            ("height", &|r| r.height.to_string()),
            ("forward_ms", &|r| fixed_or_empty(r.forward_ms, 3)),
            ("evaluation_ms", &|r| fixed_or_empty(r.evaluation_ms, 3)),
            ("error", &|r| r.error.clone().unwrap_or_default()),
        ],
    )
}

/// Milliseconds against splats: at each size, of a forward render and of an evaluation.
fn curves(rows: &[Row]) -> Vec<Curve> {
    let of = |(width, height): (u32, u32), what: &str, ms: fn(&Row) -> Option<f64>| {
        let own = rows.iter().filter(|row| (row.width, row.height) == (width, height));
        let points = own.filter_map(|row| Some((row.splats as f64, ms(row)?)));
        (format!("{width}×{height}, {what}"), points.collect())
    };
    let both = |size| {
        [of(size, "forward render", |r| r.forward_ms), of(size, "evaluation", |r| r.evaluation_ms)]
    };
    SIZES.into_iter().flat_map(both).filter(|(_, points): &Curve| !points.is_empty()).collect()
}

/// Milliseconds of a forward render and of an evaluation.
fn time(context: &Context, prior: &Prior, camera: &Camera) -> anyhow::Result<[f64; 2]> {
    let pose = context.best[0].pose;
    let scene = context.engine.upload(prior)?;
    let plan = Plan { jacobians: vec![Jacobian::Flow], ..Plan::picture() };
    let mut renderer = context.engine.renderer(&scene, camera, plan)?;
    let mut picture = Picture::new(camera.width, camera.height);
    renderer.set_picture(&picture);
    renderer.reduce_picture()?;
    let (mut forward, mut evaluation) = (Vec::new(), Vec::new());
    // The first round does not count: drivers finish their work at first use.
    for _ in 0..=RUNS {
        forward.push(timed(|| Ok(renderer.picture(&pose, &mut picture)?))?.1);
        evaluation.push(timed(|| Ok(renderer.normal_equations(0, Jacobian::Flow, &pose)?))?.1);
    }
    let counted = |times: Vec<f64>| median(times.into_iter().skip(1));
    Ok([forward, evaluation].map(counted))
}

/// The scene with another number of splats: every n-th splat, or each splat several times, moved by
/// up to its own extent. Each becomes larger or smaller, so that all together cover the same area.
fn resized(splats: &Splats, count: usize) -> Splats {
    let len = splats.len();
    let places: Vec<usize> =
        (0..count).map(|i| (i as u128 * len as u128 / count as u128) as usize).collect();
    let mut out = chosen(splats, &places);
    let grown = 0.5 * (len as f64 / count as f64).ln() as f32;
    let mut aside = even(count as u64);
    for (i, place) in places.iter().enumerate() {
        let [a, b, c] = splats.log_scales[*place];
        let repeated = i > 0 && places[i - 1] == *place;
        let extent = if repeated { a.max(b).max(c).exp() } else { 0.0 };
        for axis in 0..3 {
            out.positions[i][axis] += extent * aside.next().unwrap_or_default() as f32;
            out.log_scales[i][axis] += grown;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_splats_as_asked_for_cover_the_same_area() {
        let splats = Splats {
            origin: [0.0; 3],
            positions: (0..10).map(|i| [i as f32, 0.0, 0.0]).collect(),
            log_scales: vec![[0.0, 0.0, -3.0]; 10],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 10],
            opacity_logits: vec![0.0; 10],
            sh: vec![0.0; 30],
            sh_degree: 0,
        };
        let area = |s: &Splats| s.log_scales.iter().map(|l| (l[0] + l[1]).exp()).sum::<f32>();
        for count in [3, 10, 25] {
            let other = resized(&splats, count);
            other.check_shape().unwrap();
            assert_eq!(other.len(), count);
            assert!((area(&other) - 10.0).abs() < 1e-3, "{}", area(&other));
        }
        assert_eq!(resized(&splats, 10), splats);
        let many = resized(&splats, 25);
        assert!(many.positions[1] != many.positions[0], "put aside");
    }
}
