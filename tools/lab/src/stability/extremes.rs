//! What must hold for every random extreme scene. The tests compile this file too.

use std::fmt;

use nvsprior::prior::{CoordinateFrame, PriorError};
use nvsprior::random::Random;
use nvsprior::render::{Jacobian, NormalEquations, Plan, SortPrecision};
use nvsprior::tracking::RefineOptions;
use nvsprior::{Decoder, Encoder, EncoderOptions, Engine, Error, Picture, Prior, Rate};
use nvsprior_reference::Twin;
use nvsprior_reference::extreme::{Extreme, one_of};

use super::explained::{Explained, undecided};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checked {
    Drawn,
    /// All splats were invalid, and refused.
    Refused,
}

#[derive(Debug)]
pub struct Fault(pub String);

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl<E: std::error::Error> From<E> for Fault {
    fn from(error: E) -> Fault {
        Fault(format!("an unexpected error: {error}"))
    }
}

fn ensure(holds: bool, otherwise: impl FnOnce() -> String) -> Result<(), Fault> {
    if holds { Ok(()) } else { Err(Fault(otherwise())) }
}

/// Draws the scene of a seed and differentiates it. Searches and sends one scene in four, and compares one in eight
/// with the twin.
pub fn check(engine: &Engine, seed: u64) -> Result<Checked, Fault> {
    let scene = Extreme::new(seed);
    let prior = match Prior::from_splats(scene.splats.clone(), scene.options) {
        Err(PriorError::AllDropped { .. }) => return Ok(Checked::Refused),
        prior => prior?,
    };
    let drawn = draw(engine, &prior, &scene)?;
    if seed.is_multiple_of(4) {
        send(engine, &prior, &scene, seed)?;
    }
    if seed.is_multiple_of(8) {
        as_twin(&prior, &scene, &drawn)?;
    }
    Ok(Checked::Drawn)
}

/// The picture and both normal equations: all numbers, within their bounds.
fn draw(engine: &Engine, prior: &Prior, scene: &Extreme) -> Result<Vec<f32>, Fault> {
    let Extreme { camera, pose, offset, .. } = scene;
    let uploaded = engine.upload(prior)?;
    let jacobians = vec![Jacobian::Flow, Jacobian::Exact];
    let plan = Plan { jacobians: jacobians.clone(), ..Plan::picture() };
    let mut renderer = engine.renderer(&uploaded, camera, plan)?;
    let drawn = renderer.draw(pose)?.to_vec();
    for (at, pixel) in drawn.chunks_exact(5).enumerate() {
        let valid = pixel.iter().all(|v| v.is_finite() && *v >= 0.0) && pixel[4] <= 1.0;
        ensure(valid, || format!("pixel {at}: {pixel:?}"))?;
    }
    ensure(drawn.len() == camera.pixels() * 5, || "another size".into())?;
    let mut random = Random::new(1);
    let frame: Vec<f32> = (0..camera.pixels() * 3).map(|_| random.within(0.0, 1.0)).collect();
    renderer.set_frame(0, &frame);
    for jacobian in jacobians {
        let at = pose.stepped(offset);
        let e = renderer.normal_equations(0, jacobian, &at)?;
        if !are_valid(&e) {
            // Searches do not step to poses with sums beyond f32. Only there the sums may be no numbers.
            let twin = Twin::new(prior).normal_equations(camera, &at, &frame, jacobian);
            let largest = twin.jtj.iter().flatten().chain([&twin.square]);
            let largest = largest.fold(0.0, |m: f64, v| m.max(v.abs()));
            ensure(!(largest < BEYOND), || format!("{jacobian:?}: {e:?}, twin {twin:?}"))?;
        }
    }
    Ok(drawn)
}

/// If the twin's sums reach this, those in f32 need not be numbers.
const BEYOND: f64 = 1e36;

fn are_valid(e: &NormalEquations) -> bool {
    let numbers = e.jtj.iter().flatten().chain(&e.jtr).all(|v| v.is_finite());
    numbers && e.square.is_finite() && e.square >= 0.0 && (0..6).all(|k| e.jtj[k][k] >= 0.0)
}

/// Encodes the picture of the scene from a start near its pose. The topside must show the same.
fn send(engine: &Engine, prior: &Prior, scene: &Extreme, seed: u64) -> Result<(), Fault> {
    let Extreme { camera, pose, offset, .. } = scene;
    let mut random = Random::new(seed);
    let uploaded = engine.upload(prior)?;
    let mut frame = Picture::new(camera.width, camera.height);
    engine.renderer(&uploaded, camera, Plan::picture())?.picture(pose, &mut frame)?;
    let noise = one_of(&mut random, &[0, 0, 10, 255]);
    for value in &mut frame.data {
        *value = value.saturating_add((random.bits() % (noise + 1)) as u8);
    }
    let refine = RefineOptions {
        jacobian: one_of(&mut random, &[Jacobian::Flow, Jacobian::Exact]),
        sort_precision: one_of(&mut random, &[SortPrecision::Exact, SortPrecision::Coarse]),
        ..RefineOptions::default()
    };
    let rate = one_of(&mut random, &[None, Some(Rate::Quality(10.0)), Some(Rate::Bytes(300))]);
    let options = EncoderOptions { refine, rate, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(engine, &uploaded, camera, options)?;
    let start = pose.stepped(offset);
    let encoded = match encoder.encode(&frame, Some(start)) {
        // If no packet can hold the pose, an error must say so.
        Err(Error::Packet(_)) => return Ok(()),
        // A start beyond a million spreads is refused, and no other.
        Err(Error::HintFar { .. }) => {
            let CoordinateFrame { centre, spread } = prior.coordinate_frame();
            let centre = glam::Vec3::from(centre).as_dvec3();
            let spreads = (start.centre() - centre).length() / f64::from(spread);
            return ensure(spreads > 1e6, || format!("refused: a start at {spreads:e} spreads"));
        }
        encoded => encoded?,
    };
    ensure(encoded.pose.is_finite(), || "the pose found is no number".into())?;
    let decoded = Decoder::new(engine, &uploaded).decode(&encoded.packet)?;
    ensure(decoded.picture == encoded.picture, || "the topside shows another picture".into())
}

/// Largest error of a channel beyond what rounding and close decisions explain.
const PICTURE: f64 = 1e-3;

fn as_twin(prior: &Prior, scene: &Extreme, drawn: &[f32]) -> Result<(), Fault> {
    if undecided(prior, &scene.pose) {
        return Ok(());
    }
    let difference = Explained::new(prior, &scene.camera, &scene.pose)?.compare(drawn);
    ensure(difference.excess <= PICTURE, || difference.worst)
}
