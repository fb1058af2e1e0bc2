//! The vehicle of the paper's system.

use std::sync::Arc;
use std::time::Instant;

use nvsprior::image::Preprocessor;
use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::render::{Jacobian, Plan, Renderer, Scene};
use nvsprior::tracking::{Evaluation, Objective, RefineOptions, StartKind};
use nvsprior::{Camera, Encoded, Engine, FrameInfo, FrameStats, Picture, Pose, Rate};

use crate::descent::{Choice, DescentOptions, Optimizer, Poses, choose_start, minimise};
use crate::error::Error;
use crate::packet::{HEAD_LEN, Packet, SESSION_LEN, Session};
use crate::webp::WebpEncoder;

/// How to encode.
#[derive(Clone, Debug)]
pub struct EncoderOptions {
    /// The search.
    pub descent: DescentOptions,
    /// Mean squared error, values in [0, 1], below which a search starts at the pose of the frame before (paper: 1e-3
    /// in a basin, 1e-2 on real footage).
    pub threshold: f64,
    /// How fine the difference picture is; `None`: none is sent.
    pub rate: Option<Rate>,
    /// Frames come already treated as the prior's preprocessing says.
    pub frames_treated: bool,
}

impl Default for EncoderOptions {
    fn default() -> EncoderOptions {
        EncoderOptions {
            descent: DescentOptions::default(),
            threshold: 1e-3,
            rate: Some(Rate::Quality(10.0)),
            frames_treated: false,
        }
    }
}

/// Encodes the frames of one camera, in order.
pub struct Encoder {
    engine: Engine,
    scene: Arc<Scene>,
    options: EncoderOptions,
    preprocessor: Preprocessor,
    view: View,
    /// What the next frame may start from.
    poses: Poses,
    frame: u32,
    states_session: bool,
}

/// What a camera's frames take.
struct View {
    camera: Camera,
    search: Search,
    /// Draws the picture that is sent.
    renderer: Renderer,
    webp: WebpEncoder,
}

enum Search {
    /// By the methods of this crate.
    Descent(Box<Objective>),
    /// By the engine's own.
    GaussNewton(Box<nvsprior::Encoder>),
}

/// What a search came to.
struct SearchResult {
    pose: Pose,
    stats: FrameStats,
}

impl Encoder {
    /// Makes an encoder of frames of `camera`'s size.
    ///
    /// # Errors
    /// If no picture can be drawn with the camera, or the device lacks memory.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        options: EncoderOptions,
    ) -> Result<Encoder, Error> {
        let preprocessing = match options.frames_treated {
            true => &Default::default(),
            false => scene.preprocessing(),
        };
        Ok(Encoder {
            engine: engine.clone(),
            scene: scene.clone(),
            preprocessor: Preprocessor::new(preprocessing),
            view: View::new(engine, scene, camera, &options)?,
            options,
            poses: Poses::default(),
            frame: 0,
            states_session: true,
        })
    }

    /// Sets another camera for all frames from here on. Poses carry over.
    ///
    /// # Errors
    /// As for [`Encoder::new`]. The camera before then stays.
    pub fn set_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        if *camera != self.view.camera {
            self.view = View::new(&self.engine, &self.scene, camera, &self.options)?;
            self.states_session = true;
        }
        Ok(())
    }

    /// Forgets all earlier frames: the next one needs a pose from outside.
    pub fn reset(&mut self) {
        self.poses = Poses::default();
        self.states_session = true;
        if let Search::GaussNewton(encoder) = &mut self.view.search {
            encoder.reset();
        }
    }

    /// Evaluations of the last frame's search, in order: error against run time.
    pub fn trace(&self) -> &[Evaluation] {
        match &self.view.search {
            Search::Descent(objective) => objective.trace(),
            Search::GaussNewton(encoder) => encoder.trace(),
        }
    }

    /// Encodes a frame. `info`: a pose from outside, from which the search starts if the frame before gives no good
    /// start. In the statistics `certain` is the paper's own rule: the error at the pose is below the threshold.
    ///
    /// # Errors
    /// If the frame has not the camera's size, or there is no pose to start from.
    pub fn encode(
        &mut self,
        frame: &Picture,
        info: impl Into<FrameInfo>,
    ) -> Result<Encoded, Error> {
        let (since, info) = (Instant::now(), info.into());
        self.view.check(frame)?;
        let mut treated = frame.clone();
        self.preprocessor.apply(&mut treated);
        let SearchResult { pose, mut stats } = self.search(&treated, info)?;
        let (pose, mut render) = self.view.draw(&self.scene, &pose)?;
        stats.frame = self.frame;
        stats.full_renders += 1;
        stats.portable = self.engine.device().portable;
        stats.render_psnr = treated.psnr(&render);
        stats.refine_milliseconds = milliseconds(since);
        let coded = Instant::now();
        let (packet, picture) = self.code(&treated, &mut render, pose, &mut stats)?;
        stats.code_milliseconds = milliseconds(coded);
        stats.milliseconds = milliseconds(since);
        self.frame = self.frame.wrapping_add(1);
        self.states_session = false;
        let pose = pose.dequantise(&self.scene.coordinate_frame());
        Ok(Encoded { packet, picture, render, pose, stats })
    }

    fn search(&mut self, frame: &Picture, info: FrameInfo) -> Result<SearchResult, Error> {
        let threshold = self.options.threshold;
        let objective = match &mut self.view.search {
            Search::GaussNewton(encoder) => {
                let found = encoder.encode(frame, info)?;
                return Ok(SearchResult { pose: found.pose, stats: found.stats });
            }
            Search::Descent(objective) => objective,
        };
        objective.set_frame(frame);
        let before = objective.renderer().renders()[0];
        let external = info.hint.map(|hint| hint.pose);
        let choice = choose_start(&self.poses, objective, external, threshold)?;
        let Choice { pose, kind } = choice.ok_or(Error::NoStart { frame: self.frame })?;
        let outcome = minimise(objective, &pose, &self.options.descent)?;
        let certain = outcome.mse < threshold;
        let stats = FrameStats {
            full_renders: objective.renderer().renders()[0] - before,
            start: kind,
            stop: outcome.stop,
            observability: *objective.observability(),
            certain,
            ..FrameStats::default()
        };
        self.poses.add(outcome.pose, kind != StartKind::External);
        Ok(SearchResult { pose: outcome.pose, stats })
    }

    /// The packet, and what the topside will show.
    fn code(
        &mut self,
        frame: &Picture,
        render: &mut Picture,
        pose: QuantisedPose,
        stats: &mut FrameStats,
    ) -> Result<(Vec<u8>, Picture), Error> {
        let session = self
            .states_session
            .then_some(Session { prior: self.scene.id(), camera: self.view.camera });
        let head = HEAD_LEN + session.map_or(0, |_| SESSION_LEN);
        let mut packet = Vec::new();
        let mut write = |payload| Packet { pose, session, payload }.write(&mut packet);
        let picture = match self.options.rate {
            Some(rate) => {
                let coded = self.view.webp.encode(frame, render, rate, head)?;
                write(coded.payload);
                (stats.psnr, stats.rate_kept) = (coded.psnr, coded.reached);
                coded.reconstruction.clone()
            }
            None => {
                write(None);
                (stats.psnr, stats.rate_kept) = (stats.render_psnr, true);
                render.clone()
            }
        };
        (stats.bytes, stats.latent_bytes) = (packet.len(), HEAD_LEN);
        Ok((packet, picture))
    }
}

impl View {
    fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        options: &EncoderOptions,
    ) -> Result<View, Error> {
        camera.check().map_err(nvsprior::Error::from)?;
        let search = match options.descent.optimizer {
            Optimizer::GaussNewton => {
                let options = nvsprior::EncoderOptions {
                    rate: None,
                    truth: false,
                    threshold: options.threshold,
                    // This crate has treated them.
                    frames_treated: true,
                    ..Default::default()
                };
                Search::GaussNewton(Box::new(nvsprior::Encoder::new(
                    engine, scene, camera, options,
                )?))
            }
            _ => {
                let plan = Plan {
                    factors: vec![1, 2, 4, 8],
                    jacobians: vec![Jacobian::Exact],
                    search: None,
                    sort_precision: RefineOptions::default().sort_precision,
                    depths: false,
                    profiled: false,
                };
                Search::Descent(Box::new(Objective::new(engine.renderer(scene, camera, plan)?)))
            }
        };
        let renderer = engine.renderer(scene, camera, Plan::picture())?;
        let webp = WebpEncoder::new(camera.width, camera.height);
        Ok(View { camera: *camera, search, renderer, webp })
    }

    fn check(&self, frame: &Picture) -> Result<(), Error> {
        let expected = (self.camera.width, self.camera.height);
        let found = (frame.width, frame.height);
        match expected == found && frame.data.len() == self.camera.pixels() * 3 {
            true => Ok(()),
            false => Err(nvsprior::Error::FrameSize { expected, found }.into()),
        }
    }

    /// The pose as a packet holds it, and its picture.
    fn draw(&mut self, scene: &Scene, pose: &Pose) -> Result<(QuantisedPose, Picture), Error> {
        let frame = scene.coordinate_frame();
        let pose =
            QuantisedPose::quantise(pose, &frame, PoseProfile::Free).map_err(|_| Error::Pose)?;
        let mut render = Picture::new(self.camera.width, self.camera.height);
        self.renderer.coded_picture(&pose.words(), &mut render)?;
        Ok((pose, render))
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
