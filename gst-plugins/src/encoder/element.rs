//! The element `nvspenc`.

use std::sync::Mutex;

use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::VideoInfo;
use gst_video::prelude::*;
use gst_video::subclass::prelude::*;

use nvsprior::image::ImageView;
use nvsprior::tracking::FrameInfo;

use super::frames::{Frames, Taken};
use super::settings::{Fineness, RateKind};
use crate::caps;
use crate::coding::{self, ModeKind, StructureKind, TuneKind, coding_element};
use crate::element::{log_category, registry};
use crate::held_prior::{HeldPrior, PriorSettings, is_fatal};
use crate::lock::lock;
use crate::property;
use crate::stats::{self, properties_with_stats};

log_category!("nvspenc", "nvsprior encoder");

/// What the element holds while it runs.
#[derive(Default)]
struct State {
    held: Option<HeldPrior>,
    frames: Option<Frames>,
    info: Option<VideoInfo>,
    /// The last frames gave no packets, and a warning has said why.
    starved: bool,
}

/// What has been done since the start.
#[derive(Default)]
struct Counts {
    frames: u64,
    packets: u64,
    bytes: u64,
    left_out: u64,
    late: u64,
    uncertain: u64,
    last: Option<gst::Structure>,
}

coding_element! {
    wrapper: [super::Encoder];
    struct Encoder {
        #[property(name = "rate", get, set, type = RateKind, member = rate, mutable_playing,
            blurb = "What decides how fine difference pictures are", builder(RateKind::Quality))]
        #[property(name = "quality", get, set, type = f32, member = quality, mutable_playing, default_value = 10.0,
            minimum = 0.0, maximum = 100.0,
            blurb = "With rate=quality: quality of the difference picture")]
        #[property(name = "bytes", get, set, type = u32, member = bytes, mutable_playing, default_value = 500,
            minimum = 1,
            blurb = "With rate=bytes: bytes of the whole packet, not exceeded unless pose and camera take more")]
        #[property(name = "psnr", get, set, type = f32, member = psnr, mutable_playing, default_value = 30.0,
            minimum = 0.0, maximum = 100.0,
            blurb = "With rate=psnr: dB to reach with as few bytes as possible")]
        fineness: Mutex<Fineness>,

        counts: Mutex<Counts>,
        state: Mutex<State>,
    }
}

impl Encoder {
    fn stats(&self) -> gst::Structure {
        let counts = lock(&self.counts);
        let mut stats = gst::Structure::builder("nvspenc-stats")
            .field("frames", counts.frames)
            .field("packets", counts.packets)
            .field("bytes", counts.bytes)
            .field("left-out", counts.left_out)
            .field("late", counts.late)
            .field("uncertain", counts.uncertain)
            .build();
        if let Some(last) = &counts.last {
            stats.set("last", last);
        }
        stats
    }

    /// Counts a frame that gives no packet, and tells those behind that time has gone by.
    fn leave_out(
        &self,
        frame: gst_video::VideoCodecFrame,
    ) -> Result<gst::FlowSuccess, gst::FlowError> {
        let (pts, duration) = (frame.pts(), frame.duration());
        let done = self.obj().finish_frame(frame)?;
        let pad = self.obj().src_pad().clone();
        // Not before the segment.
        if let Some(pts) = pts
            && pad.sticky_event::<gst::event::Segment>(0).is_some()
        {
            pad.push_event(gst::event::Gap::builder(pts).duration(duration).build());
        }
        Ok(done)
    }

    fn encode(
        &self,
        state: &mut State,
        frame: &gst_video::VideoCodecFrame,
        time: f64,
    ) -> Result<Taken, gst::ErrorMessage> {
        let failed = |text: String| gst::error_msg!(gst::StreamError::Encode, ("{text}"));
        let (Some(frames), Some(info)) = (&mut state.frames, &state.info) else {
            return Err(gst::error_msg!(gst::CoreError::Negotiation, ("a frame before its caps")));
        };
        let (settings, frame_info) = {
            let mut coding = lock(&self.coding);
            (coding.clone(), coding.info.take().unwrap_or_default())
        };
        let input =
            frame.input_buffer().ok_or_else(|| failed("a frame without a buffer".into()))?;
        let mapped = gst_video::VideoFrameRef::from_buffer_ref_readable(input, info)
            .map_err(|error| failed(format!("mapping a frame: {error}")))?;
        let view = coding::view(&mapped)?;
        let rate = lock(&self.fineness).rate();
        let taken = frames.take(&view, time, frame_info, &settings, rate);
        if let Some(error) = frames.take_refused() {
            gst::element_imp_warning!(self, gst::StreamError::Encode, ("{error}"));
        }
        taken.map_err(|error| match is_fatal(&error) {
            true => gst::error_msg!(gst::ResourceError::Failed, ("{error}")),
            false => failed(error.to_string()),
        })
    }

    /// Counts the packet that was just made, and makes it a buffer.
    fn packet(&self, frames: &Frames) -> gst::Buffer {
        let stats = &frames.encoded().stats;
        let figures = coding::figures("nvspenc-frame", frames.encoded());
        {
            let mut counts = lock(&self.counts);
            counts.packets += 1;
            counts.bytes += stats.bytes as u64;
            counts.uncertain += u64::from(!stats.certain);
            counts.last = Some(figures.clone());
        }
        if lock(&self.coding).post_messages {
            stats::post(self.obj().upcast_ref(), figures);
        }
        gst::Buffer::from_slice(frames.encoded().packet.clone())
    }

    /// What becomes of a frame: a packet and whether it is intra, or nothing.
    fn handle(
        &self,
        frame: &gst_video::VideoCodecFrame,
        time: f64,
    ) -> Result<Option<(gst::Buffer, bool)>, gst::ErrorMessage> {
        let mut state = lock(&self.state);
        if let Some(frames) = &mut state.frames {
            if frame.flags().contains(gst_video::VideoCodecFrameFlags::FORCE_KEYFRAME) {
                frames.announce();
            }
            if self.obj().is_qos_enabled() && self.obj().max_encode_time(frame) < 0 {
                frames.skip(time);
                lock(&self.counts).late += 1;
                return Ok(None);
            }
        }
        match self.encode(&mut state, frame, time)? {
            Taken::Packet => {
                state.starved = false;
                let Some(frames) = &state.frames else { return Ok(None) };
                let is_intra = frames.encoded().stats.reference.is_none();
                Ok(Some((self.packet(frames), is_intra)))
            }
            // A pose may come while the pipeline plays.
            Taken::NoStart(error) => {
                let text = format!("{error}; the property start gives a pose");
                Ok(self.give_up(&mut state, text))
            }
        }
    }

    /// Counts a frame that gives no packet. Says why, unless the frame before gave none either.
    fn give_up(&self, state: &mut State, why: String) -> Option<(gst::Buffer, bool)> {
        lock(&self.counts).left_out += 1;
        if !std::mem::replace(&mut state.starved, true) {
            gst::element_imp_warning!(self, gst::StreamError::Encode, ("{why}"));
        }
        None
    }
}

#[glib::object_subclass]
impl ObjectSubclass for Encoder {
    const NAME: &'static str = "GstNvspriorEncoder";
    type Type = super::Encoder;
    type ParentType = gst_video::VideoEncoder;
}

impl ObjectImpl for Encoder {
    properties_with_stats!();

    fn constructed(&self) {
        self.parent_constructed();
        self.obj().set_qos_enabled(true);
    }
}

impl GstObjectImpl for Encoder {}

impl ElementImpl for Encoder {
    registry!(
        "nvsprior encoder",
        "Codec/Encoder/Video",
        "Encodes frames against a 3D Gaussian Splatting prior: a pose and a difference picture",
        [
            ("sink", Sink, Always, caps::pictures(&coding::FORMATS, ImageView::MAX_SIDE)),
            ("src", Src, Always, caps::any(caps::PACKET)),
        ]
    );
}

impl VideoEncoderImpl for Encoder {
    fn start(&self) -> Result<(), gst::ErrorMessage> {
        if let Err(error) = lock(&self.coding).start.as_deref().map(property::pose).transpose() {
            return Err(gst::error_msg!(gst::LibraryError::Settings, ("{error}")));
        }
        let prior = lock(&self.prior).clone();
        let held = HeldPrior::open(&prior, &*self.obj())?;
        gst::info!(CATEGORY, imp = self, "device: {}", held.engine.device());
        *lock(&self.counts) = Counts::default();
        *lock(&self.state) = State { held: Some(held), ..State::default() };
        lock(&self.coding).start_again();
        Ok(())
    }

    fn stop(&self) -> Result<(), gst::ErrorMessage> {
        *lock(&self.state) = State::default();
        Ok(())
    }

    fn set_format(
        &self,
        input: &gst_video::VideoCodecState<'static, gst_video::video_codec_state::Readable>,
    ) -> Result<(), gst::LoggableError> {
        let info = input.info().clone();
        let settings = lock(&self.coding).clone();
        let fps = info.fps();
        let frame_rate = (fps.numer() > 0).then(|| caps::per_second(fps));
        let size = (info.width(), info.height());
        let (camera, prior) = {
            let mut state = lock(&self.state);
            let State { held: Some(held), frames, .. } = &mut *state else {
                return Err(gst::loggable_error!(CATEGORY, "caps before the start"));
            };
            let prior = held.scene.id().to_string();
            let ready = match frames {
                Some(frames) => frames.change(&settings, size, frame_rate),
                None => {
                    Frames::new(held, &settings, size, frame_rate).map(|made| *frames = Some(made))
                }
            };
            if let Err(error) = ready {
                gst::element_imp_error!(self, gst::LibraryError::Settings, ("{error}"));
                return Err(gst::loggable_error!(CATEGORY, "{error}"));
            }
            let camera = frames.as_ref().map(|frames| *frames.camera());
            state.info = Some(info);
            (camera, prior)
        };
        let mut caps = caps::any(caps::PACKET);
        {
            let caps = caps.make_mut();
            if let Some(camera) = camera {
                caps.set("width", camera.width as i32);
                caps.set("height", camera.height as i32);
            }
            caps.set("framerate", fps);
            caps.set("prior", prior);
        }
        let refused = |_| gst::loggable_error!(CATEGORY, "packets are not wanted downstream");
        let element = self.obj();
        let output = element.set_output_state(caps, Some(input)).map_err(refused)?;
        element.negotiate(output).map_err(refused)?;
        // A packet leaves when its frame is coded, within a frame's time if the device keeps up.
        let latency = match frame_rate {
            Some(rate) => gst::ClockTime::from_seconds_f64(1.0 / rate),
            None => caps::UNKNOWN_FRAME_TIME,
        };
        element.set_latency(latency, None);
        Ok(())
    }

    fn handle_frame(
        &self,
        mut frame: gst_video::VideoCodecFrame,
    ) -> Result<gst::FlowSuccess, gst::FlowError> {
        lock(&self.counts).frames += 1;
        // Frames without times are a second apart: the rate control then knows no better.
        let number = f64::from(frame.system_frame_number());
        let time = frame.pts().map_or(number, |pts| pts.seconds_f64());
        match self.handle(&frame, time) {
            Ok(Some((packet, is_intra))) => {
                if is_intra {
                    frame.set_flags(gst_video::VideoCodecFrameFlags::SYNC_POINT);
                }
                frame.set_output_buffer(packet);
                self.obj().finish_frame(frame)
            }
            Ok(None) => self.leave_out(frame),
            Err(error) => {
                self.post_error_message(error);
                Err(gst::FlowError::Error)
            }
        }
    }

    fn flush(&self) -> bool {
        if let Some(frames) = &mut lock(&self.state).frames {
            frames.reset();
        }
        lock(&self.coding).start_again();
        true
    }
}
