//! The element `nvspenc`.

use std::sync::Mutex;

use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::prelude::*;
use gst_video::subclass::prelude::*;
use gst_video::{VideoColorMatrix, VideoColorRange, VideoFormat, VideoInfo};

use nvsprior::image::{Colour, ImageView, PixelFormat};
use nvsprior::tracking::FrameInfo;

use super::frames::{Frames, FramesError, Taken};
use super::settings::{ModeKind, RateKind, Settings, StructureKind, TuneKind};
use crate::budget::Budget;
use crate::caps;
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

#[derive(Default, glib::Properties)]
#[properties(wrapper_type = super::Encoder)]
pub struct Encoder {
    #[property(name = "prior", get, set, type = Option<String>, member = prior, mutable_ready,
        blurb = "File of the trained scene: .ply, .nvsg, .nvsb, .spz; the content tells the format")]
    #[property(name = "prior-memory", get, set, type = u32, member = memory, mutable_ready,
        blurb = "Most memory for the splats of a prior in blocks (.nvsb), MiB: only those that cameras see are loaded; \
            0: it is loaded whole")]
    #[property(name = "device", get, set, type = Option<String>, member = device, mutable_ready,
        blurb = "The Vulkan device's number, or a part of its name or its driver's name (default: the best device)")]
    #[property(name = "watchdog", get, set, type = u32, member = watchdog, mutable_ready,
        blurb = "Milliseconds that one submission to the device may take before the device counts as lost; 0: no \
            bound")]
    prior: Mutex<PriorSettings>,

    #[property(name = "camera", get, set, type = Option<String>, member = camera, mutable_ready,
        blurb = "The pinhole camera: width,height,fx,fy,cx,cy in pixels, or fx,fy,cx,cy for frames as they come")]
    #[property(name = "width", get, set, type = u32, member = width, mutable_ready, default_value = 320, maximum = 4096,
        blurb = "Frames wider than this are reduced to it; 0 keeps every size")]
    #[property(name = "lens", get, set, type = Option<String>, member = lens, mutable_ready,
        blurb = "Distortion by OpenCV's calibration: brown,width,height,fx,fy,cx,cy,k1,k2,p1,p2[,k3[,k4,k5,k6]] or \
            fisheye,width,height,fx,fy,cx,cy,k1,k2,k3,k4; camera is then the camera without distortion (default: one \
            that sees all that the lens does)")]
    #[property(name = "region", get, set, type = Option<String>, member = region, mutable_playing,
        blurb = "What the pilot looks at, x,y,width,height as parts (0 to 1) of the picture's width and height: it \
            gets more of the bytes, all else fewer")]
    #[property(name = "region-weight", get, set, type = u32, member = region_weight, mutable_playing,
        default_value = 8, minimum = 1, maximum = 255,
        blurb = "How many times more an error in the region counts")]
    #[property(name = "mask", get, set, type = Option<String>, member = mask, mutable_ready,
        blurb = "PNG file of the frames' shape; pixels that are black there do not count, as they show the vehicle \
            itself")]
    #[property(name = "start", get = Self::start_text, set = Self::set_start, type = Option<String>, mutable_playing,
        blurb = "The camera's rough pose at the next frame: qw,qx,qy,qz,tx,ty,tz, world to camera (default: none, the \
            prior's key frames give it)")]
    #[property(name = "threshold", get, set, type = f64, member = threshold, mutable_ready, default_value = 1e-3,
        minimum = 0.0, maximum = 1.0,
        blurb = "Mean squared error of colours in 0..1 below which a pose is kept where the prior shows too little to \
            compare pictures")]
    #[property(name = "mode", get, set, type = ModeKind, member = mode, mutable_ready,
        blurb = "Whether difference pictures are predicted from earlier ones", builder(ModeKind::Intra))]
    #[property(name = "tune", get, set, type = TuneKind, member = tune, mutable_ready,
        blurb = "What counts when bits are given to one part of the picture and taken from another",
        builder(TuneKind::Psnr))]
    #[property(name = "structure", get, set, type = StructureKind, member = structure, mutable_ready,
        blurb = "With mode=stream: the reference frame of others", builder(StructureKind::Chain))]
    #[property(name = "key-every", get, set, type = u32, member = key_every, mutable_ready, default_value = 16,
        blurb = "With mode=stream: an intra frame comes after this many frames; 0: no more after the first")]
    #[property(name = "camera-interval", get, set, type = u32, member = camera_interval, mutable_ready,
        default_value = 64,
        blurb = "State prior and camera again after this many frames, for a topside that missed them; 0: never again")]
    #[property(name = "render-check", get, set, type = u32, member = render_check, mutable_ready,
        blurb = "Send a check of the render (6 bytes) every so many frames; 0: never")]
    #[property(name = "lost-renders", get, set, type = u32, member = lost_renders, mutable_ready, default_value = 96,
        blurb = "Most renders that a frame takes beside its first search; the next frames go on; 0: search from the \
            frame before and from start alone")]
    #[property(name = "frame-time", get, set, type = f64, member = frame_time, mutable_ready, minimum = 0.0,
        maximum = 3_600_000.0,
        blurb = "Most time that a frame takes, milliseconds: one render and one coding must fit; 0: as long as its \
            search takes")]
    #[property(name = "frames-treated", get, set, type = bool, member = frames_treated, mutable_ready,
        blurb = "Frames come already treated as the prior's preprocessing says")]
    #[property(name = "truth", get, set, type = bool, member = truth, mutable_ready, default_value = true,
        blurb = "Packets tell the topside how far its picture is from what the camera saw, block by block")]
    #[property(name = "rate", get, set, type = RateKind, member = rate, mutable_playing,
        blurb = "What decides how fine difference pictures are", builder(RateKind::Quality))]
    #[property(name = "quality", get, set, type = f32, member = quality, mutable_playing, default_value = 10.0,
        minimum = 0.0, maximum = 100.0,
        blurb = "With rate=quality: quality of the difference picture")]
    #[property(name = "bytes", get, set, type = u32, member = bytes, mutable_playing, default_value = 500, minimum = 1,
        blurb = "With rate=bytes: bytes of the whole packet, not exceeded unless pose and camera take more")]
    #[property(name = "psnr", get, set, type = f32, member = psnr, mutable_playing, default_value = 30.0,
        minimum = 0.0, maximum = 100.0,
        blurb = "With rate=psnr: dB to reach with as few bytes as possible")]
    #[property(name = "bit-rate", get, set, type = u32, member = bit_rate, mutable_playing, default_value = 5000,
        minimum = 1,
        blurb = "With rate=link: what the link carries, bit/s")]
    #[property(name = "mtu", get, set, type = u32, member = mtu, mutable_ready, default_value = 64, minimum = 16,
        maximum = 65535,
        blurb = "With rate=link: most bytes of a modem frame or datagram")]
    #[property(name = "overhead", get, set, type = u32, member = overhead, mutable_ready, maximum = 65535,
        blurb = "With rate=link: what each modem frame or datagram takes beside its bytes, as bytes")]
    #[property(name = "tag-bytes", get, set, type = u32, member = tag_bytes, mutable_ready, maximum = 16,
        blurb = "With rate=link: bytes of a tag, as of nvsppay, if that has a key-file; 0: it has none")]
    #[property(name = "latency", get, set, type = u32, member = latency, mutable_ready, default_value = 1500,
        minimum = 1,
        blurb = "With rate=link: longest time from the exposure of a frame to the end of its packet's last share, \
            milliseconds")]
    #[property(name = "delay", get, set, type = u32, member = delay, mutable_ready, default_value = 100,
        blurb = "With rate=link: what of the latency is no transmission: search, coding, propagation; milliseconds")]
    #[property(name = "spread", get, set, type = i32, member = spread, mutable_ready, default_value = -1, minimum = -1,
        blurb = "With rate=link: milliseconds from a packet's first share to its last one; those of other packets lie \
            between them (-1: half of what the delay leaves, 0 without loss)")]
    #[property(name = "frame-rate", get, set, type = f64, member = frame_rate, mutable_ready, minimum = 0.0,
        maximum = 1000.0,
        blurb = "With rate=link: most pictures per second; 0: as many as frames come")]
    #[property(name = "least", get, set, type = u32, member = least, mutable_ready, default_value = 40,
        blurb = "With rate=link: fewest bytes for a picture, all counted; below it frames are left out")]
    #[property(name = "shares", get, set, type = u32, member = shares, mutable_ready, default_value = 16, minimum = 1,
        maximum = 64,
        blurb = "With rate=link: most shares of a packet")]
    #[property(name = "loss", get, set, type = f64, member = loss, mutable_playing, default_value = 0.1,
        minimum = 0.0, maximum = 0.99,
        blurb = "With rate=link: share of the modem frames or datagrams that is lost")]
    #[property(name = "burst", get, set, type = f64, member = burst, mutable_playing, default_value = 1.0,
        minimum = 1.0, maximum = 1000.0,
        blurb = "With rate=link: mean number of them that are lost in a row")]
    #[property(name = "post-messages", get, set, type = bool, member = post_messages, mutable_playing,
        blurb = "Post an element message nvspenc-frame with each frame's figures")]
    settings: Mutex<Settings>,

    counts: Mutex<Counts>,
    state: Mutex<State>,
}

const FORMATS: [VideoFormat; 6] = [
    VideoFormat::Rgb,
    VideoFormat::Nv12,
    VideoFormat::I420,
    VideoFormat::Bgr,
    VideoFormat::Rgba,
    VideoFormat::Rgbx,
];

impl Encoder {
    fn start_text(&self) -> Option<String> {
        lock(&self.settings).start.clone()
    }

    fn set_start(&self, text: Option<String>) {
        let pose = match text.as_deref().map(property::pose).transpose() {
            Ok(pose) => Some(pose.map(FrameInfo::from)),
            Err(error) => {
                // A wrong pose from a navigation program must not end the dive. At the next start it is an error.
                gst::element_imp_warning!(self, gst::LibraryError::Settings, ("{error}"));
                None
            }
        };
        let mut settings = lock(&self.settings);
        settings.start = text;
        if let Some(frame_info) = pose {
            settings.info = frame_info;
        }
    }

    /// The next frame starts at the pose in the property, as the first frame does.
    fn start_again(&self) {
        let mut settings = lock(&self.settings);
        if let Some(Ok(pose)) = settings.start.as_deref().map(property::pose) {
            settings.info = Some(pose.into());
        }
    }

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

    /// The frame's image, for the library.
    fn view<'a>(
        frame: &'a gst_video::VideoFrameRef<&gst::BufferRef>,
    ) -> Result<ImageView<'a>, gst::ErrorMessage> {
        let info = frame.info();
        let format = match info.format() {
            VideoFormat::Rgb => PixelFormat::Rgb8,
            VideoFormat::Bgr => PixelFormat::Bgr8,
            VideoFormat::Rgba | VideoFormat::Rgbx => PixelFormat::Rgba8,
            VideoFormat::Nv12 => PixelFormat::Nv12,
            VideoFormat::I420 => PixelFormat::I420,
            other => {
                let text = format!("frames of the format {other:?}");
                return Err(gst::error_msg!(gst::StreamError::Format, ("{text}")));
            }
        };
        let colorimetry = info.colorimetry();
        let full = colorimetry.range() == VideoColorRange::Range0_255;
        let colour = match (colorimetry.matrix(), full) {
            (VideoColorMatrix::Bt709, false) => Colour::Bt709Limited,
            (VideoColorMatrix::Bt709, true) => Colour::Bt709Full,
            (_, false) => Colour::Bt601Limited,
            (_, true) => Colour::Bt601Full,
        };
        let planes = frame.planes_data();
        let stride = |plane: usize| {
            frame.plane_stride().get(plane).map_or(0, |stride| (*stride).max(0) as usize)
        };
        Ok(ImageView {
            width: info.width(),
            height: info.height(),
            format,
            colour,
            planes: [planes[0], planes[1], planes[2]],
            strides: [stride(0), stride(1), stride(2)],
        })
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

    /// The figures of the packet that was just made.
    fn figures(&self, frames: &Frames, budget: Option<&Budget>) -> gst::Structure {
        let stats = &frames.encoded().stats;
        let mut figures = gst::Structure::builder("nvspenc-frame")
            .field("frame", stats.frame)
            .field("bytes", stats.bytes as u32)
            .field("psnr", stats.psnr)
            .field("render-psnr", stats.render_psnr)
            .field("certain", stats.certain)
            .field("lost-frames", stats.frames_since_certain)
            .field("rate-kept", stats.rate_kept)
            .field("truth-bytes", stats.truth_bytes as u32)
            .field("out-of-time", stats.out_of_time)
            .field("milliseconds", stats.milliseconds)
            .build();
        if let Some(reference) = stats.reference {
            figures.set("reference", reference);
        }
        if let Some(known) = &stats.known {
            figures.set("position-deviation", known.position);
            figures.set("rotation-deviation", known.rotation);
        }
        if let Some(budget) = budget {
            figures.set("budget", budget.bytes);
        }
        figures
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
            let mut settings = lock(&self.settings);
            (settings.clone(), settings.info.take().unwrap_or_default())
        };
        let input =
            frame.input_buffer().ok_or_else(|| failed("a frame without a buffer".into()))?;
        let mapped = gst_video::VideoFrameRef::from_buffer_ref_readable(input, info)
            .map_err(|error| failed(format!("mapping a frame: {error}")))?;
        let view = Self::view(&mapped)?;
        let taken = frames.take(&view, time, frame_info, &settings);
        if let Ok(Taken::LeftOut | Taken::TooSmall(_)) = taken {
            // The next frame takes it, unless there is a newer one by then.
            lock(&self.settings).info.get_or_insert(frame_info);
        }
        if let Some(error) = frames.take_refused() {
            gst::element_imp_warning!(self, gst::StreamError::Encode, ("{error}"));
        }
        taken.map_err(|error| match &error {
            FramesError::Library(library) if is_fatal(library) => {
                gst::error_msg!(gst::ResourceError::Failed, ("{error}"))
            }
            _ => failed(error.to_string()),
        })
    }

    /// Counts the packet that was just made, and makes it a buffer.
    fn packet(
        &self,
        frames: &Frames,
        budget: Option<Budget>,
    ) -> Result<gst::Buffer, gst::ErrorMessage> {
        let stats = &frames.encoded().stats;
        let figures = self.figures(frames, budget.as_ref());
        {
            let mut counts = lock(&self.counts);
            counts.packets += 1;
            counts.bytes += stats.bytes as u64;
            counts.uncertain += u64::from(!stats.certain);
            counts.last = Some(figures.clone());
        }
        if lock(&self.settings).post_messages {
            stats::post(self.obj().upcast_ref(), figures);
        }
        let mut buffer = gst::Buffer::from_slice(frames.encoded().packet.clone());
        if let Some(budget) = budget {
            let failed = |error| gst::error_msg!(gst::CoreError::Failed, ("{error}"));
            budget.attach(buffer.make_mut()).map_err(failed)?;
        }
        Ok(buffer)
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
            Taken::Packet(budget) => {
                state.starved = false;
                let Some(frames) = &state.frames else { return Ok(None) };
                let is_intra = frames.encoded().stats.reference.is_none();
                Ok(Some((self.packet(frames, budget)?, is_intra)))
            }
            Taken::LeftOut => {
                lock(&self.counts).left_out += 1;
                Ok(None)
            }
            Taken::TooSmall(error) => Ok(self.give_up(&mut state, error.to_string())),
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
        sink: caps::pictures(&FORMATS, ImageView::MAX_SIDE),
        src: caps::any(caps::PACKET)
    );
}

impl VideoEncoderImpl for Encoder {
    fn start(&self) -> Result<(), gst::ErrorMessage> {
        if let Err(error) = lock(&self.settings).start.as_deref().map(property::pose).transpose() {
            return Err(gst::error_msg!(gst::LibraryError::Settings, ("{error}")));
        }
        let prior = lock(&self.prior).clone();
        let held = HeldPrior::open(&prior)?;
        gst::info!(CATEGORY, imp = self, "device: {}", held.engine.device());
        *lock(&self.counts) = Counts::default();
        *lock(&self.state) = State { held: Some(held), ..State::default() };
        self.start_again();
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
        let settings = lock(&self.settings).clone();
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
            None => gst::ClockTime::from_mseconds(u64::from(settings.delay)),
        };
        // The property has the same name.
        VideoEncoderExtManual::set_latency(&*element, latency, None);
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
        self.start_again();
        true
    }
}
