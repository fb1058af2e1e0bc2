//! Narrower storage: parameters in f16, keys of fewer digits.

use std::time::Instant;

use nvsprior::Prior;
use nvsprior::prior::Splats;
use nvsprior::render::{Jacobian, Plan};
use nvsprior_reference::Twin;
use nvsprior_reference::probe::{Probe, SortPrecision};
use nvsprior_reference::project::Projected;
use nvsprior_reference::splat::{self, Hit, Pixel, blend_rows};

use super::which::{PriorView, Which};
use crate::stability::case::{Bench, Done, Row, Table};
use crate::stability::measure::{evaluated, psnr};

/// What is rounded to f16 in a prior, and bytes per splat that saves.
struct Storage {
    name: &'static str,
    /// Least PSNR that is expected, dB.
    min_psnr: f64,
    round: fn(&mut Splats, [f32; 3]),
    saves: fn(&Splats) -> usize,
}

const STORAGES: [Storage; 4] = [
    Storage {
        name: "spherical harmonics",
        min_psnr: 45.0,
        round: |s, _| s.sh.iter_mut().for_each(|v| *v = to_f16(*v)),
        saves: |s| 2 * s.sh_stride(),
    },
    Storage { name: "axes", min_psnr: 45.0, round: |s, _| round_axes(s), saves: |_| 18 },
    Storage { name: "positions", min_psnr: 0.0, round: round_positions, saves: |_| 6 },
    Storage {
        name: "all three",
        min_psnr: 0.0,
        round: |s, centre| {
            s.sh.iter_mut().for_each(|v| *v = to_f16(*v));
            round_axes(s);
            round_positions(s, centre);
        },
        saves: |s| 2 * s.sh_stride() + 24,
    },
];

fn round_axes(splats: &mut Splats) {
    splats.log_scales.iter_mut().flatten().for_each(|v| *v = to_f16(v.exp()).max(6e-8).ln());
    splats.rotations.iter_mut().flatten().for_each(|v| *v = to_f16(*v));
}

/// Relative to the prior's centre, as the device holds them.
fn round_positions(splats: &mut Splats, centre: [f32; 3]) {
    for position in &mut splats.positions {
        for (v, c) in position.iter_mut().zip(centre) {
            *v = to_f16(*v - c) + c;
        }
    }
}

/// The nearest number of eleven bits, as f16 holds it; beyond its range the largest.
fn to_f16(value: f32) -> f32 {
    const LARGEST: f32 = 65_504.0;
    if value.abs() < 2f32.powi(-14) {
        let step = 2f32.powi(-24);
        return (value / step).round_ties_even() * step;
    }
    // Veltkamp's splitting.
    let high = value.clamp(-LARGEST, LARGEST) * 8193.0;
    (high - (high - value.clamp(-LARGEST, LARGEST))).clamp(-LARGEST, LARGEST)
}

pub fn measure(bench: &Bench, which: Which) -> anyhow::Result<Done> {
    let since = Instant::now();
    let seen = which.seen(bench)?;
    let whole = draw(bench, &seen, &seen.prior)?;
    let mut row = Row::default();
    let mut rows = Vec::new();
    for storage in &STORAGES {
        let mut splats = seen.prior.splats().clone();
        (storage.round)(&mut splats, seen.prior.coordinate_frame().centre);
        let saved = (storage.saves)(&splats);
        let prior = Prior::from_splats(splats, *seen.prior.options())?;
        let db = psnr(&draw(bench, &seen, &prior)?, &whole);
        row.expect(db >= storage.min_psnr, || format!("{}: {db:.1} dB", storage.name));
        rows.push(vec![storage.name.into(), format!("{db:.1}"), saved.to_string()]);
    }
    let table = Table {
        title: format!("Parameters in f16: {}", which.name()),
        about: "PSNR against the picture of all parameters in f32, colours clamped; bytes saved per splat \
                (of 24 + 36 and twelve per coefficient).",
        header: vec!["what", "PSNR, dB", "bytes saved per splat"],
        rows,
    };
    row.path = "device";
    row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
    Ok(Done { rows: vec![row], tables: vec![table] })
}

fn draw(bench: &Bench, seen: &PriorView, prior: &Prior) -> anyhow::Result<Vec<f32>> {
    let scene = bench.engine.upload(prior)?;
    let mut renderer = bench.engine.renderer(&scene, &seen.camera, Plan::picture())?;
    Ok(renderer.draw(&seen.pose)?.to_vec())
}

/// The order by two digits of three, and what an evaluation with it takes.
pub fn keys(bench: &Bench, which: Which) -> anyhow::Result<Done> {
    let since = Instant::now();
    let seen = which.seen(bench)?;
    let exact = ordered(bench, &seen, SortPrecision::Exact)?;
    let coarse = ordered(bench, &seen, SortPrecision::Coarse)?;
    let db = psnr(&coarse, &exact);
    let mut row = Row::of("device", since);
    row.expect(db >= 35.0, || format!("{db:.1} dB"));
    let times = times(bench, &seen)?;
    let shown = if db.is_finite() { format!("{db:.1}") } else { "the same picture".into() };
    let rows = vec![
        vec!["three digits".into(), "–".into(), format!("{:.2}", times[0])],
        vec!["two digits".into(), shown, format!("{:.2}", times[1])],
    ];
    let table = Table {
        title: format!("Width of depth keys: {}", which.name()),
        about: "The twin's picture with splats in the device's order, against that of the exact order; \
                time of an evaluation of a search, everything in it (fastest of 20, in turn).",
        header: vec!["keys", "PSNR, dB", "ms"],
        rows,
    };
    Ok(Done { rows: vec![row], tables: vec![table] })
}

/// The twin's picture with its splats in the device's order.
fn ordered(
    bench: &Bench,
    seen: &PriorView,
    sort_precision: SortPrecision,
) -> anyhow::Result<Vec<f32>> {
    let PriorView { prior, camera, pose } = seen;
    let scene = bench.engine.upload(prior)?;
    let stages = Probe::of(&bench.engine).stages(&scene, camera, pose, 1 << 22, sort_precision)?;
    let twin = Twin::new(prior);
    let view = twin.view(camera, pose);
    let mut by_index: Vec<Option<Projected>> = vec![None; prior.len()];
    twin.project(&view).into_iter().for_each(|s| by_index[s.index as usize] = Some(s));
    let in_order: Vec<Projected> =
        stages.order.iter().filter_map(|i| by_index[*i as usize]).collect();
    let options = view.options;
    let pixels = blend_rows(&in_order, camera, &Pixel::default(), |pixel, i, centre| {
        if let Some(hit) = Hit::at(&in_order[i], options, centre) {
            pixel.blend(&in_order[i], &hit);
        }
    });
    let background = splat::background(options);
    Ok(pixels.iter().flat_map(|p| p.value(&background).map(|v| v as f32)).collect())
}

/// Milliseconds of an evaluation by three digits and by two.
fn times(bench: &Bench, seen: &PriorView) -> anyhow::Result<[f64; 2]> {
    let scene = bench.engine.upload(&seen.prior)?;
    let mut renderers = Vec::new();
    for sort_precision in [SortPrecision::Exact, SortPrecision::Coarse] {
        let search = Some(Jacobian::Flow);
        let plan = Plan { search, sort_precision, ..Plan::picture() };
        let mut renderer = bench.engine.renderer(&scene, &seen.camera, plan)?;
        renderer.set_picture(&nvsprior::Picture::new(seen.camera.width, seen.camera.height));
        renderers.push(renderer);
    }
    let mut fastest = [f64::INFINITY; 2];
    for _ in 0..20 {
        for (renderer, fastest) in renderers.iter_mut().zip(&mut fastest) {
            let since = Instant::now();
            evaluated(renderer, &seen.prior, &seen.pose)?;
            *fastest = fastest.min(since.elapsed().as_secs_f64() * 1e3);
        }
    }
    Ok(fastest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_as_f16_does() {
        for (value, expected) in [
            (1.0, 1.0),
            (1.0 + 2f32.powi(-11), 1.0),
            (1.0 + 3.0 * 2f32.powi(-11), 1.0 + 2f32.powi(-9)),
            (0.1, 0.099_975_586),
            (-65_504.0, -65_504.0),
            (1e6, 65_504.0),
            (1e-9, 0.0),
            (5.9e-8, 2f32.powi(-24)),
        ] {
            assert_eq!(to_f16(value), expected, "{value}");
        }
    }
}
