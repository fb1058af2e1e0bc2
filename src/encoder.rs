//! The vehicle's side: frames in, packets out.

use std::sync::Arc;
use std::time::Instant;

#[cfg(feature = "training")]
use crate::frame_work::FoundFrame;
use crate::frame_work::{Coders, FrameWork, TrackedStream};
use crate::image::{Mask, Preprocessing, Preprocessor};
#[cfg(feature = "training")]
use crate::learning::{Beside, LearnOptions, LearnerStats};
use crate::packet::{
    CAMERA_PART_LEN, LEARNT_SHORT_LEN, Latent, PoseProfile, QuantisedPose, RENDER_PART_LEN,
    SHORT_LATENT_LEN, SentPoses, session_check,
};
use crate::prior::Learnt;
use crate::render::{Plan, Scene};
use crate::residual::{
    Acknowledged, Interest, Mode, ResidualCoder, ResidualSetup, Tune, Viewpoint,
};
use crate::tracking::{
    Evaluation, FrameInfo, Objective, Optimizer, PoseEstimate, RefineOptions, Tracker,
};
use crate::{Camera, Encoded, Engine, Error, Picture, Rate};

/// How to encode.
#[derive(Clone, Debug)]
pub struct EncoderOptions {
    /// How to refine poses.
    pub refine: RefineOptions,
    /// Mean squared error, values in [0, 1] (paper: 1e-3 in a basin, 1e-2 on real footage). The gradient methods start
    /// at the pose of the frame before if the error there is below this. Gauss–Newton compares the pictures to tell
    /// whether a pose is right. If the prior shows too little for that, it keeps a pose whose error is below this, and
    /// does not search afresh.
    pub threshold: f64,
    /// How fine the difference picture is; `None`: none is sent.
    pub rate: Option<Rate>,
    /// The coder of the difference picture.
    pub residual: ResidualCoder,
    /// What counts most in the picture; [`ResidualCoder::Webp`](crate::residual::ResidualCoder::Webp) does not look at
    /// it.
    pub tune: Tune,
    /// Whether difference pictures are predicted from those of earlier frames. They do not if the device is not
    /// portable: the topside could not know their references.
    pub mode: Mode,
    /// How poses are written.
    pub profile: PoseProfile,
    /// A packet has the short form if an earlier packet stated its prior and camera: a latent part of 19 bytes in place
    /// of 31, and a pose that costs the render less than 0.01 dB. Some packets keep the full form: the first one, those
    /// with the camera, the next after a reset, those of poses far from the prior, and those in the paper's profile.
    pub short: bool,
    /// Send the camera again after this many frames, for a topside that missed it; 0: never again.
    /// It is also sent with the first frame and when it changes.
    pub camera_interval: u32,
    /// Send a check of the render (six bytes) with the first frame, and again after this many
    /// frames; 0: never. It tells a topside on another kind of device whether its render is the
    /// same.
    pub check_interval: u32,
    /// Number of the first frame.
    pub first_frame: u32,
    /// Reduction factors of the pyramid, finest first, beginning with 1.
    pub factors: Vec<u32>,
    /// Poses are stated as what they differ by from those that the topside is known to hold
    /// ([`Encoder::acknowledge_pose`]), in 9 to 18 bytes in place of 19: for packets that travel in
    /// [protected shares](crate::modem::Protection::Layers). The pose is the same. Not with WebP.
    pub predict_poses: bool,
    /// Packets tell how far the picture is from what the camera saw: see [`crate::truth`]. Not with WebP, and not if
    /// there is no [`rate`](EncoderOptions::rate).
    pub truth: bool,
    /// Frames come already treated as the prior's [`preprocessing`](crate::Prior::preprocessing) says. The encoder then
    /// leaves them as they are; else it treats them.
    pub frames_treated: bool,
}

/// How many bytes longer the residual's check is after the full form than after the short one.
const LONGER_CHECK: usize = 2;

/// Spreads of the prior beyond which no pose from outside can lie.
const FAR: f64 = 1e6;

impl Default for EncoderOptions {
    fn default() -> Self {
        EncoderOptions {
            refine: RefineOptions::default(),
            threshold: 1e-3,
            rate: Some(Rate::Quality(10.0)),
            residual: ResidualCoder::default(),
            tune: Tune::default(),
            mode: Mode::default(),
            profile: PoseProfile::Compact,
            short: true,
            camera_interval: 64,
            check_interval: 0,
            first_frame: 0,
            factors: vec![1, 2, 4, 8],
            predict_poses: false,
            truth: true,
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
    /// Treats frames as the prior's pictures were.
    preprocessor: Preprocessor,
    coders: Coders,
    work: FrameWork,
    /// Renders by level before the frame.
    renders_before: Vec<u32>,
    frame: u32,
    /// Frames since the camera was last sent; `None`: not yet.
    camera_age: Option<u32>,
    /// The next packet has the full form, whatever else.
    full_due: bool,
    /// No frame of the stream may be predicted from one before the next.
    stream_ended: bool,
    /// What the topside is known to hold.
    acknowledged: Acknowledged,
    /// What is known of the poses that the topside holds; `None`: none is predicted from them.
    poses: Option<SentPoses>,
    /// The last time that a frame stated.
    time: Option<f64>,
    /// What the scene shows beside the prior.
    learnt: Learnt,
    #[cfg(feature = "training")]
    beside: Beside,
}

impl Encoder {
    /// Makes an encoder of frames of `camera`'s size.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        options: EncoderOptions,
    ) -> Result<Encoder, Error> {
        if options.mode != Mode::Intra && options.residual != ResidualCoder::Wavelet {
            return Err(Error::StreamCoder);
        }
        let objective = objective(engine, scene, camera, &options)?;
        let (threshold, profile) = (options.threshold, options.profile.word());
        let tracker = Tracker::new(objective, options.refine, threshold, profile);
        Ok(Encoder {
            engine: engine.clone(),
            scene: scene.clone(),
            camera: *camera,
            frame: options.first_frame,
            tracker,
            mask: None,
            interest: None,
            preprocessor: preprocessor(scene, &options),
            coders: Coders::new(
                &residual_setup(engine, scene, camera, &options),
                has_truth(&options),
            ),
            poses: predicts_poses(&options).then(SentPoses::new),
            options,
            work: FrameWork::default(),
            renders_before: Vec::new(),
            camera_age: None,
            full_due: true,
            stream_ended: false,
            acknowledged: Acknowledged::default(),
            time: None,
            learnt: Learnt::none(scene.id()),
            #[cfg(feature = "training")]
            beside: Beside::default(),
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
    pub(crate) fn set_view(&mut self, camera: &Camera, mask: Option<Mask>) -> Result<(), Error> {
        let mask = checked(mask, camera)?;
        if *camera != self.camera {
            let objective = objective(&self.engine, &self.scene, camera, &self.options)?;
            self.tracker.replace(objective);
            let same_size =
                (camera.width, camera.height) == (self.camera.width, self.camera.height);
            self.camera = *camera;
            if !same_size {
                self.coders = Coders::new(&self.residual_setup(), has_truth(&self.options));
            }
            #[cfg(feature = "training")]
            self.go_on_learning();
            self.camera_age = None;
        }
        self.mask = mask;
        self.tracker.set_mask(self.mask.clone());
        Ok(())
    }

    /// Sets which parts of the picture get more of the bits from here on: what the pilot looks at. `None`: all count
    /// the same. At the same budget the other parts get fewer; [`Rate::Psnr`] stays that of the whole picture.
    /// [`ResidualCoder::Webp`](crate::residual::ResidualCoder::Webp) knows no such parts.
    pub fn set_interest(&mut self, interest: Option<Interest>) {
        self.interest = interest.map(Arc::new);
    }

    /// Sets how fine the difference pictures are from here on: links change.
    pub fn set_rate(&mut self, rate: Option<Rate>) {
        self.options.rate = rate;
    }

    /// Tells the encoder that the topside has decoded a frame in full, residual and all:
    /// [`Decoded::kept`](crate::Decoded::kept). In a stream of
    /// [`Structure::Acknowledged`](crate::residual::Structure::Acknowledged) later frames are predicted from it.
    /// `frame` may be modulo 2¹⁶, as reports tell it. Frames that are unknown, or too old to be a reference frame,
    /// change nothing.
    pub fn acknowledge(&mut self, frame: u32) {
        self.acknowledged.add(frame);
    }

    /// Tells the encoder whether the topside holds the pose of a frame, as [`Decoder::hold`](crate::Decoder::hold) took
    /// it in and [`Report::poses`](crate::modem::Report::poses) tells. With [`EncoderOptions::predict_poses`] later
    /// poses are predicted from it, as long as it is one of the last 64 frames. `frame` may be modulo 2¹⁶.
    pub fn acknowledge_pose(&mut self, frame: u32, held: bool) {
        if let Some(poses) = &mut self.poses {
            poses.acknowledge(frame, held);
        }
    }

    /// The setup of the coder for a camera's difference pictures.
    pub(crate) fn residual_setup(&self) -> ResidualSetup {
        residual_setup(&self.engine, &self.scene, &self.camera, &self.options)
    }

    /// Draws what was learnt, with the updates of an earlier dive for one, from the next frame on. An update that waits
    /// to be adopted is dropped.
    ///
    /// # Errors
    /// If the scene was not [uploaded for updates](Engine::upload_for_updates), or the updates are of another prior.
    pub fn set_learnt(&mut self, learnt: &Learnt) -> Result<(), Error> {
        self.scene.check_learnt(learnt)?;
        self.scene.show(learnt)?;
        #[cfg(feature = "training")]
        self.beside.drop_waiting();
        self.show(learnt.clone());
        Ok(())
    }

    /// Draws what is learnt from the next frame on. Its packet names the state in full, and is predicted from none.
    fn show(&mut self, learnt: Learnt) {
        self.learnt = learnt;
        (self.full_due, self.stream_ended) = (true, true);
    }

    /// What is learnt, or was learnt before.
    pub fn learnt(&self) -> &Learnt {
        &self.learnt
    }

    /// Goes on with another engine, after the device of the old one was lost. `scene` is the same
    /// prior, uploaded there. Frame numbers and poses carry over. If it fails, nothing changes.
    pub fn move_to(&mut self, engine: &Engine, scene: &Arc<Scene>) -> Result<(), Error> {
        let (expected, found) = (self.scene.id(), scene.id());
        if expected != found {
            return Err(Error::PriorChanged { expected, found });
        }
        if self.learnt.number() > 0 {
            scene.check_learnt(&self.learnt)?;
        }
        self.tracker.replace(objective(engine, scene, &self.camera, &self.options)?);
        self.tracker.set_mask(self.mask.clone());
        (self.engine, self.scene) = (engine.clone(), scene.clone());
        self.preprocessor = preprocessor(scene, &self.options);
        self.coders.begin_streams(&self.residual_setup());
        #[cfg(feature = "training")]
        self.go_on_learning();
        Ok(())
    }

    /// Gives the next packet the full form and the camera. In a stream its frame is intra. Call it if a topside
    /// asks what the packets are about, or if a packet was not sent.
    pub fn announce(&mut self) {
        self.camera_age = None;
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
    pub(crate) fn encode_filled(&mut self, work: &mut FrameWork) -> Result<(), Error> {
        let found = self.track(work)?;
        work.code(&mut self.coders)?;
        self.keep(work, &found);
        #[cfg(feature = "training")]
        self.keep_to_learn(work, &work.encoded.render);
        Ok(())
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
    pub(crate) fn track_filled(&mut self, work: &mut FrameWork) -> Result<(), Error> {
        let found = self.track(work)?;
        self.keep(work, &found);
        #[cfg(feature = "training")]
        self.keep_to_learn(work, &work.render);
        Ok(())
    }

    /// Treats a frame, finds its pose and draws it. Changes nothing that the next frame goes on from.
    fn track(&mut self, work: &mut FrameWork) -> Result<PoseEstimate, Error> {
        let since = Instant::now();
        self.check_frame(&work.frame)?;
        let info = work.info;
        self.check_info(&info)?;
        // Another encoder or decoder may share the scene.
        self.scene.show(&self.learnt)?;
        self.renders_before.clear();
        self.renders_before.extend_from_slice(self.tracker.objective().renderer().renders());
        let short = self.short_next();
        let profile = if short { PoseProfile::Short } else { self.options.profile };
        self.tracker.set_profile(profile.word());
        work.mask.clone_from(&self.mask);
        work.interest.clone_from(&self.interest);
        self.preprocessor.apply_by(&mut work.frame, self.mask.as_deref());
        if let Some(mask) = &self.mask {
            mask.level_out(&mut work.frame);
        }
        let found = self.tracker.track(&work.frame, &info)?;
        let found = found.ok_or(Error::NoStart { frame: self.frame })?;
        let pose = self.coded_pose(&found, profile)?;
        self.set_stream(&pose, work);
        let frames_since_certain = self.frames_since_certain_with(&found);
        let camera = self.camera_due().then_some(self.camera);
        work.has_render_check = self.check_due();
        work.residual = Some(self.residual_setup());
        work.has_truth = has_truth(&self.options);
        let renderer = self.tracker.objective().renderer();
        work.render.resize(self.camera.width, self.camera.height);
        work.render.data.copy_from_slice(renderer.rendered());
        if let Some(mask) = &self.mask {
            let render = &work.render.data;
            let as_render = |at: usize, rgb: &mut [u8]| rgb.copy_from_slice(&render[at..at + 3]);
            mask.each_masked(&mut work.frame.data, as_render);
        }
        work.pose = pose.dequantise(&self.scene.coordinate_frame());
        let state = self.learnt.state().into();
        let latent = Latent {
            portable: self.engine.device().portable,
            ..Latent::new(self.frame, state, &self.camera, pose, !found.certain)?
        };
        let latent = if short { latent.shortened(state, &self.camera)? } else { latent };
        let update = self.learnt.number();
        let latent = if update > 0 { latent.with_update(update) } else { latent };
        work.session = session_check(state, &self.camera, &latent)?;
        let may_be_predicted = short && found.certain && !work.has_render_check;
        let latent = match self.poses.as_ref().filter(|_| may_be_predicted) {
            Some(poses) => poses.predicted(self.frame, &latent, work.session),
            None => latent,
        };
        work.latent = Some(latent);
        work.camera = camera;
        work.rate = self.options.rate;

        let stats = &mut work.stats;
        stats.renders.clear();
        let renders = renderer.renders().iter().zip(&self.renders_before);
        stats.renders.extend(renders.map(|(after, before)| after - before));
        stats.full_renders = stats.renders[0];
        #[cfg(feature = "training")]
        {
            work.found = FoundFrame { number: self.frame, certain: found.certain };
        }
        stats.frame = self.frame;
        stats.reference = None;
        stats.start = found.start;
        stats.stop = found.outcome.stop;
        stats.submissions = found.submissions;
        stats.observability = found.observability;
        stats.certain = found.certain;
        stats.portable = latent.portable;
        stats.frames_since_certain = frames_since_certain;
        stats.refine_milliseconds = since.elapsed().as_secs_f64() * 1e3;
        Ok(found)
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
    fn keep(&mut self, work: &FrameWork, found: &PoseEstimate) {
        let sent = work.camera.is_some();
        self.camera_age = Some(if sent { 1 } else { self.camera_age.unwrap_or(0) + 1 });
        (self.full_due, self.stream_ended) = (false, false);
        if let Some((poses, latent)) = self.poses.as_mut().zip(work.latent) {
            poses.add(self.frame, &latent, work.session);
        }
        self.frame = self.frame.wrapping_add(1);
        self.time = work.info.time.or(self.time);
        self.tracker.keep(found);
    }

    /// Leaves out so many camera frames: the next one's number is as much greater. If numbers count all camera frames,
    /// the topside knows which it has not been sent, and can draw them at poses between those that it has.
    pub fn skip(&mut self, frames: u32) {
        self.frame = self.frame.wrapping_add(frames);
    }

    /// Forgets all earlier frames: the next one is searched for as the first was, and may have any time. Frame numbers
    /// go on, the next packet has the full form, and the camera is sent again when it is due.
    pub fn reset(&mut self) {
        self.tracker.reset();
        self.time = None;
        self.full_due = true;
        self.stream_ended = true;
        self.acknowledged = Acknowledged::default();
        self.forget_poses();
    }

    /// Renders up to `max` of the prior's key frames that are not rendered yet, and returns how many are left. With
    /// them lost cameras are found. Without this call they are rendered while a frame is lost, as many as
    /// [`RefineOptions::lost_renders`] allows. Each takes one render and some 20 ms of the host.
    pub fn prepare(&mut self, max: usize) -> Result<usize, Error> {
        Ok(self.tracker.prepare(max)?)
    }

    /// Checks what is stated of the next frame.
    pub(crate) fn check_info(&self, info: &FrameInfo) -> Result<(), Error> {
        info.check(self.frame, self.time)?;
        let Some(hint) = &info.hint else { return Ok(()) };
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
        if let Some(code) = &found.drawn {
            return Ok(QuantisedPose::of_words(code)?);
        }
        let pose =
            QuantisedPose::quantise(&found.outcome.pose, &self.scene.coordinate_frame(), profile)?;
        let renderer = self.tracker.objective().renderer();
        renderer.draw_coded_as_planned(&pose.words())?;
        Ok(pose)
    }

    /// How many bytes more than a steady packet the next one takes beside its difference picture: its latent part has
    /// the full form, it tells the camera, or it has a check of the render. Add them to
    /// [`Rate::Bytes`](crate::Rate::Bytes), and the difference picture has as many bytes as those of other frames.
    pub fn extra_bytes(&self) -> usize {
        let part = |due, len| if due { len } else { 0 };
        let full = !self.short_next();
        let steady = if self.learnt.number() > 0 { LEARNT_SHORT_LEN } else { SHORT_LATENT_LEN };
        let latent = Latent::full_len(self.options.profile) - steady + LONGER_CHECK;
        part(full, latent)
            + part(self.camera_due(), CAMERA_PART_LEN)
            + part(self.check_due(), RENDER_PART_LEN)
    }

    fn check_due(&self) -> bool {
        let done = self.frame.wrapping_sub(self.options.first_frame);
        done.checked_rem(self.options.check_interval) == Some(0)
    }

    /// Whether the next packet has the short form, if that can hold its pose.
    fn short_next(&self) -> bool {
        let near = self.options.profile != PoseProfile::Paper;
        self.options.short && near && !self.full_due && !self.camera_due()
    }

    fn camera_due(&self) -> bool {
        let interval = self.options.camera_interval;
        self.camera_age.is_none_or(|age| interval > 0 && age >= interval)
    }

    /// Evaluations of the last frame's refinement, in order: error against run time.
    pub fn trace(&self) -> &[Evaluation] {
        self.tracker.trace()
    }
}

#[cfg(feature = "training")]
impl Encoder {
    /// Learns from here on, beside what is learnt already: what frames show and the prior does not becomes updates of
    /// the prior.
    ///
    /// # Errors
    /// If the scene was not [uploaded for updates](Engine::upload_for_updates), or the device has no room.
    pub fn learn(&mut self, options: &LearnOptions) -> Result<(), Error> {
        self.scene.check_learnt(&self.learnt)?;
        let setup = self.residual_setup();
        let Encoder { engine, scene, camera, learnt, .. } = self;
        self.beside.begin(engine, scene, camera, &setup, learnt, options)
    }

    /// Learns from the last frame: a slice of work, [`LearnOptions::steps_per_frame`] steps of training at most. Call
    /// it after each frame, once its packet is on its way. A frame without this call is not learnt from.
    ///
    /// `price`: bytes of pictures that a byte of an update costs, 1 or more. On a link its headers and parity take
    /// more: see [`Sender::update_price`](crate::modem::Sender::update_price).
    ///
    /// # Errors
    /// If the device fails. Learning has ended then; what was learnt before stays.
    pub fn learn_more(&mut self, price: f64) -> Result<(), Error> {
        self.beside.work(price)
    }

    /// The update that was proved last, `.nvsu`, once. Frames are drawn with it once it is [adopted](Encoder::adopt).
    /// Until then, or until it is dropped, the learner only collects frames.
    pub fn take_update(&mut self) -> Option<Vec<u8>> {
        self.beside.take_update()
    }

    /// Number of the update that was proved, and neither adopted nor dropped.
    pub fn waiting_update(&self) -> Option<u16> {
        self.beside.waiting()
    }

    /// Draws with the update that waits from the next frame on, if it has this number: the topside holds it, as
    /// [`Sender::held_update`](crate::modem::Sender::held_update) tells. Its packet names the state in full, and is
    /// predicted from none. `false`: another one waits, or none, and nothing changes.
    pub fn adopt(&mut self, number: u16) -> bool {
        self.beside.adopt(number).map(|after| self.show(after)).is_some()
    }

    /// Drops the update that waits: it cannot be sent. The learner goes on without it.
    pub fn drop_update(&mut self) {
        self.beside.drop_waiting();
    }

    /// What the learner did; `None`: the encoder does not learn.
    pub fn learner_stats(&self) -> Option<LearnerStats> {
        self.beside.stats()
    }

    /// Keeps a frame that was found for [`learn_more`](Self::learn_more).
    fn keep_to_learn(&mut self, work: &FrameWork, render: &Picture) {
        let Some(found) = self.beside.next() else { return };
        found.frame.clone_from(&work.frame);
        found.render.clone_from(render);
        found.mask.clone_from(&work.mask);
        (found.number, found.certain) = (work.found.number, work.found.certain);
        (found.pose, found.rate) = (work.pose, work.rate);
    }

    fn go_on_learning(&mut self) {
        let setup = self.residual_setup();
        self.beside.go_on(&self.engine, &self.scene, &self.camera, &setup);
    }
}

/// Whether packets get truth maps.
fn has_truth(options: &EncoderOptions) -> bool {
    options.truth && options.residual == ResidualCoder::Wavelet
}

/// Whether poses may be predicted from those that the topside holds.
fn predicts_poses(options: &EncoderOptions) -> bool {
    options.predict_poses && options.short && options.residual == ResidualCoder::Wavelet
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
        coder: options.residual,
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
) -> Result<Objective, Error> {
    camera.check()?;
    let search = options.refine.optimizer == Optimizer::GaussNewton;
    let jacobian = options.refine.jacobian();
    let plan = Plan {
        factors: options.factors.clone(),
        jacobians: if search { Vec::new() } else { vec![jacobian] },
        search: search.then_some(jacobian),
        sort_precision: options.refine.sort_precision,
        depths: options.mode != Mode::Intra,
        profiled: false,
    };
    Ok(Objective::new(engine.renderer(scene, camera, plan)?))
}
