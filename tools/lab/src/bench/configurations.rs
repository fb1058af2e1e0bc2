//! Error against run time of many settings, each on the same few frames of a steady run.

use nvsprior::prior::Splats;
use nvsprior::render::{Jacobian, SortPrecision};
use nvsprior::{EncoderOptions, Prior};
use serde::Serialize;

use super::context::{Context, OptimizerRun, Sample};
use super::steady;
use nvsprior_inputs::statistics::Spread;
use nvsprior_paper::Optimizer;

/// Loss that a recommended setting may have, dB in the median.
const LOSS: f64 = 0.05;

#[derive(Serialize)]
pub struct Row {
    pub name: String,
    /// Below the best known pose's render of the whole prior, dB.
    #[serde(rename = "db_short")]
    pub loss: Spread,
    pub frame_ms: Spread,
    /// Of the whole prior.
    pub in_forward_renders: Spread,
    /// Distance from the best known pose, the prior's unit.
    #[serde(rename = "pose_error_units")]
    pub units: Spread,
    /// Angle to it, degrees.
    #[serde(rename = "pose_error_degrees")]
    pub degrees: Spread,
    /// At quality 10.
    #[serde(rename = "bytes_quality_10")]
    pub bytes: Spread,
    /// Whether no other setting is both faster and better.
    pub pareto: bool,
}

impl Row {
    fn of(name: String, context: &Context, samples: &[Sample]) -> Row {
        let spread = |figure: &dyn Fn(&Sample) -> f64| Spread::of(samples.iter().map(figure));
        Row {
            name,
            loss: spread(&|s| context.short(s)),
            frame_ms: spread(&Sample::frame_ms),
            in_forward_renders: spread(&Sample::in_forward_renders),
            units: spread(&|s| context.pose_error(s)[0]),
            degrees: spread(&|s| context.pose_error(s)[1]),
            bytes: spread(&|s| s.stats.bytes as f64),
            pareto: false,
        }
    }
}

/// Part of the prior that is drawn.
enum DrawnPart {
    All,
    /// Spherical harmonics of degree 0 alone.
    Colour,
    /// This share of the splats, those of the largest opacity times area.
    Share(f64),
}

struct Setting {
    name: String,
    options: EncoderOptions,
    kept: DrawnPart,
}

/// Each setting changes one thing from the default. Schedules are those of frames that follow
/// another.
fn settings(context: &Context) -> Vec<Setting> {
    let mut settings = Vec::new();
    let mut add = |name: String, kept: DrawnPart, change: &dyn Fn(&mut EncoderOptions)| {
        let mut options = context.options();
        change(&mut options);
        settings.push(Setting { name, options, kept });
    };
    let warm = context.options().refine.gauss_newton.warm;
    add("default".into(), DrawnPart::All, &|_| {});
    for levels in [0b0111u32, 0b0101, 0b0011, 0b0001] {
        add(format!("always levels {levels:03b}"), DrawnPart::All, &|o| {
            let warm = &mut o.refine.gauss_newton.warm;
            let first = levels.ilog2() as usize;
            (warm.levels, warm.first_level, warm.follow_level) = (levels, first, first);
            warm.far_level = 0;
        });
    }
    for renders in [1, 2, 4].into_iter().filter(|r| *r != warm.renders) {
        add(format!("renders {renders}"), DrawnPart::All, &|o| {
            o.refine.gauss_newton.warm.renders = renders;
        });
    }
    for leap in [0.0, 0.03, 0.1, 0.3].into_iter().filter(|l| *l != warm.leap) {
        add(format!("leap {leap}"), DrawnPart::All, &|o| o.refine.gauss_newton.warm.leap = leap);
    }
    for tolerance in [3e-2, 1e-2, 1e-3].into_iter().filter(|t| *t != warm.coarse_tolerance) {
        add(format!("coarse tolerance {tolerance}"), DrawnPart::All, &|o| {
            o.refine.gauss_newton.warm.coarse_tolerance = tolerance;
        });
    }
    add("depths exact".into(), DrawnPart::All, &|o| o.refine.sort_precision = SortPrecision::Exact);
    add("exact Jacobian".into(), DrawnPart::All, &|o| o.refine.jacobian = Jacobian::Exact);
    if context.prior.splats().sh_degree > 0 {
        add("SH degree 0".into(), DrawnPart::Colour, &|_| {});
    }
    for share in [0.5, 0.25] {
        add(format!("splats {:.0} %", 100.0 * share), DrawnPart::Share(share), &|_| {});
    }
    settings
}

pub fn count(context: &Context) -> usize {
    settings(context).len()
}

/// Measures every setting on `frames` frames after a first one, and adds the gradient methods'
/// runs.
pub fn measure(
    context: &mut Context,
    frames: usize,
    runs: &[OptimizerRun],
    done: impl Fn(),
) -> anyhow::Result<Vec<Row>> {
    let whole = context.scene.clone();
    let mut measured: Vec<(String, Vec<Sample>)> = Vec::new();
    for Setting { name, options, kept } in settings(context) {
        let part = part(&context.prior, &kept)?;
        // Poses of another prior are not learnt from: see `steady`.
        let best = context.best.clone();
        if let Some(part) = &part {
            context.scene = context.engine.upload(part)?;
        }
        let samples = steady::measure(context, options, frames + 1, || true);
        context.scene = whole.clone();
        if part.is_some() {
            context.best = best;
        }
        measured.push((name, samples?));
        done();
    }
    let mut rows: Vec<Row> =
        measured.into_iter().map(|(name, samples)| Row::of(name, context, &samples)).collect();
    let gradient = runs.iter().filter(|run| run.optimizer != Optimizer::GaussNewton);
    rows.extend(gradient.map(|run| Row::of(run.optimizer.name().into(), context, &run.samples)));
    mark(&mut rows);
    Ok(rows)
}

/// Marks the Pareto set of run time and loss, medians.
fn mark(rows: &mut [Row]) {
    let figures: Vec<[f64; 2]> =
        rows.iter().map(|row| [row.in_forward_renders.median, row.loss.median]).collect();
    for (row, [time, loss]) in rows.iter_mut().zip(&figures) {
        let beaten = |[t, l]: &[f64; 2]| t <= time && l <= loss && (t < time || l < loss);
        row.pareto = !figures.iter().any(beaten);
    }
}

/// The fastest that loses next to nothing.
pub fn recommended(rows: &[Row]) -> Option<&Row> {
    let good = rows.iter().filter(|row| row.loss.median <= LOSS);
    good.min_by(|a, b| a.in_forward_renders.median.total_cmp(&b.in_forward_renders.median))
}

/// The prior of what is kept; `None`: the whole.
fn part(prior: &Prior, kept: &DrawnPart) -> anyhow::Result<Option<Prior>> {
    let splats = match kept {
        DrawnPart::All => return Ok(None),
        DrawnPart::Colour => plain(prior.splats()),
        DrawnPart::Share(share) => {
            let count = (prior.splats().len() as f64 * share).ceil() as usize;
            chosen(prior.splats(), &largest(prior.splats(), count))
        }
    };
    Ok(Some(Prior::from_splats(splats, *prior.options())?))
}

/// Splats with their first coefficient only.
fn plain(splats: &Splats) -> Splats {
    let first = splats.sh.chunks_exact(splats.sh_stride()).flat_map(|sh| &sh[..3]);
    Splats { sh: first.copied().collect(), sh_degree: 0, ..splats.clone() }
}

/// The places of the splats with the largest opacity times area, in their order.
fn largest(splats: &Splats, count: usize) -> Vec<usize> {
    let weight = |i: usize| {
        let opacity = 1.0 / (1.0 + (-splats.opacity_logits[i]).exp());
        let [a, b, c] = splats.log_scales[i];
        opacity * (a + b + c - a.min(b).min(c)).exp()
    };
    let mut places: Vec<usize> = (0..splats.len()).collect();
    places.sort_by(|a, b| weight(*b).total_cmp(&weight(*a)));
    places.truncate(count);
    places.sort_unstable();
    places
}

/// The splats at some places.
pub fn chosen(splats: &Splats, places: &[usize]) -> Splats {
    let stride = splats.sh_stride();
    let sh = |i: &usize| &splats.sh[i * stride..][..stride];
    Splats {
        origin: splats.origin,
        positions: places.iter().map(|i| splats.positions[*i]).collect(),
        log_scales: places.iter().map(|i| splats.log_scales[*i]).collect(),
        rotations: places.iter().map(|i| splats.rotations[*i]).collect(),
        opacity_logits: places.iter().map(|i| splats.opacity_logits[*i]).collect(),
        sh: places.iter().flat_map(sh).copied().collect(),
        sh_degree: splats.sh_degree,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time: f64, loss: f64) -> Row {
        let of = |v| Spread::of([v]);
        let (zero, name) = (of(0.0), format!("{time}"));
        let (in_forward_renders, frame_ms) = (of(time), of(time));
        let [units, degrees, bytes] = [zero; 3];
        let loss = of(loss);
        Row { name, loss, frame_ms, in_forward_renders, units, degrees, bytes, pareto: false }
    }

    #[test]
    fn the_fastest_of_the_good_is_recommended() {
        let mut rows = [row(5.0, 0.0), row(3.0, 0.04), row(4.0, 0.04), row(1.0, 2.0)];
        mark(&mut rows);
        assert_eq!(rows.each_ref().map(|row| row.pareto), [true, true, false, true]);
        assert_eq!(recommended(&rows).unwrap().name, "3");
        assert!(recommended(&[row(1.0, f64::NAN)]).is_none());
    }

    #[test]
    fn the_largest_splats_are_kept_in_order() {
        let splats = Splats {
            origin: [0.0; 3],
            positions: vec![[0.0; 3], [1.0; 3], [2.0; 3]],
            log_scales: vec![[1.0, 1.0, -9.0], [-1.0, -1.0, 0.0], [0.5, 0.5, 0.5]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            opacity_logits: vec![0.0; 3],
            sh: (0..36).map(|v| v as f32).collect(),
            sh_degree: 1,
        };
        assert_eq!(largest(&splats, 2), [0, 2]);
        let kept = chosen(&splats, &[0, 2]);
        assert_eq!((kept.len(), kept.sh[12]), (2, 24.0));
        assert_eq!(plain(&kept).sh, [0.0, 1.0, 2.0, 24.0, 25.0, 26.0]);
        kept.check_shape().unwrap();
    }
}
