//! Extreme pictures and cameras.

use std::time::Instant;

use nvsprior::prior::Splats;
use nvsprior::render::Plan;
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Camera, Decoder, Encoder, EncoderOptions, Error, Picture, Pose, Rate};

use super::case::{Bench, Case, Descent, Group, Row};
use super::measure::Scenario;
use super::scenes::{self, One, Random, cloud, noise};

pub const GROUP: Group = Group {
    name: "pictures",
    about: "Frames that show nothing of the prior, or little, and cameras of every size and shape; a \
            cloud of 300 splats unless the case says otherwise.",
    cases,
};

const NO_WORSE: &str = "equations as the twin's; the search ends no worse than it began, or above 50 dB; the topside \
    shows what was encoded";
const AS_TWIN: &str = "drawn and differentiated as by the twin; the search ends no worse than it began, or above 50 \
    dB; the topside shows what was encoded";
const TOO_LARGE: &str =
    "drawn, encoded and decoded if the device holds it, else refused with what would fit";

fn cases(bench: &Bench) -> Vec<Case> {
    let mut all = frames();
    all.extend(sizes(bench.quick));
    all.extend(cameras());
    all
}

/// What is done to a frame that shows the prior.
type Spoil = fn(&mut Picture, &mut Random);

fn frames() -> Vec<Case> {
    let frames: [(&str, Spoil); 8] = [
        ("black", |p, _| p.data.fill(0)),
        ("white", |p, _| p.data.fill(255)),
        ("one colour", |p, _| {
            p.data.chunks_exact_mut(3).for_each(|c| c.copy_from_slice(&[9, 99, 66]))
        }),
        ("saturated: eight times as bright", |p, _| {
            p.data.iter_mut().for_each(|v| *v = v.saturating_mul(8));
        }),
        ("noise alone", |p, r| p.data.iter_mut().for_each(|v| *v = (r.bits() >> 56) as u8)),
        ("marine snow: 40 % of the pixels white", |p, r| {
            for pixel in p.data.chunks_exact_mut(3) {
                if r.within(0.0, 1.0) < 0.4 {
                    pixel.fill(255);
                }
            }
        }),
        ("half of it occluded", |p, _| {
            let half = p.data.len() / 2;
            p.data[..half].fill(20);
        }),
        ("one bright pixel", |p, _| {
            p.data.fill(0);
            p.data[3000] = 255;
        }),
    ];
    frames
        .into_iter()
        .map(|(name, spoil)| {
            Case::new(format!("frame: {name}"), NO_WORSE, move |bench| {
                let mut scenario = Scenario::new(cloud(30, 300, 1))?;
                let twin = nvsprior_reference::Twin::new(&scenario.prior);
                let mut frame = super::measure::eight_bit(
                    &twin.render(&scenario.camera, &scenario.pose),
                    &scenario.camera,
                );
                spoil(&mut frame, &mut Random::new(31));
                drop(twin);
                scenario.frame = Some(frame.clone());
                let mut rows = scenario.run(bench)?;
                rows.push(link(bench, &scenario, &frame)?);
                Ok(rows)
            })
        })
        .collect()
}

/// Encodes a frame and decodes its packet at several rates.
fn link(bench: &Bench, scenario: &Scenario, frame: &Picture) -> anyhow::Result<Row> {
    let since = Instant::now();
    let scene = bench.engine.upload(&scenario.prior)?;
    let start = scenario.pose.stepped(&scenario.offset);
    let mut row = Row::default();
    let mut bytes = Vec::new();
    for rate in
        [None, Some(Rate::Quality(10.0)), Some(Rate::Quality(100.0)), Some(Rate::Bytes(200))]
    {
        let options = EncoderOptions { rate, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(&bench.engine, &scene, &scenario.camera, options)?;
        let encoded = match encoder.encode(frame, Some(start)) {
            Ok(encoded) => encoded,
            Err(error) => {
                row.faults.push(format!("{rate:?}: {error}"));
                continue;
            }
        };
        let decoded = Decoder::new(&bench.engine, &scene).decode(&encoded.packet)?;
        row.expect(decoded.picture == encoded.picture, || format!("{rate:?}: another picture"));
        row.expect(decoded.damage.is_none(), || format!("{rate:?}: damaged"));
        bytes.push(encoded.packet.len().to_string());
        row.descent = Some(Descent {
            start: f64::NAN,
            end: encoded.picture.mse(frame),
            stop: encoded.stats.stop,
            evaluations: encoded.stats.renders.iter().sum::<u32>() as usize,
        });
    }
    row.note = format!("packets of {} bytes", bytes.join(", "));
    Ok(Row { path: "link", milliseconds: since.elapsed().as_secs_f64() * 1e3, ..row })
}

fn of_camera(name: String, camera: Camera) -> Case {
    Case::new(name, AS_TWIN, move |bench| {
        let scenario = Scenario { camera, ..Scenario::new(cloud(32, 300, 1))? };
        let mut rows = scenario.run(bench)?;
        let frame = noise(33, &camera);
        rows.push(link(bench, &scenario, &frame)?);
        Ok(rows)
    })
}

fn sizes(quick: bool) -> Vec<Case> {
    let mut all = Vec::new();
    let small = [
        (1, 1),
        (1, 2),
        (2, 1),
        (3, 3),
        (7, 5),
        (8, 8),
        (9, 17),
        (1, 64),
        (64, 1),
        (65, 49),
        (127, 3),
    ];
    for (width, height) in small {
        let (w, h) = (width as f32, height as f32);
        let focal = 0.86 * w.max(h);
        let camera = Camera { width, height, fx: focal, fy: focal, cx: 0.5 * w, cy: 0.5 * h };
        all.push(of_camera(format!("{width}×{height}"), camera));
    }
    let large = if quick {
        vec![(4096, 16)]
    } else {
        vec![(4096, 16), (16, 4096), (4096, 1024), (4096, 2160), (4096, 4096)]
    };
    for (width, height) in large {
        all.push(Case::new(format!("{width}×{height}"), TOO_LARGE, move |bench| {
            whole(bench, width, height)
        }));
    }
    all.push(Case::new("0×8 and 4097×8", "refused: sides lie in 1 to 4096", |bench| {
        let since = Instant::now();
        let scene = bench.engine.upload(&scenes::prior(cloud(1, 5, 0))?)?;
        let mut row = Row::default();
        for (width, height) in [(0, 8), (4097, 8)] {
            let camera = Camera { width, height, ..scenes::camera(8, 8) };
            let made =
                Encoder::new(&bench.engine, &scene, &camera, EncoderOptions::default()).map(|_| ());
            row.expect(matches!(made, Err(Error::Camera(_))), || {
                format!("{width}×{height}: {made:?}")
            });
        }
        Ok(vec![Row { milliseconds: since.elapsed().as_secs_f64() * 1e3, path: "encoder", ..row }])
    }));
    all
}

/// A large picture, encoded and decoded, without the twin, which would take minutes. Its middle is compared with the
/// same middle drawn by a small camera.
fn whole(bench: &Bench, width: u32, height: u32) -> anyhow::Result<Vec<Row>> {
    let since = Instant::now();
    let camera = scenes::camera(width, height);
    let prior = scenes::prior(cloud(34, 3_000, 1))?;
    let scene = bench.engine.upload(&prior)?;
    let mut row = Row::of("link", since);
    let outcome = (|| -> Result<String, Error> {
        let drawn = {
            let mut renderer = bench.engine.renderer(&scene, &camera, Plan::picture())?;
            let mut picture = Picture::new(width, height);
            renderer.picture(&scenes::pose(), &mut picture)?;
            picture
        };
        row.faults.extend(middle_differs(bench, &scene, &camera, &drawn)?);
        let mut encoder = Encoder::new(&bench.engine, &scene, &camera, EncoderOptions::default())?;
        let start = scenes::pose().stepped(&[0.003, 0.0, 0.0, 0.0, 0.002, 0.0]);
        let encoded = encoder.encode(&drawn, Some(start))?;
        let decoded = Decoder::new(&bench.engine, &scene).decode(&encoded.packet)?;
        row.expect(decoded.picture == encoded.picture, || "another picture".into());
        Ok(format!("packet of {} bytes", encoded.packet.len()))
    })();
    match outcome {
        Ok(note) => row.note = note,
        Err(Error::Vulkan(error @ DeviceError::BufferTooLarge { .. })) => {
            row.note = format!("refused: {error}")
        }
        Err(error) => row.faults.push(error.to_string()),
    }
    row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
    Ok(vec![row])
}

/// Tells how the middle of a picture differs from what a camera of the middle alone draws.
fn middle_differs(
    bench: &Bench,
    scene: &std::sync::Arc<nvsprior::render::Scene>,
    camera: &Camera,
    drawn: &Picture,
) -> Result<Option<String>, Error> {
    let (width, height) = (camera.width.min(64), camera.height.min(64));
    // Whole tiles, so that pixels have the same places in them.
    let (x, y) = ((camera.width - width) / 16 * 8, (camera.height - height) / 16 * 8);
    let part =
        Camera { width, height, cx: camera.cx - x as f32, cy: camera.cy - y as f32, ..*camera };
    let mut renderer = bench.engine.renderer(scene, &part, Plan::picture())?;
    let mut picture = Picture::new(width, height);
    renderer.picture(&scenes::pose(), &mut picture)?;
    let row = |y: u32, x: u32, of: &Picture| {
        let first = ((y * of.width + x) * 3) as usize;
        of.data[first..first + 3 * width as usize].to_vec()
    };
    let max = (0..height)
        .flat_map(|r| std::iter::zip(row(y + r, x, drawn), row(r, 0, &picture)))
        .map(|(a, b)| a.abs_diff(b))
        .max()
        .unwrap_or(0);
    // The small camera clamps covariances at another frustum, so splats beside it differ.
    Ok((max > 8).then(|| format!("the middle differs by {max} of 255")))
}

fn cameras() -> Vec<Case> {
    let base = scenes::camera(64, 48);
    // 170° across: f = w / 2 / tan 85°.
    let wide = 32.0 / 85_f32.to_radians().tan();
    let mut all: Vec<Case> = [
        ("principal point at (−200, −100)", Camera { cx: -200.0, cy: -100.0, ..base }),
        ("principal point at (400, 24)", Camera { cx: 400.0, cy: 24.0, ..base }),
        ("principal point at (1e6, 1e6)", Camera { cx: 1e6, cy: 1e6, ..base }),
        ("170° across", Camera { fx: wide, fy: wide, ..base }),
        ("179.9° across", Camera { fx: 0.028, fy: 0.028, ..base }),
        ("1/100° across", Camera { fx: 3.7e5, fy: 3.7e5, ..base }),
        ("fx 100 times fy", Camera { fx: 500.0, fy: 5.0, ..base }),
    ]
    .into_iter()
    .map(|(name, camera)| of_camera(name.into(), camera))
    .collect();
    all.push(Case::new(
        "intrinsics NaN, ∞, 0",
        "refused: what the camera's check names",
        |bench| {
            let since = Instant::now();
            let scene = bench.engine.upload(&scenes::prior(cloud(1, 5, 0))?)?;
            let mut row = Row::default();
            for camera in [
                Camera { fx: f32::NAN, ..scenes::camera(8, 8) },
                Camera { fy: 0.0, ..scenes::camera(8, 8) },
                Camera { cx: f32::INFINITY, ..scenes::camera(8, 8) },
            ] {
                let made = Encoder::new(&bench.engine, &scene, &camera, EncoderOptions::default())
                    .map(|_| ());
                row.expect(matches!(made, Err(Error::Camera(_))), || {
                    format!("{camera:?}: {made:?}")
                });
            }
            Ok(vec![Row {
                milliseconds: since.elapsed().as_secs_f64() * 1e3,
                path: "encoder",
                ..row
            }])
        },
    ));
    all.push(Case::new("total occlusion by one splat", AS_TWIN, |bench| {
        let mut splats = Splats::default();
        scenes::push(&mut splats, One { logit: 20.0, ..One::at([0.0, 0.0, 1.0], 3.0) });
        let scenario = Scenario::new(scenes::with(splats, []))?;
        scenario.run(bench)
    }));
    all.push(Case::new("a pose that is no number", "background alone", |bench| {
        let since = Instant::now();
        let scene = bench.engine.upload(&scenes::prior(cloud(35, 100, 1))?)?;
        let mut renderer = bench.engine.renderer(&scene, &base_camera(), Plan::picture())?;
        let mut pose = Pose::IDENTITY;
        pose.translation.x = f64::NAN;
        let drawn = renderer.draw(&pose)?;
        let background = drawn.chunks_exact(5).all(|p| *p == [0.25, 0.5, 0.75, 0.0, 1.0]);
        let mut row = Row::of("picture", since);
        row.expect(background, || "not the background".into());
        Ok(vec![row])
    }));
    all
}

fn base_camera() -> Camera {
    scenes::camera(64, 48)
}
