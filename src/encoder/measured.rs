//! Measures a render and a coding when an encoder is made: what a frame takes at least on its device.

use std::time::Duration;

use crate::frame_time::FrameTime;
use crate::frame_work::{Coders, FrameWork};
use crate::packet::{Latent, PoseProfile, QuantisedPose, Session};
use crate::render::Scene;
use crate::residual::ResidualSetup;
use crate::tracking::{Clock, Objective, StepTime, measured_steps};
use crate::{Camera, Error, Picture, Pose, Rate};

/// Key frames at which renders are timed.
const KEY_FRAMES: usize = 3;
/// How far the picture that is coded is moved against the render, pixels.
const SHIFT: usize = 2;

/// How frames are coded.
pub(super) struct Coding<'a> {
    pub setup: &'a ResidualSetup,
    pub rate: Option<Rate>,
    pub has_truth: bool,
}

/// Measures for frames that take at most `most`.
///
/// # Errors
/// [`Error::FrameTimeShort`] if one render and one coding take longer.
pub(super) fn frame_time(
    most: Duration,
    objective: &mut Objective,
    camera: &Camera,
    how: &Coding,
    clock: &Clock,
) -> Result<FrameTime, Error> {
    let scene = objective.renderer().scene().clone();
    let poses = views(&scene);
    let search = measured_steps(clock, objective, &poses)?;
    let coding = StepTime::new(clock);
    let mut render = Picture::new(camera.width, camera.height);
    objective.renderer().picture(&poses[0], &mut render)?;
    let mut coders = Coders::new(how.setup, how.has_truth);
    let mut work =
        FrameWork { rate: how.rate, coding: Some(coding.clone()), ..FrameWork::default() };
    for _ in 0..2 {
        let frame = scene.coordinate_frame();
        let pose = QuantisedPose::quantise(&poses[0], &frame, PoseProfile::Compact)?;
        let session = Session { prior: scene.id(), camera: *camera };
        work.latent = Some(Latent::new(0, &session, pose, false)?);
        work.render.clone_from(&render);
        work.frame.clone_from(&shifted(&render));
        match work.code(&mut coders) {
            // Nothing is coded then.
            Err(Error::Budget { .. }) => {}
            coded => coded?,
        }
    }
    FrameTime::new(most, search, coding)
}

/// Poses of key frames or, if there are none, one at which all of the prior is seen.
fn views(scene: &Scene) -> Vec<Pose> {
    let key_frames = scene.key_frames().poses();
    let step = key_frames.len().div_ceil(KEY_FRAMES).max(1);
    if !key_frames.is_empty() {
        return key_frames.iter().step_by(step).copied().collect();
    }
    let mut all = Pose::IDENTITY;
    all.translation = -scene.centre();
    all.translation.z += 2.0 * f64::from(scene.coordinate_frame().spread);
    vec![all]
}

/// A picture moved to the left: it differs from the render as one from another pose does.
fn shifted(render: &Picture) -> Picture {
    let mut frame = render.clone();
    let row = 3 * render.width as usize;
    let left = (3 * SHIFT).min(row);
    for row in frame.data.chunks_exact_mut(row.max(1)) {
        row.rotate_left(left);
    }
    frame
}
