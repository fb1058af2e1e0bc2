//! The same prior on every device of the machine: how far their pictures differ, and what a topside makes of another
//! device's packets.

use std::sync::Arc;
use std::time::Instant;

use nvsprior::render::{Plan, Scene};
use nvsprior::vulkan::{DeviceOptions, Error};
use nvsprior::{
    Camera, Decoder, Encoder, EncoderOptions, Engine, Picture, Pose, Prior, RenderChecks,
    RenderOptions, RenderOverrides,
};

use super::case::{Bench, Case, Done, Group, Row, Table};
use super::{poses, scenes};

pub const GROUP: Group = Group {
    name: "devices",
    about: "Every Vulkan device of the machine against the first: pictures of 320×180 from the same \
            poses, and packets of one decoded on the other. `scripts/second-driver.sh` sets a second \
            driver beside the first if there is only one device.",
    cases,
};

const SAME: &str = "equal but for rounding: fewer than one pixel in a hundred differs, the decoded frame \
                    by less than 0.05 dB; the topside is told if a render differs";

const POSES: usize = 8;
/// No machine has more devices.
const MAX_DEVICES: usize = 16;

fn cases(bench: &Bench) -> Vec<Case> {
    let mut all = vec![
        case("plane with relief", || Ok(poses::plane(4.0, 0.3)), Pose::IDENTITY),
        case("cloud of 2000", || Ok(scenes::cloud(61, 2000, 3)), scenes::pose()),
    ];
    if let Some(path) = bench.prior.clone() {
        all.push(Case::new("trained prior", SAME, move |bench| {
            let near = Some(RenderOptions::INRIA.near);
            let prior =
                Prior::open(&path, &RenderOverrides { near, ..RenderOverrides::default() })?;
            let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
            let back = glam::DVec3::Z * f64::from(prior.coordinate_frame().spread);
            compare(bench, &prior, &Pose::from_centre(glam::DQuat::IDENTITY, centre - back))
        }));
    }
    all
}

fn case(
    name: &'static str,
    splats: fn() -> anyhow::Result<nvsprior::prior::Splats>,
    pose: Pose,
) -> Case {
    Case::new(name, SAME, move |bench| {
        let prior = Prior::from_splats(splats()?, RenderOptions::GSPLAT)?;
        compare(bench, &prior, &pose)
    })
}

/// A device, and what it made of the prior.
struct Side {
    engine: Engine,
    scene: Arc<Scene>,
    pictures: Vec<Picture>,
    milliseconds: f64,
}

impl Side {
    fn new(engine: Engine, prior: &Prior, camera: &Camera, pose: &Pose) -> anyhow::Result<Side> {
        let scene = engine.upload(prior)?;
        let mut renderer = engine.renderer(&scene, camera, Plan::picture())?;
        let mut pictures = Vec::new();
        let mut since = Instant::now();
        for t in 0..=POSES {
            let mut picture = Picture::new(camera.width, camera.height);
            renderer.picture(&along(pose, t.saturating_sub(1)), &mut picture)?;
            if t == 0 {
                // Drivers finish their work at first use.
                since = Instant::now();
            } else {
                pictures.push(picture);
            }
        }
        let milliseconds = since.elapsed().as_secs_f64() * 1e3 / POSES as f64;
        Ok(Side { engine, scene, pictures, milliseconds })
    }
}

/// The pose of frame `t`.
fn along(pose: &Pose, t: usize) -> Pose {
    let t = t as f64;
    pose.stepped(&[0.02 * t, -0.01 * t, 0.015 * t, 0.003 * t, 0.004 * t, -0.002 * t])
}

fn compare(bench: &Bench, prior: &Prior, pose: &Pose) -> anyhow::Result<Done> {
    let camera = scenes::camera(320, 180);
    let mut sides = Vec::new();
    for number in 0..MAX_DEVICES {
        let device = Some(number.to_string());
        match Engine::new(&DeviceOptions { device, ..DeviceOptions::default() }) {
            Ok(engine) => sides.push(Side::new(engine, prior, &camera, pose)?),
            Err(Error::NoDevice { .. } | Error::UnknownDevice { .. }) => break,
            Err(error) => return Err(error.into()),
        }
    }
    if sides.is_empty() {
        sides.push(Side::new(bench.engine.clone(), prior, &camera, pose)?);
    }
    let (first, others) = sides.split_at_mut(1);
    let first = &mut first[0];
    let mut done = Done::default();
    let mut lines = Vec::new();
    for other in std::iter::once(&*first).chain(&*others) {
        let (row, line) = against(first, other, &camera, pose)?;
        done.rows.push(row);
        lines.push(line);
    }
    done.tables.push(Table {
        title: format!("Devices: {} splats", prior.len()),
        about: "Bytes of 8-bit pictures against those of the first device, and the packet's frame \
                decoded there: PSNR against the camera's frame, less that of the vehicle's own picture.",
        header: vec!["device", "greatest", "mean", "bytes that differ", "decoded, dB", "ms per picture"],
        rows: lines,
    });
    Ok(done)
}

/// How a device's pictures differ from the first one's.
fn against(
    first: &Side,
    other: &Side,
    camera: &Camera,
    pose: &Pose,
) -> anyhow::Result<(Row, Vec<String>)> {
    let since = Instant::now();
    let (mut max, mut sum, mut differ, mut count) = (0_u8, 0_u64, 0_u64, 0_u64);
    for (a, b) in first.pictures.iter().zip(&other.pictures) {
        for (a, b) in a.data.iter().zip(&b.data) {
            let off = a.abs_diff(*b);
            max = max.max(off);
            sum += u64::from(off);
            differ += u64::from(off > 0);
            count += 1;
        }
    }
    let share = differ as f64 / count as f64;
    let mut row = Row::of("pictures, packets", since);
    let lost = decoded_elsewhere(first, other, camera, pose, &mut row)?;
    let portable = first.engine.device().portable && other.engine.device().portable;
    let (max_share, max_lost) = if portable { (0.0, 0.0) } else { (0.01, 0.05) };
    row.expect(share <= max_share, || format!("{share:.2e} of the bytes differ"));
    row.expect(lost.abs() <= max_lost, || format!("decoded {lost:.3} dB off"));
    row.note = format!("{}: by {max} at most", other.engine.device().driver);
    row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
    let line = vec![
        other.engine.device().to_string(),
        max.to_string(),
        format!("{:.1e}", sum as f64 / count as f64),
        format!("{share:.1e}"),
        format!("{lost:+.4}"),
        format!("{:.1}", other.milliseconds),
    ];
    Ok((row, line))
}

/// What frames lose if another device than the vehicle's decodes them, dB, and whether the topside
/// knows.
fn decoded_elsewhere(
    first: &Side,
    other: &Side,
    camera: &Camera,
    pose: &Pose,
    row: &mut Row,
) -> anyhow::Result<f64> {
    let options =
        EncoderOptions { render_checks: RenderChecks::Every(1), ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&first.engine, &first.scene, camera, options)?;
    let mut decoder = Decoder::new(&other.engine, &other.scene);
    let mut renderer = other.engine.renderer(&other.scene, camera, Plan::picture())?;
    let (mut lost, mut random) = (0.0, scenes::Random::new(62));
    for (t, picture) in first.pictures.iter().enumerate() {
        let mut frame = picture.clone();
        for v in &mut frame.data {
            *v = (f32::from(*v) + random.within(-16.0, 16.0)) as u8;
        }
        let encoded = encoder.encode(&frame, (t == 0).then_some(*pose))?;
        let decoded = decoder.decode(&encoded.packet)?;
        let mut render = Picture::new(camera.width, camera.height);
        let code = nvsprior::Packet::decode(&encoded.packet)?.latent.pose.words();
        renderer.coded_picture(&code, &mut render)?;
        let same = render == encoded.render;
        row.expect(decoded.same_render == Some(same), || {
            format!("frame {t}: told {:?}, is {same}", decoded.same_render)
        });
        lost += decoded.picture.psnr(&frame) - encoded.stats.psnr;
    }
    Ok(lost / POSES as f64)
}
