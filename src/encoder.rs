//! The vehicle's side: frames in, packets out.

mod measured;

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::frame_time::FrameTime;
use crate::frame_work::{Coders, FrameWork, TrackedStream};
use crate::image::{ColourOrder, Mask, Preprocessing, Preprocessor};
use crate::packet::{
    Latent, PacketError, PoseBound, PoseProfile, QuantisedPose, SentPoses, Session,
};
use crate::prior::PoseTrials;
use crate::queue::Interrupt;
use crate::render::{Plan, Scene};
use crate::residual::{Acknowledged, Interest, Mode, ResidualSetup, Tune, Viewpoint};
use crate::tracking::{
    Clock, Covariance, Evaluation, FrameInfo, Objective, PoseEstimate, RefineOptions, Tracker,
    deviations,
};
use crate::{Camera, Encoded, Engine, Error, FrameStats, Picture, Rate};

use measured::Coding;

/// How to encode.
#[derive(Clone, Debug)]
pub struct EncoderOptions {
    /// How to refine poses.
    pub refine: RefineOptions,
    /// Mean squared error, values in [0, 1] (1e-2 suits real footage). The search compares the pictures to tell whether
    /// a pose is right. If the prior shows too little for that, it keeps a pose whose error is below this, and does not
    /// search afresh.
    pub threshold: f64,
    /// How fine the difference picture is; `None`: none is sent.
    pub rate: Option<Rate>,
    /// What counts most in the picture.
    pub tune: Tune,
    /// Whether difference pictures are predicted from those of earlier frames. They do not if the device is not
    /// portable: the topside could not know their references.
    pub mode: Mode,
    /// State the session, prior and camera, again after this many frames, for a topside that missed it; 0: never again.
    /// It is also stated with the first frame, when the camera changes, and after a reset. It takes 29 bytes.
    pub camera_interval: u32,
    /// When packets have a check of the render.
    pub render_checks: RenderChecks,
    /// Number of the first frame.
    pub first_frame: u32,
    /// Reduction factors of the pyramid, finest first, beginning with 1.
    pub factors: Vec<u32>,
    /// Poses are stated as what they differ by from those that the topside is known to hold
    /// ([`Encoder::acknowledge_pose`]), in latent parts of 11 to 19 bytes in place of 20. The pose is the same.
    pub predict_poses: bool,
    /// Packets tell how far the picture is from what the camera saw: see [`crate::truth`]. Not if there is no
    /// [`rate`](EncoderOptions::rate).
    pub truth: bool,
    /// Most time that a frame takes, from [`Encoder::encode`] to its packet; `None`: as long as its search takes. Once
    /// it is up, the best pose so far is drawn, coded and sent. The search goes on in the next frames. What one render
    /// and one coding take is measured when the encoder is made, which also has the driver compile.
    /// With it the same frames need not give the same packets; any of them decodes to the same picture anywhere.
    pub frame_time: Option<Duration>,
    /// The clock that [`frame_time`](EncoderOptions::frame_time) goes by: the system's, or one of a test.
    pub clock: Clock,
    /// Frames come already treated as the prior's [`preprocessing`](crate::Prior::preprocessing) says. The encoder then
    /// leaves them as they are; else it treats them.
    pub frames_treated: bool,
}

/// When packets have a check of the render, of six bytes. It tells a topside on another kind of device whether its
/// render is the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RenderChecks {
    /// Never.
    #[default]
    Never,
    /// With the first frame, and again after this many frames, one or more.
    Every(u32),
    /// With packets that state the session, until the topside has acknowledged a frame. If this device is not portable,
    /// always with those.
    AsNeeded,
}

impl RenderChecks {
    /// After this many frames; 0: never.
    pub fn every(frames: u32) -> RenderChecks {
        if frames == 0 { RenderChecks::Never } else { RenderChecks::Every(frames) }
    }
}

/// Spreads of the prior beyond which no pose from outside can lie.
const FAR: f64 = 1e6;

impl Default for EncoderOptions {
    fn default() -> Self {
        EncoderOptions {
            refine: RefineOptions::default(),
            threshold: 1e-3,
            rate: Some(Rate::Quality(10.0)),
            tune: Tune::default(),
            mode: Mode::default(),
            camera_interval: 64,
            render_checks: RenderChecks::Never,
            first_frame: 0,
            factors: vec![1, 2, 4, 8],
            predict_poses: false,
            truth: true,
            frame_time: None,
            clock: Clock::default(),
            frames_treated: false,
        }
    }
}

/// Encodes the frames of one camera, in order.
pub struct Encoder {
    engine: Engine,
    scene: Arc<Scene>,
    camera: Camera,
    options: EncoderOptions,
    tracker: Tracker,
    /// Which pixels of frames count; `None`: all do.
    mask: Option<Arc<Mask>>,
    interest: Option<Arc<Interest>>,
    /// See [`Encoder::set_steady_bytes`].
    is_steady: bool,
    /// Treats frames as the prior's pictures were.
    preprocessor: Preprocessor,
    coders: Coders,
    work: FrameWork,
    /// Renders by level before the frame.
    renders_before: Vec<u32>,
    frame: u32,
    /// Frames since the session was last stated; `None`: not yet.
    session_age: Option<u32>,
    /// No frame of the stream may be predicted from one before the next.
    stream_ended: bool,
    /// What the topside is known to hold.
    acknowledged: Acknowledged,
    /// The topside has acknowledged a frame, so it draws the prior as this side does.
    confirmed: bool,
    /// What is known of the poses that the topside holds; `None`: none is predicted from them.
    poses: Option<SentPoses>,
    /// The last time that a frame stated.
    time: Option<f64>,
    /// `None`: frames take as long as their search takes.
    frame_time: Option<FrameTime>,
    interrupt: Interrupt,
    colour_order: ColourOrder,
}

impl Encoder {
    /// Makes an encoder of frames of `camera`'s size.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        options: EncoderOptions,
    ) -> Result<Encoder, Error> {
        let interrupt = Interrupt::default();
        let made = objective(engine, scene, camera, &options, &interrupt)?;
        let (objective, frame_time) = timed(made, engine, camera, &options)?;
        let profile = PoseProfile::Compact.word();
        let tracker = Tracker::new(objective, options.refine, options.threshold, profile);
        Ok(Encoder {
            engine: engine.clone(),
            scene: scene.clone(),
            camera: *camera,
            frame: options.first_frame,
            tracker,
            mask: None,
            interest: None,
            is_steady: false,
            preprocessor: preprocessor(scene, &options),
            coders: Coders::new(
                &residual_setup(engine, scene, camera, &options),
                has_truth(&options),
            ),
            poses: predicts_poses(&options).then(SentPoses::default),
            options,
            work: FrameWork::default(),
            renders_before: Vec::new(),
            session_age: None,
            stream_ended: false,
            acknowledged: Acknowledged::default(),
            confirmed: false,
            time: None,
            frame_time,
            interrupt,
            colour_order: ColourOrder::default(),
        })
    }

    /// Sets which pixels of frames count from here on; `None`: all do. The others, such as those that show the
    /// vehicle's own arm, count neither in the search nor in the PSNR. Their difference is zero: the topside shows the
    /// prior's render there. A coarse coding may change it a little beside pixels that count.
    ///
    /// # Errors
    /// If the mask has not the camera's size, or no pixel counts. The mask before then stays.
    pub fn set_mask(&mut self, mask: Option<&Mask>) -> Result<(), Error> {
        self.mask = checked(mask.cloned(), &self.camera)?;
        self.tracker.set_mask(self.mask.clone());
        Ok(())
    }

    /// Sets another camera, or another size, for all frames from here on. Poses carry over. The mask is scaled with it.
    pub fn set_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        let mask = self.mask.as_ref().map(|mask| mask.resized(camera.width, camera.height));
        self.set_view(camera, mask)
    }

    /// Sets camera and mask. If it fails, both stay.
    #[doc(hidden)]
    pub fn set_view(&mut self, camera: &Camera, mask: Option<Mask>) -> Result<(), Error> {
        let mask = checked(mask, camera)?;
        if *camera != self.camera {
            let made = self.objective(&self.engine, &self.scene, camera)?;
            let (objective, frame_time) = timed(made, &self.engine, camera, &self.options)?;
            self.tracker.replace(objective);
            self.frame_time = frame_time;
            let same_size =
                (camera.width, camera.height) == (self.camera.width, self.camera.height);
            self.camera = *camera;
            if !same_size {
                self.coders = Coders::new(&self.residual_setup(), has_truth(&self.options));
            }
            self.session_age = None;
        }
        self.mask = mask;
        self.tracker.set_mask(self.mask.clone());
        Ok(())
    }

    /// Sets which parts of the picture get more of the bits from here on: what the pilot looks at. `None`: all count
    /// the same. At the same budget the other parts get fewer; [`Rate::Psnr`] stays that of the whole picture.
    pub fn set_interest(&mut self, interest: Option<Interest>) {
        self.interest = interest.map(Arc::new);
    }

    /// Sets how fine the difference pictures are from here on: links change.
    pub fn set_rate(&mut self, rate: Option<Rate>) {
        (self.options.rate, self.is_steady) = (rate, false);
    }

    /// Sets the bytes of packets from here on, for a link: a packet that also states the session, or has a check of the
    /// render, has as many more as these take. So its difference picture is as fine as those of other frames. If pose
    /// and session alone take more than all of that, the packet has these alone.
    pub fn set_steady_bytes(&mut self, bytes: usize) {
        (self.options.rate, self.is_steady) = (Some(Rate::Bytes(bytes)), true);
    }

    /// Tells the encoder that the topside has decoded a frame in full, residual and all:
    /// [`Decoded::kept`](crate::Decoded::kept). In a stream of
    /// [`Structure::Acknowledged`](crate::residual::Structure::Acknowledged) later frames are predicted from it.
    /// `frame` may be modulo 2¹⁶, as reports tell it. Frames that are unknown, or too old to be a reference frame,
    /// change nothing.
    pub fn acknowledge(&mut self, frame: u32) {
        self.acknowledged.add(frame);
        self.confirmed = true;
    }

    /// Tells the encoder whether the topside holds the pose of a frame, as [`Decoder::hold`](crate::Decoder::hold) took
    /// it in and `nvsprior_link::modem::Report::poses` tells. With [`EncoderOptions::predict_poses`] later
    /// poses are predicted from it, as long as it is one of the last 64 frames. `frame` may be modulo 2¹⁶.
    pub fn acknowledge_pose(&mut self, frame: u32, held: bool) {
        self.confirmed |= held;
        if let Some(poses) = &mut self.poses {
            poses.acknowledge(frame, held);
        }
    }

    /// The setup of the coder for a camera's difference pictures.
    pub(crate) fn residual_setup(&self) -> ResidualSetup {
        residual_setup(&self.engine, &self.scene, &self.camera, &self.options)
    }

    /// Goes on with another engine, after the device of the old one was lost. `scene` is the same
    /// prior, uploaded there. Frame numbers and poses carry over. If it fails, nothing changes.
    pub fn move_to(&mut self, engine: &Engine, scene: &Arc<Scene>) -> Result<(), Error> {
        let (expected, found) = (self.scene.id(), scene.id());
        if expected != found {
            return Err(Error::PriorChanged { expected, found });
        }
        let made = self.objective(engine, scene, &self.camera)?;
        let (objective, frame_time) = timed(made, engine, &self.camera, &self.options)?;
        self.tracker.replace(objective);
        self.frame_time = frame_time;
        self.tracker.set_mask(self.mask.clone());
        (self.engine, self.scene) = (engine.clone(), scene.clone());
        self.preprocessor = preprocessor(scene, &self.options);
        self.coders.begin_streams(&self.residual_setup());
        Ok(())
    }

    fn objective(
        &self,
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
    ) -> Result<Objective, Error> {
        objective(engine, scene, camera, &self.options, &self.interrupt)
    }

    /// What ends a frame under way, from any thread.
    #[doc(hidden)]
    pub fn interrupt(&self) -> &Interrupt {
        &self.interrupt
    }

    /// States the session with the next packet. In a stream its frame is intra. Call it if a topside asks what the
    /// packets are about, or if a packet was not sent.
    pub fn announce(&mut self) {
        self.session_age = None;
        self.stream_ended = true;
        self.forget_poses();
    }

    fn forget_poses(&mut self) {
        self.poses.iter_mut().for_each(SentPoses::forget_acknowledged);
    }

    /// The camera of the next frame.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Encodes a frame. First it is treated as the prior's pictures were, unless [`EncoderOptions::frames_treated`]
    /// says that it is. All that follows is about the treated frame: the search, the difference picture, and the PSNR
    /// in [`FrameStats`](crate::FrameStats). `info`: when the frame was taken, and a pose from sensors or an
    /// estimator, used if the frame before gives no good start. It may be a [`Pose`](crate::Pose), an `Option` of one,
    /// a [`Hint`](crate::Hint), or a [`FrameInfo`].
    ///
    /// # Errors
    /// If the frame cannot be encoded, or `info` cannot be true. Such a frame changes nothing: the next one goes on
    /// from the frame before.
    pub fn encode(
        &mut self,
        frame: &Picture,
        info: impl Into<FrameInfo>,
    ) -> Result<Encoded, Error> {
        let mut encoded = Encoded::default();
        self.encode_into(frame, info, &mut encoded)?;
        Ok(encoded)
    }

    /// As [`Encoder::encode`], but replaces what `encoded` held. Allocates nothing from the second
    /// frame on, unless a view of the prior needs more room than any before.
    pub fn encode_into(
        &mut self,
        frame: &Picture,
        info: impl Into<FrameInfo>,
        encoded: &mut Encoded,
    ) -> Result<(), Error> {
        self.check_frame(frame)?;
        let mut work = std::mem::take(&mut self.work);
        work.frame.clone_from(frame);
        work.info = info.into();
        std::mem::swap(&mut work.encoded, encoded);
        let done = self.encode_filled(&mut work);
        std::mem::swap(&mut work.encoded, encoded);
        self.work = work;
        done
    }

    /// As [`Encoder::encode_into`], for a frame that was filled in.
    #[doc(hidden)]
    pub fn encode_filled(&mut self, work: &mut FrameWork) -> Result<(), Error> {
        let found = self.track(work)?;
        work.code(&mut self.coders)?;
        self.keep(work, &found)
    }

    /// The last frame that [`encode`](Self::encode) searched a pose for, as it was treated. Its masked pixels show the
    /// render. It is empty before the first frame, and not kept in a [`Pipeline`](crate::Pipeline).
    pub fn treated_frame(&self) -> &Picture {
        &self.work.frame
    }

    /// Takes a frame, and does the first half of it: see [`Encoder::track_filled`].
    pub(crate) fn track_next(
        &mut self,
        frame: &Picture,
        info: FrameInfo,
        work: &mut FrameWork,
    ) -> Result<(), Error> {
        self.check_frame(frame)?;
        work.frame.clone_from(frame);
        work.info = info;
        self.track_filled(work)
    }

    /// The first half of a frame that was filled in: finds its pose and draws it. The next frame goes on from there.
    #[doc(hidden)]
    pub fn track_filled(&mut self, work: &mut FrameWork) -> Result<(), Error> {
        let found = self.track(work)?;
        self.keep(work, &found)
    }

    /// Treats a frame, finds its pose and draws it. Changes nothing that the next frame goes on from.
    fn track(&mut self, work: &mut FrameWork) -> Result<PoseEstimate, Error> {
        let since = Instant::now();
        let limit = self.frame_time.as_ref().map(FrameTime::limit);
        self.check_frame(&work.frame)?;
        self.check_info(&work.info)?;
        let info = work.info.relative_to(self.scene.origin());
        self.renders_before.clear();
        self.renders_before.extend_from_slice(self.tracker.objective().renderer().renders());
        let states_session = self.session_due();
        let profile = if states_session { PoseProfile::Compact } else { PoseProfile::Short };
        self.tracker.set_profile(profile.word());
        self.treat(work);
        self.tracker.set_time_limit(limit);
        work.coding = self.frame_time.as_ref().map(|time| time.coding.clone());
        let found = self.tracker.track(&work.frame, &info)?;
        let found = found.ok_or(Error::NoStart { frame: self.frame })?;
        let pose = self.coded_pose(&found, profile)?;
        self.set_stream(&pose, work);
        work.has_render_check = self.check_due(states_session);
        work.residual = Some(self.residual_setup());
        work.has_truth = has_truth(&self.options);
        let renderer = self.tracker.objective().renderer();
        work.render.resize(self.camera.width, self.camera.height);
        work.render.data.copy_from_slice(renderer.rendered());
        work.stats.colours_exchanged = self.colour_order.is_exchanged(&work.frame, &work.render);
        if let Some(mask) = &self.mask {
            let render = &work.render.data;
            let as_render = |at: usize, rgb: &mut [u8]| rgb.copy_from_slice(&render[at..at + 3]);
            mask.each_masked(&mut work.frame.data, as_render);
        }
        let here = pose.dequantise(&self.scene.coordinate_frame());
        work.pose = here.absolute_from(self.scene.origin());
        let session = Session { prior: self.scene.id(), camera: self.camera };
        let (covariance, known) = self.stated(&found, &pose);
        let latent = Latent {
            portable: self.engine.device().portable,
            known,
            ..Latent::new(self.frame, &session, pose, !found.certain)?
        };
        let latent = match self.poses.as_ref().filter(|_| found.certain && !states_session) {
            Some(poses) => poses.predicted(&latent, &session)?,
            None => latent,
        };
        (work.latent, work.session) = (Some(latent), Some(session));
        work.states_session = states_session;
        work.rate = self.options.rate;
        work.is_steady = self.is_steady;
        let unit = self.scene.coordinate_frame().unit();
        work.stats.covariance = covariance;
        work.stats.known = known.map(|bound| bound.of_unit(unit));
        work.stats.portable = latent.portable;
        self.note(&found, &mut work.stats);
        work.stats.refine_milliseconds = since.elapsed().as_secs_f64() * 1e3;
        Ok(found)
    }

    /// Treats the frame as the prior's pictures were.
    fn treat(&mut self, work: &mut FrameWork) {
        work.mask.clone_from(&self.mask);
        work.interest.clone_from(&self.interest);
        self.preprocessor.apply_by(&mut work.frame, self.mask.as_deref());
        if let Some(mask) = &self.mask {
            mask.level_out(&mut work.frame);
        }
    }

    /// How far a pose may be off, and within how much it is known.
    fn stated(
        &self,
        found: &PoseEstimate,
        pose: &QuantisedPose,
    ) -> (Covariance, Option<PoseBound>) {
        let frame = self.scene.coordinate_frame();
        let mut covariance = found.stated_covariance(self.scene.pose_doubt());
        let rounding = pose.rounding(&frame);
        (0..6).for_each(|i| covariance[i][i] += rounding[i / 3]);
        let navigable = self.scene.pose_doubt() <= PoseTrials::MAX_DOUBT;
        let bound = PoseBound::of(&deviations(&covariance), frame.unit());
        (covariance, bound.filter(|_| navigable))
    }

    /// Notes what the search took and gave.
    fn note(&mut self, found: &PoseEstimate, stats: &mut FrameStats) {
        stats.renders.clear();
        let renderer = self.tracker.objective().renderer();
        let renders = renderer.renders().iter().zip(&self.renders_before);
        stats.renders.extend(renders.map(|(after, before)| after - before));
        stats.full_renders = stats.renders[0];
        stats.frame = self.frame;
        stats.reference = None;
        stats.start = found.start;
        stats.stop = found.outcome.stop;
        stats.submissions = found.submissions;
        stats.observability = found.observability;
        stats.certain = found.certain;
        stats.out_of_time = self.tracker.out_of_time();
        stats.frames_since_certain = self.frames_since_certain_with(found);
    }

    /// States what the frame may be predicted from.
    fn set_stream(&mut self, pose: &QuantisedPose, work: &mut FrameWork) {
        let renderer = self.tracker.objective().renderer();
        work.depths.clear();
        work.stream = match self.options.mode {
            Mode::Stream(structure) if self.engine.device().portable => {
                work.depths.extend(renderer.depths());
                let placement = renderer.placed(&pose.words());
                Some(TrackedStream {
                    viewpoint: Viewpoint { camera: self.camera, placement },
                    structure,
                    acknowledged: self.acknowledged,
                    first: self.stream_ended,
                })
            }
            _ => None,
        };
    }

    /// [`frames_since_certain`](crate::FrameStats::frames_since_certain) of the next frame.
    fn frames_since_certain_with(&self, found: &PoseEstimate) -> u32 {
        if found.certain { 0 } else { self.tracker.frames_since_certain().saturating_add(1) }
    }

    /// Keeps what the next frame goes on from.
    fn keep(&mut self, work: &FrameWork, found: &PoseEstimate) -> Result<(), Error> {
        if let (Some(poses), Some(latent), Some(session)) =
            (self.poses.as_mut(), work.latent, work.session)
        {
            poses.add(&latent, &session)?;
        }
        let age = self.session_age.unwrap_or(0) + 1;
        self.session_age = Some(if work.states_session { 1 } else { age });
        self.stream_ended = false;
        self.frame = self.frame.wrapping_add(1);
        self.time = work.info.time.or(self.time);
        self.tracker.keep(found);
        Ok(())
    }

    /// Leaves out so many camera frames: the next one's number is as much greater. If numbers count all camera frames,
    /// the topside knows which it has not been sent, and can draw them at poses between those that it has.
    pub fn skip(&mut self, frames: u32) {
        self.frame = self.frame.wrapping_add(frames);
    }

    /// Number of the next frame.
    pub fn frame_number(&self) -> u32 {
        self.frame
    }

    /// Forgets all earlier frames: the next one is searched for as the first was, and may have any time. Frame numbers
    /// go on, and the next packet states the session.
    pub fn reset(&mut self) {
        self.tracker.reset();
        self.time = None;
        self.session_age = None;
        self.stream_ended = true;
        self.acknowledged = Acknowledged::default();
        self.confirmed = false;
        self.forget_poses();
    }

    /// Renders up to `max` of the prior's key frames that are not rendered yet, and returns how many are left. With
    /// them lost cameras are found. Without this call they are rendered while a frame is lost, as many as
    /// [`RefineOptions::lost_renders`] allows. Each takes one render and some 20 ms of the host.
    pub fn prepare(&mut self, max: usize) -> Result<usize, Error> {
        Ok(self.tracker.prepare(max)?)
    }

    /// Checks what is stated of the next frame.
    #[doc(hidden)]
    pub fn check_info(&self, info: &FrameInfo) -> Result<(), Error> {
        info.check(self.frame, self.time)?;
        let Some(hint) = &info.relative_to(self.scene.origin()).hint else { return Ok(()) };
        let frame = self.scene.coordinate_frame();
        let distance = (hint.pose.centre() - self.scene.centre()).length();
        if distance > FAR * f64::from(frame.spread) {
            return Err(Error::HintFar { frame: self.frame, distance });
        }
        Ok(())
    }

    /// Whether the frame is whole and of the camera's size.
    fn check_frame(&self, frame: &Picture) -> Result<(), Error> {
        let expected = (self.camera.width, self.camera.height);
        let found = (frame.width, frame.height);
        if expected != found || frame.data.len() != self.camera.pixels() * 3 {
            return Err(Error::FrameSize { expected, found });
        }
        Ok(())
    }

    /// The pose as the packet will hold it. Its picture is drawn, unless the search has drawn it.
    fn coded_pose(
        &mut self,
        found: &PoseEstimate,
        profile: PoseProfile,
    ) -> Result<QuantisedPose, Error> {
        let frame = self.scene.coordinate_frame();
        let pose = match &found.drawn {
            Some(code) => QuantisedPose::of_words(code)?,
            None => QuantisedPose::quantise(&found.outcome.pose, &frame, profile)?,
        };
        if pose.profile() == PoseProfile::Free {
            // It lies beyond what a packet holds.
            return Err(PacketError::Pose.into());
        }
        if found.drawn.is_none() {
            self.tracker.objective().renderer().draw_coded_as_planned(&pose.words())?;
        }
        Ok(pose)
    }

    fn check_due(&self, states_session: bool) -> bool {
        match self.options.render_checks {
            RenderChecks::Never => false,
            RenderChecks::Every(frames) => {
                let done = self.frame.wrapping_sub(self.options.first_frame);
                done.checked_rem(frames) == Some(0)
            }
            RenderChecks::AsNeeded => {
                states_session && !(self.confirmed && self.engine.device().portable)
            }
        }
    }

    /// Whether the next packet states the session.
    fn session_due(&self) -> bool {
        let interval = self.options.camera_interval;
        self.session_age.is_none_or(|age| interval > 0 && age >= interval)
    }

    /// Evaluations of the last frame's refinement, in order: error against run time.
    pub fn trace(&self) -> &[Evaluation] {
        self.tracker.trace()
    }
}

/// Whether packets get truth maps.
fn has_truth(options: &EncoderOptions) -> bool {
    options.truth
}

/// Whether poses may be predicted from those that the topside holds.
fn predicts_poses(options: &EncoderOptions) -> bool {
    options.predict_poses
}

/// A mask, if it masks anything.
fn checked(mask: Option<Mask>, camera: &Camera) -> Result<Option<Arc<Mask>>, Error> {
    let Some(mask) = mask else { return Ok(None) };
    let (expected, found) = ((camera.width, camera.height), (mask.width, mask.height));
    if expected != found || mask.data.len() != camera.pixels() {
        return Err(Error::MaskSize { expected, found });
    }
    match mask.count() {
        0 => Err(Error::MaskEmpty),
        count => Ok((count < mask.data.len()).then(|| Arc::new(mask))),
    }
}

/// What treats frames; as it says, possibly nothing does.
fn preprocessor(scene: &Scene, options: &EncoderOptions) -> Preprocessor {
    let none = Preprocessing::NONE;
    Preprocessor::new(if options.frames_treated { &none } else { scene.preprocessing() })
}

fn residual_setup(
    engine: &Engine,
    scene: &Scene,
    camera: &Camera,
    options: &EncoderOptions,
) -> ResidualSetup {
    ResidualSetup {
        width: camera.width,
        height: camera.height,
        tune: options.tune,
        tables: scene.coder_tables().clone(),
        portable: engine.device().portable,
    }
}

fn objective(
    engine: &Engine,
    scene: &Arc<Scene>,
    camera: &Camera,
    options: &EncoderOptions,
    interrupt: &Interrupt,
) -> Result<Objective, Error> {
    camera.check()?;
    let plan = Plan {
        factors: options.factors.clone(),
        jacobians: Vec::new(),
        search: Some(options.refine.jacobian),
        sort_precision: options.refine.sort_precision,
        depths: options.mode != Mode::Intra,
        profiled: false,
    };
    let mut renderer = engine.renderer(scene, camera, plan)?;
    renderer.set_interrupt(interrupt);
    Ok(Objective::new(renderer))
}

/// Measures what frames take with an objective, if their time is bounded.
fn timed(
    mut objective: Objective,
    engine: &Engine,
    camera: &Camera,
    options: &EncoderOptions,
) -> Result<(Objective, Option<FrameTime>), Error> {
    let Some(most) = options.frame_time else { return Ok((objective, None)) };
    let setup = &residual_setup(engine, objective.renderer().scene(), camera, options);
    let how = Coding { setup, rate: options.rate, has_truth: has_truth(options) };
    let time = measured::frame_time(most, &mut objective, camera, &how, &options.clock)?;
    Ok((objective, Some(time)))
}
