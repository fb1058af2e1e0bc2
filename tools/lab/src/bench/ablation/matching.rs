//! The matching loss (the paper's eq. match, after iComMa): mean squared distance, in pixels, between
//! the 20 best matched keypoints of camera and render.
//!
//! The paper takes matches from LoFTR, a network, and descends the loss's gradient through it and the renderer. Here
//! keypoints are classical ([`super::features`]). The render's depth gives each of its keypoints a point in space. One
//! fit ([`super::reprojection`]) finds the pose that brings these points onto the camera's keypoints. Its loss is
//! robust, as classical matches are more often wrong. Then the prior is rendered and matched again. So a round is one
//! evaluation of the loss and one render, and does the work of many of the paper's iterations.

use std::time::Instant;

use glam::DVec3;
use image::{GrayImage, Luma};
use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::render::{Plan, Renderer};
use nvsprior::{Camera, Pose};

use super::super::context::{Context, Shot};
use super::features::{Detector, Feature, matches};
use super::method::Attempt;
use super::reprojection::{Pair, fit};

/// Matches that count (paper: K = 20).
const MAX_PAIRS: usize = 20;
/// A pose has six parameters, a match has two: with fewer than this many, nothing tells wrong ones.
const MIN_PAIRS: usize = 4;
const ROUNDS: usize = 15;
/// The search is done if the matched points move less than this on average, pixels.
const STILL: f64 = 0.05;
/// Renders thinner than this have no depth.
const OPAQUE: f32 = 0.5;
/// Floats of a pixel: linear red, green and blue, depth, transmittance.
const PIXEL: usize = 5;

/// Searches by the matching loss.
pub struct Matching {
    detector: Detector,
    renderer: Option<(Camera, Renderer)>,
}

impl Matching {
    pub fn new() -> Matching {
        Matching { detector: Detector::new(), renderer: None }
    }

    /// Searches from a start. By its own loss the outcome is never worse than the start.
    pub fn minimise(
        &mut self,
        context: &mut Context,
        shot: usize,
        start: &Pose,
    ) -> anyhow::Result<Attempt> {
        let forward_ms = {
            let pose = context.best[shot].pose;
            context.forward.measure(&context.shots[shot].camera, &pose)?
        };
        let Shot { camera, picture, .. } = &context.shots[shot];
        let (detector, renderer) = (&self.detector, renderer(&mut self.renderer, context, camera)?);
        let since = Instant::now();
        let seen =
            detector.detect(&grey(picture.data.chunks_exact(3), camera, |v| f32::from(*v)))?;
        let (mut pose, mut best) = (*start, (f64::INFINITY, *start));
        let (mut rounds, mut stop) = (0, "rounds");
        while rounds < ROUNDS {
            rounds += 1;
            let pairs = pairs(detector, &seen, camera, renderer.draw(&pose)?)?;
            if pairs.len() < MIN_PAIRS {
                stop = "matches";
                break;
            }
            let loss = loss(camera, &pairs, &Pose::IDENTITY);
            if loss < best.0 {
                best = (loss, pose);
            }
            let motion = fit(camera, &pairs);
            let next = motion.after(&pose);
            if !next.is_finite() || moved(camera, &pairs, &motion) < STILL {
                stop = "still";
                break;
            }
            pose = next;
        }
        let frame = context.scene.coordinate_frame();
        let code = QuantisedPose::quantise(&best.1, &frame, PoseProfile::Compact)?;
        renderer.draw_coded(&code.words())?;
        Ok(Attempt {
            pose: code.dequantise(&frame),
            iterations: rounds,
            full_renders: rounds as u32 + 1,
            milliseconds: since.elapsed().as_secs_f64() * 1e3,
            forward_ms,
            stop: stop.to_owned(),
        })
    }
}

/// The renderer of a camera.
fn renderer<'a>(
    slot: &'a mut Option<(Camera, Renderer)>,
    context: &Context,
    camera: &Camera,
) -> anyhow::Result<&'a mut Renderer> {
    let kept = match slot.take() {
        Some(kept) if kept.0 == *camera => kept,
        _ => (*camera, context.engine.renderer(&context.scene, camera, Plan::picture())?),
    };
    Ok(&mut slot.insert(kept).1)
}

/// Luma (Rec. 601) of pixels, values up to 255.
fn grey<'a, T: 'a>(
    pixels: impl Iterator<Item = &'a [T]>,
    camera: &Camera,
    value: impl Fn(&T) -> f32,
) -> GrayImage {
    let mut picture = GrayImage::new(camera.width, camera.height);
    for (into, pixel) in picture.pixels_mut().zip(pixels) {
        let [red, green, blue] = [&pixel[0], &pixel[1], &pixel[2]].map(&value);
        *into = Luma([(0.299 * red + 0.587 * green + 0.114 * blue + 0.5).clamp(0.0, 255.0) as u8]);
    }
    picture
}

/// The best matches that have a point in space.
fn pairs(
    detector: &Detector,
    seen: &[Feature],
    camera: &Camera,
    render: &[f32],
) -> anyhow::Result<Vec<Pair>> {
    let picture = grey(render.chunks_exact(PIXEL), camera, |v| 255.0 * v.clamp(0.0, 1.0));
    let mut drawn = detector.detect(&picture)?;
    drawn.retain(|feature| place(camera, render, feature.at).is_some());
    let pair = |(i, j): (usize, usize)| {
        Some(Pair { place: place(camera, render, drawn[j].at)?, seen: seen[i].at })
    };
    Ok(matches(seen, &drawn, MAX_PAIRS).into_iter().filter_map(pair).collect())
}

/// The point in space of a place in the render, in camera axes.
fn place(camera: &Camera, render: &[f32], [x, y]: [f64; 2]) -> Option<DVec3> {
    let at = (y as usize).min(camera.height as usize - 1) * camera.width as usize
        + (x as usize).min(camera.width as usize - 1);
    let pixel = &render[at * PIXEL..][..PIXEL];
    let opacity = 1.0 - pixel[4];
    let depth = f64::from(pixel[3] / opacity);
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    let place = DVec3::new((x - cx) / fx, (y - cy) / fy, 1.0) * depth;
    (opacity > OPAQUE && depth > 0.0 && place.is_finite()).then_some(place)
}

/// The matching loss after a motion, square pixels.
fn loss(camera: &Camera, pairs: &[Pair], motion: &Pose) -> f64 {
    let square = |pair: &Pair| {
        let [x, y] = project(camera, motion.rotation * pair.place + motion.translation);
        (x - pair.seen[0]).powi(2) + (y - pair.seen[1]).powi(2)
    };
    pairs.iter().map(square).sum::<f64>() / pairs.len() as f64
}

/// How far a motion moves the points, pixels.
fn moved(camera: &Camera, pairs: &[Pair], motion: &Pose) -> f64 {
    let distance = |pair: &Pair| {
        let [ax, ay] = project(camera, pair.place);
        let [bx, by] = project(camera, motion.rotation * pair.place + motion.translation);
        f64::hypot(ax - bx, ay - by)
    };
    pairs.iter().map(distance).sum::<f64>() / pairs.len() as f64
}

fn project(camera: &Camera, p: DVec3) -> [f64; 2] {
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    [fx * p.x / p.z + cx, fy * p.y / p.z + cy]
}
