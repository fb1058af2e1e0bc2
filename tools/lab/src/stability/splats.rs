//! Extreme splats.

use std::time::Instant;

use nvsprior::prior::{Fault, Splats};
use nvsprior::render::{Jacobian, Plan};
use nvsprior::vulkan::Error;
use nvsprior::{Pose, Prior, RenderOptions};
use nvsprior_reference::probe::{Probe, SortPrecision};
use nvsprior_reference::radix;

use super::case::{Bench, Case, Group, Row};
use super::measure::{Limits, Scenario};
use super::scenes::{self, One, Random, cloud, only, with};

pub const GROUP: Group = Group {
    name: "splats",
    about: "One cloud of 300 splats with extreme ones among them, at 64×48, unless the case says \
            otherwise.",
    cases,
};

const AS_TWIN: &str = "drawn and differentiated as by the twin; the search ends no worse than it began, or above 50 dB";
const NOTHING: &str = "nothing but the background, no derivative, and the search does not move";
const REFUSED: &str = "left out at loading, counted, and named by kind";
const TOO_LARGE: &str = "drawn if the device holds it, else refused with what would fit";

fn cases(bench: &Bench) -> Vec<Case> {
    let mut all = shapes();
    all.extend(opacities());
    all.extend(places());
    all.extend(invalid());
    all.extend(many(bench.quick));
    all
}

/// A case of a cloud with other splats among it.
fn among(name: &str, others: fn(&mut Random) -> Vec<One>) -> Case {
    Case::new(name, AS_TWIN, move |bench| {
        let mut random = Random::new(name_seed(others(&mut Random::new(1)).len()));
        Scenario::new(with(cloud(7, 300, 1), others(&mut random)))?.run(bench)
    })
}

fn name_seed(count: usize) -> u64 {
    100 + count as u64
}

/// Fifty of them at random places, of scales.
fn fifty(random: &mut Random, log_scale: [f32; 3]) -> Vec<One> {
    let one = |_| {
        let z = random.within(2.0, 8.0);
        let position = [random.within(-0.6, 0.6) * z, random.within(-0.4, 0.4) * z, z];
        let rotation = std::array::from_fn(|_| random.within(-1.0, 1.0));
        One { log_scale, rotation, ..One::at(position, 0.0) }
    };
    (0..50).map(one).collect()
}

fn shapes() -> Vec<Case> {
    let mut all = vec![
        // e^13.8 = 1e6.
        among("needles, axis ratio 1e6", |r| fifty(r, [-13.8, -13.8, 0.0])),
        among("blades, axes 1 : 1e-3 : 1e-6", |r| fifty(r, [0.0, -6.9, -13.8])),
        among("discs, axis ratio 1e6", |r| fifty(r, [-1.0, -1.0, -14.8])),
        among("long needles, 1e6 units", |r| fifty(r, [-3.0, -3.0, 13.8])),
        among("scale e^-20", |r| fifty(r, [-20.0; 3])),
        among("scale e^-40", |r| fifty(r, [-40.0; 3])),
        among("scale e^10", |r| fifty(r, [10.0; 3])),
        among("scale e^20", |r| fifty(r, [20.0; 3])),
        among("scale e^40", |r| fifty(r, [40.0; 3])),
        among("scales e^20, e^-20, 1", |r| fifty(r, [20.0, -20.0, 0.0])),
    ];
    for (name, antialiased) in [("specks, anti-aliased", true), ("specks, not anti-aliased", false)]
    {
        all.push(Case::new(name, AS_TWIN, move |bench| {
            let mut random = Random::new(3);
            let splats = with(cloud(8, 300, 0), fifty(&mut random, [-12.0; 3]));
            let options = RenderOptions { antialiased, ..RenderOptions::INRIA };
            let prior = Prior::from_splats(splats, options)?;
            Scenario { prior, ..Scenario::new(cloud(8, 1, 0))? }.run(bench)
        }));
    }
    all
}

/// Fifty splats of one logit.
fn of_logit(random: &mut Random, logit: f32) -> Vec<One> {
    fifty(random, [-1.5; 3]).into_iter().map(|one| One { logit, ..one }).collect()
}

fn opacities() -> Vec<Case> {
    vec![
        among("opacity 1 (logit 100)", |r| of_logit(r, 100.0)),
        among("opacity 0 (logit −100)", |r| of_logit(r, -100.0)),
        among("logit +∞", |r| of_logit(r, f32::INFINITY)),
        among("logit −∞", |r| of_logit(r, f32::NEG_INFINITY)),
        // 1/255 is the logit −5.5373.
        among("opacity at alpha's cut", |r| of_logit(r, -5.537_334)),
        among("opacity just above alpha's cut", |r| of_logit(r, -5.53)),
        among("opacity at alpha's clamp", |r| of_logit(r, 4.595_12)),
    ]
}

fn places() -> Vec<Case> {
    let mut all = vec![
        // The near plane is at 0.01.
        among("through the near plane", |r| {
            (0..40)
                .map(|_| One::at([r.within(-0.1, 0.1), r.within(-0.1, 0.1), 0.1], -2.0))
                .collect()
        }),
        among("just before the near plane", |r| {
            (0..40)
                .map(|i| One::at([r.within(-0.01, 0.01), 0.0, -0.08 + 2e-3 * i as f32], -6.0))
                .collect()
        }),
        among("behind", |r| {
            (0..50)
                .map(|_| One::at([r.within(-1.0, 1.0), 0.0, r.within(-9.0, -0.5)], -1.0))
                .collect()
        }),
        among("at the camera's centre", |_| {
            let centre = scenes::pose().centre().as_vec3().to_array();
            (0..10).map(|i| One::at(centre, i as f32 - 6.0)).collect()
        }),
        among("10,000 coincident", |r| {
            let one = |_| One {
                logit: -4.0,
                colour: [r.within(-1.0, 1.0); 3],
                ..One::at([0.3, 0.1, 4.0], -1.0)
            };
            (0..10_000).map(one).collect()
        }),
    ];
    all.push(Case::new("on the picture's edges and corners", AS_TWIN, |bench| {
        let camera = scenes::camera(64, 48);
        let at = |u: f32, v: f32| {
            let (x, y) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
            One::at([4.0 * x, 4.0 * y, 4.0], -3.0)
        };
        let corners =
            [0.0, 32.0, 64.0].into_iter().flat_map(|u| [0.0, 24.0, 48.0].map(|v| at(u, v)));
        // A step would put them off the edge.
        Scenario { pose: Pose::IDENTITY, ..Scenario::new(only(corners))? }.run(bench)
    }));
    all.push(Case::new("nothing in view", NOTHING, |bench| {
        let behind = (0..20).map(|i| One::at([0.1 * i as f32, 0.0, -3.0], -2.0));
        let scenario = Scenario::new(only(behind))?;
        let mut rows = scenario.run(bench)?;
        for row in &mut rows {
            let still = row.descent.is_none_or(|d| d.start == d.end);
            row.expect(still, || "the search moved".into());
        }
        Ok(rows)
    }));
    all.push(Case::new("depth ties", "equal depths are drawn in the order of the file", ties));
    all.push(Case::new("SH coefficients 1e6", AS_TWIN, |bench| {
        let mut splats = cloud(9, 100, 3);
        let mut random = Random::new(9);
        splats.sh.iter_mut().step_by(5).for_each(|v| *v = random.within(-1e6, 1e6));
        Scenario::new(splats)?.run(bench)
    }));
    all
}

fn ties(bench: &Bench) -> anyhow::Result<Vec<Row>> {
    let since = Instant::now();
    let mut splats = cloud(10, 5_000, 0);
    splats.positions.iter_mut().for_each(|p| p[2] = if p[0] > 0.0 { 3.0 } else { 4.0 });
    let scene = bench.engine.upload(&scenes::prior(splats)?)?;
    let camera = scenes::camera(64, 48);
    let stages = Probe::of(&bench.engine).stages(
        &scene,
        &camera,
        &Pose::IDENTITY,
        1 << 20,
        SortPrecision::Exact,
    )?;
    let places: Vec<u32> = (0..5_000).collect();
    let (_, order) = radix::sort_visible(&stages.keys, &places);
    let mut row = Row::of("exact sort", since);
    row.expect(stages.order == order, || "another order than by depth, then index".into());
    row.note = format!("{} visible", order.len());
    Ok(vec![row])
}

type Spoil = fn(&mut Splats, usize);

fn invalid() -> Vec<Case> {
    let fields: [(&str, Fault, Spoil); 9] = [
        ("NaN in a position", Fault::NonFinite, |s, i| s.positions[i][1] = f32::NAN),
        ("∞ in a position", Fault::NonFinite, |s, i| s.positions[i][2] = f32::INFINITY),
        ("NaN in a scale", Fault::NonFinite, |s, i| s.log_scales[i][0] = f32::NAN),
        ("∞ in a scale", Fault::NonFinite, |s, i| s.log_scales[i][0] = f32::INFINITY),
        ("NaN in a quaternion", Fault::NonFinite, |s, i| s.rotations[i][3] = f32::NAN),
        ("NaN in a logit", Fault::NonFinite, |s, i| s.opacity_logits[i] = f32::NAN),
        ("∞ in a coefficient", Fault::NonFinite, |s, i| s.sh[12 * i + 11] = f32::INFINITY),
        ("zero quaternion", Fault::Rotation, |s, i| s.rotations[i] = [0.0; 4]),
        ("scale e^41", Fault::Scale, |s, i| s.log_scales[i][2] = 41.0),
    ];
    let mut all: Vec<Case> = fields
        .into_iter()
        .map(|(name, fault, spoil)| {
            Case::new(name, REFUSED, move |bench| refused(bench, fault, spoil))
        })
        .collect();
    all.push(Case::new("quaternions of length 1e-5 to 1e30", AS_TWIN, |bench| {
        let mut splats = cloud(11, 300, 1);
        for (i, q) in splats.rotations.iter_mut().enumerate() {
            let scale = 10_f32.powi(i as i32 % 36 - 5);
            *q = q.map(|v| v * scale);
        }
        Scenario::new(splats)?.run(bench)
    }));
    all
}

fn refused(bench: &Bench, fault: Fault, spoil: Spoil) -> anyhow::Result<Vec<Row>> {
    let since = Instant::now();
    let valid = cloud(12, 100, 1);
    let mut splats = with(valid.clone(), [One::at([0.0, 0.0, 3.0], 0.0); 2]);
    spoil(&mut splats, 100);
    spoil(&mut splats, 101);
    let (mixed, valid) = (scenes::prior(splats)?, scenes::prior(valid)?);
    let dropped = mixed.report().dropped.clone();
    let draw = |prior: &Prior| -> anyhow::Result<Vec<f32>> {
        let scene = bench.engine.upload(prior)?;
        let mut renderer =
            bench.engine.renderer(&scene, &scenes::camera(64, 48), Plan::picture())?;
        Ok(renderer.draw(&scenes::pose())?.to_vec())
    };
    let same = draw(&mixed)? == draw(&valid)?;
    let mut row = Row::of("load", since);
    row.expect(same, || "the splat left a trace".into());
    let told = matches!(&dropped[..], [d] if d.fault == fault && d.count == 2 && d.first == 100);
    row.expect(told, || format!("reported as {dropped:?}"));
    row.note = dropped.iter().map(|d| d.to_string()).collect();
    Ok(vec![row])
}

fn many(quick: bool) -> Vec<Case> {
    let mut all = Vec::new();
    for (count, spread) in [(50_000, 0.4), (100_000, 0.4), (600_000, 0.01)] {
        if quick && count > 50_000 {
            continue;
        }
        let name = format!("{count} splats in one tile");
        let expected = "as by the twin, or refused because the driver ends the shader's loop; nothing is asked of \
                        a search on 8×8 pixels";
        all.push(Case::new(name, expected, move |bench| one_tile(bench, count, spread)));
    }
    let sizes = if quick {
        vec![(100_000, 0)]
    } else {
        vec![(1_000_000, 0), (1_000_000, 3), (4_000_000, 0)]
    };
    for (count, degree) in sizes {
        let name = format!("{count} splats of degree {degree}");
        all.push(Case::new(name, TOO_LARGE, move |bench| large(bench, count, degree)));
    }
    if !quick {
        all.push(Case::new("more pairs than the device holds", TOO_LARGE, too_many_pairs));
    }
    all
}

/// Most splats touch only the first pixel of an 8×8 picture. The other pixels, which show what lies behind them all,
/// must go through the whole list.
fn one_tile(bench: &Bench, count: usize, spread: f32) -> anyhow::Result<Vec<Row>> {
    let camera = nvsprior::Camera { width: 8, height: 8, fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0 };
    let mut random = Random::new(count as u64);
    let mut splats = Splats::default();
    for _ in 0..count {
        let (u, v) = (random.within(0.5 - spread, 0.5 + spread), random.within(0.3, 0.7));
        let z = random.within(3.0, 4.0);
        let position = [(u - 4.0) / 8.0 * z, (v - 4.0) / 8.0 * z, z];
        let colour = std::array::from_fn(|_| random.within(-1.0, 1.0));
        scenes::push(&mut splats, One { logit: -5.0, colour, ..One::at(position, -6.0) });
    }
    scenes::push(&mut splats, One { logit: 6.0, ..One::at([0.0, 0.0, 9.0], 1.0) });
    let limits =
        Limits { twin_searches: false, descends: false, may_refuse: true, ..Limits::default() };
    let offset = [1e-3, 0.0, 0.0, 0.0, 0.0, 0.0];
    let scenario =
        Scenario { camera, limits, offset, pose: Pose::IDENTITY, ..Scenario::new(splats)? };
    scenario.run(bench)
}

/// A million splats and more.
fn large(bench: &Bench, count: usize, degree: u32) -> anyhow::Result<Vec<Row>> {
    let since = Instant::now();
    let mut splats = cloud(20, count, degree);
    // As large as in a scene with many splats that cover the picture a few times.
    let shrunk = 0.5 * (count as f32 / 1000.0).ln();
    splats.log_scales.iter_mut().flatten().for_each(|s| *s -= shrunk);
    let prior = scenes::prior(splats)?;
    let camera = scenes::camera(320, 180);
    let mut row = Row::of("upload", since);
    let outcome = bench.engine.upload(&prior).and_then(|scene| {
        let plan = Plan { jacobians: vec![Jacobian::Flow], ..Plan::picture() };
        let mut renderer = bench.engine.renderer(&scene, &camera, plan)?;
        let since = Instant::now();
        let drawn = renderer.draw(&scenes::pose())?;
        let finite = drawn.iter().all(|v| v.is_finite());
        row.path = "picture";
        row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
        row.expect(finite, || "not all numbers".into());
        Ok(())
    });
    drawn_or_refused(&mut row, outcome);
    Ok(vec![row])
}

/// Notes the error of a device that does not hold a scene. Any other error is a fault.
fn drawn_or_refused(row: &mut Row, outcome: Result<(), Error>) {
    match outcome {
        Ok(()) => {}
        Err(error @ (Error::BufferTooLarge { .. } | Error::TooManyPairs)) => {
            row.note = format!("refused: {error}");
        }
        Err(error) => row.faults.push(error.to_string()),
    }
}

/// Each splat covers every tile: 3,000 × 16,384 pairs.
fn too_many_pairs(bench: &Bench) -> anyhow::Result<Vec<Row>> {
    let since = Instant::now();
    let prior = scenes::prior(only((0..3_000).map(|_| One::at([0.0, 0.0, 3.0], 3.0))))?;
    let scene = bench.engine.upload(&prior)?;
    let mut renderer =
        bench.engine.renderer(&scene, &scenes::camera(1024, 1024), Plan::picture())?;
    let outcome = renderer.draw(&Pose::IDENTITY).map(|_| ());
    let mut row = Row::of("picture", since);
    drawn_or_refused(&mut row, outcome);
    Ok(vec![row])
}
