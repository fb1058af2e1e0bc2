//! The element `nvspdec`.

mod truth;

use std::sync::Mutex;
use std::time::Instant;

use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::prelude::*;
use gst_video::subclass::prelude::*;
use gst_video::{VideoDecoderRequestSyncPointFlags, VideoFormat, VideoInfo};

use nvsprior::image::{ImageView, PixelFormat, write_picture};
use nvsprior::packet::Parsed;
use nvsprior::residual::ResidualError;
use nvsprior::{Decoded, Error, Trust};

use crate::caps;
use crate::element::{log_category, registry};
use crate::held_prior::{HeldPrior, PriorSettings, is_fatal};
use crate::lock::lock;
use crate::property;
use crate::stats::{self, properties_with_stats};

log_category!("nvspdec", "nvsprior decoder");

/// What is known of a packet's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorTrust")]
pub enum TrustKind {
    #[enum_value(name = "As the caps say: start from nvspdepay, else whole", nick = "auto")]
    #[default]
    Auto,
    #[enum_value(name = "Nothing: parts whose check does not match are left out", nick = "whole")]
    Whole,
    #[enum_value(name = "They are the undamaged start of a packet", nick = "start")]
    Start,
}

#[derive(Clone, Debug)]
struct Settings {
    camera: Option<String>,
    trust: TrustKind,
    post_messages: bool,
    truth_messages: bool,
    overlay: bool,
    filter: bool,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            camera: None,
            trust: TrustKind::Auto,
            post_messages: false,
            truth_messages: false,
            overlay: false,
            filter: false,
        }
    }
}

/// What the element holds while it runs.
#[derive(Default)]
struct State {
    held: Option<HeldPrior>,
    decoder: Option<nvsprior::Decoder>,
    decoded: Decoded,
    input: Option<gst_video::VideoCodecState<'static, gst_video::video_codec_state::Readable>>,
    /// The caps say that packets may end early.
    starts: bool,
    /// The picture's size and format that are agreed on downstream.
    output: Option<(u32, u32, PixelFormat)>,
    /// What was wrong with the packet before, so that it is not said again and again.
    wrong: Option<String>,
    /// The longest that a packet took, as it was told downstream.
    latency: gst::ClockTime,
}

/// What has been done since the start.
#[derive(Default)]
struct Counts {
    packets: u64,
    pictures: u64,
    refused: u64,
    damaged: u64,
    late: u64,
    last: Option<gst::Structure>,
}

#[derive(Default, glib::Properties)]
#[properties(wrapper_type = super::Decoder)]
pub struct Decoder {
    #[property(name = "prior", get, set, type = Option<String>, member = prior, mutable_ready,
        blurb = "File of the trained scene, the same as the vehicle's: .ply, .nvsg, .nvsb, .spz; the content tells the \
            format")]
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
        blurb = "The vehicle's camera, width,height,fx,fy,cx,cy in pixels, so that packets can be decoded even if the \
            one that told it was lost (default: packets tell it)")]
    #[property(name = "trust", get, set, type = TrustKind, member = trust, mutable_playing,
        blurb = "What is known of a packet's bytes", builder(TrustKind::Auto))]
    #[property(name = "post-messages", get, set, type = bool, member = post_messages, mutable_playing,
        blurb = "Post an element message nvspdec-frame with each picture's figures")]
    #[property(name = "truth-messages", get, set, type = bool, member = truth_messages, mutable_playing,
        blurb = "Post an element message nvspdec-truth with each picture: how far each block of it is from what the \
            camera saw")]
    #[property(name = "overlay", get, set, type = bool, member = overlay, mutable_playing,
        blurb = "Draw over each picture what of it differs from what the camera saw (yellow stripes), is wrong \
            (magenta lattice), or was not seen (grey, with dots)")]
    #[property(name = "filter", get, set, type = bool, member = filter, mutable_ready,
        blurb = "Filter pictures by a small network that knows the scene, with the prior's weights, or with the \
            library's")]
    settings: Mutex<Settings>,

    counts: Mutex<Counts>,
    state: Mutex<State>,
}

/// What becomes of a packet.
enum Fate {
    /// [`State::decoded`] has the picture.
    Picture,
    Nothing(Error),
    /// It was too late, and no later frame needs it.
    Late,
}

/// The formats that pictures are written in.
const FORMATS: [(VideoFormat, PixelFormat); 4] = [
    (VideoFormat::Rgb, PixelFormat::Rgb8),
    (VideoFormat::Rgbx, PixelFormat::Rgba8),
    (VideoFormat::Rgba, PixelFormat::Rgba8),
    (VideoFormat::Bgr, PixelFormat::Bgr8),
];

/// Latency is told in steps of this, and up to the most.
const LATENCY_STEP: gst::ClockTime = gst::ClockTime::from_mseconds(20);
const MAX_LATENCY: gst::ClockTime = gst::ClockTime::from_seconds(1);

impl Decoder {
    fn stats(&self) -> gst::Structure {
        let counts = lock(&self.counts);
        let mut stats = gst::Structure::builder("nvspdec-stats")
            .field("packets", counts.packets)
            .field("pictures", counts.pictures)
            .field("refused", counts.refused)
            .field("damaged", counts.damaged)
            .field("late", counts.late)
            .build();
        if let Some(last) = &counts.last {
            stats.set("last", last);
        }
        stats
    }

    fn decode(
        &self,
        state: &mut State,
        packet: &[u8],
        late: bool,
    ) -> Result<Fate, gst::ErrorMessage> {
        let trust = match lock(&self.settings).trust {
            TrustKind::Start => Trust::Start,
            TrustKind::Auto if state.starts => Trust::Start,
            TrustKind::Auto | TrustKind::Whole => Trust::Whole,
        };
        let Some(decoder) = &mut state.decoder else {
            return Err(gst::error_msg!(
                gst::CoreError::Negotiation,
                ("a packet before the start")
            ));
        };
        if late && !leads(packet) {
            return Ok(Fate::Late);
        }
        let since = Instant::now();
        let done = decoder.decode_into(packet, trust, &mut state.decoded);
        let taken = gst::ClockTime::from_nseconds(since.elapsed().as_nanos() as u64);
        match done {
            Ok(()) => {
                self.tell_latency(state, taken);
                self.count(&state.decoded, packet.len(), taken);
                Ok(if late { Fate::Late } else { Fate::Picture })
            }
            Err(error) if is_fatal(&error) => {
                Err(gst::error_msg!(gst::ResourceError::Failed, ("{error}")))
            }
            Err(error) => Ok(Fate::Nothing(error)),
        }
    }

    /// Tells the pipeline how long pictures take, if that has grown: sinks wait for so long.
    fn tell_latency(&self, state: &mut State, taken: gst::ClockTime) {
        let steps = taken.nseconds().div_ceil(LATENCY_STEP.nseconds());
        let latency = (LATENCY_STEP * steps).min(MAX_LATENCY);
        if latency > state.latency {
            state.latency = latency;
            self.obj().set_latency(latency, None);
        }
    }

    fn count(&self, decoded: &Decoded, bytes: usize, taken: gst::ClockTime) {
        let mut figures = gst::Structure::builder("nvspdec-frame")
            .field("frame", decoded.frame)
            .field("bytes", bytes as u32)
            .field("certain", !decoded.uncertain)
            .field("kept", decoded.kept)
            .field("portable", decoded.portable)
            .field("filtered", decoded.filtered)
            .field("milliseconds", taken.mseconds() as f64)
            .build();
        if let Some(reference) = decoded.reference {
            figures.set("reference", reference);
        }
        if let Some(known) = &decoded.known {
            figures.set("position-deviation", known.position);
            figures.set("rotation-deviation", known.rotation);
        }
        if let Some(same) = decoded.same_render {
            figures.set("same-render", same);
        }
        if let Some(damage) = &decoded.damage {
            figures.set("damage", damage.to_string());
        }
        {
            let mut counts = lock(&self.counts);
            counts.pictures += 1;
            counts.damaged += u64::from(decoded.damage.is_some());
            counts.last = Some(figures.clone());
        }
        let (figures_wanted, truth_wanted) = {
            let settings = lock(&self.settings);
            (settings.post_messages, settings.truth_messages)
        };
        if figures_wanted {
            stats::post(self.obj().upcast_ref(), figures);
        }
        if truth_wanted {
            self.post_truth(decoded);
        }
    }

    /// Says what is wrong with a packet, unless the packet before said the same.
    fn complain(&self, state: &mut State, wrong: Option<(&Error, &str)>) {
        let Some((error, effect)) = wrong else {
            state.wrong = None;
            return;
        };
        // Frame numbers change from packet to packet.
        let kind = format!("{:?}", std::mem::discriminant(error));
        if state.wrong.as_ref() != Some(&kind) {
            state.wrong = Some(kind);
            gst::element_imp_warning!(self, gst::StreamError::Decode, ("{error}: {effect}"));
        }
    }

    /// Agrees on size and format with those downstream, if the picture's size is new.
    fn agree(&self, state: &mut State) -> Result<PixelFormat, gst::FlowError> {
        let (width, height) = (state.decoded.picture.width, state.decoded.picture.height);
        if let Some((_, _, format)) = state.output.filter(|agreed| {
            (agreed.0, agreed.1) == (width, height) && !self.obj().src_pad().check_reconfigure()
        }) {
            return Ok(format);
        }
        let template = self.obj().src_pad().pad_template_caps();
        let mut wanted = self.obj().src_pad().allowed_caps().unwrap_or(template);
        if wanted.is_empty() {
            return Err(gst::FlowError::NotNegotiated);
        }
        wanted.fixate();
        let name = wanted.structure(0).and_then(|fields| fields.get::<String>("format").ok());
        let format = name.map_or(VideoFormat::Rgb, |name| VideoFormat::from_string(&name));
        let written = FORMATS.iter().find(|(of, _)| *of == format);
        let (_, written) = *written.ok_or(gst::FlowError::NotNegotiated)?;
        let input = state.input.as_ref();
        let element = self.obj();
        element.negotiate(element.set_output_state(format, width, height, input)?)?;
        state.output = Some((width, height, written));
        Ok(written)
    }

    /// Writes the picture to the frame's buffer.
    fn show(
        &self,
        state: &mut State,
        frame: &mut gst_video::VideoCodecFrame,
    ) -> Result<(), gst::FlowError> {
        let format = self.agree(state)?;
        self.obj().allocate_output_frame(frame, None)?;
        let output = self.obj().output_state().ok_or(gst::FlowError::NotNegotiated)?;
        let buffer = frame.output_buffer_mut().ok_or(gst::FlowError::Error)?;
        truth::mark_regions(&state.decoded, buffer);
        if lock(&self.settings).overlay {
            let Decoded { picture, truth, .. } = &mut state.decoded;
            truth.draw_over(picture);
        }
        let info: &VideoInfo = output.info();
        let mut mapped = gst_video::VideoFrameRef::from_buffer_ref_writable(buffer, info)
            .map_err(|_| gst::FlowError::Error)?;
        let stride = mapped.plane_stride().first().map_or(0, |stride| (*stride).max(0) as usize);
        let plane = mapped.plane_data_mut(0).map_err(|_| gst::FlowError::Error)?;
        write_picture(&state.decoded.picture, format, stride, plane).map_err(|error| {
            gst::element_imp_error!(self, gst::StreamError::Decode, ("{error}"));
            gst::FlowError::Error
        })
    }
}

/// Whether later frames may be predicted from this one.
fn leads(packet: &[u8]) -> bool {
    // The camera is needed, too.
    Parsed::of(packet)
        .is_ok_and(|packet| packet.is_in_stream() || matches!(packet.session(), Ok(Some(_))))
}

/// Whether the vehicle can help, by an intra frame that tells the camera.
fn wants_key(error: &Error) -> bool {
    matches!(
        error,
        Error::Residual(ResidualError::ReferenceMissing { .. })
            | Error::SessionUnknown { .. }
            | Error::Estranged { .. }
    )
}

#[glib::object_subclass]
impl ObjectSubclass for Decoder {
    const NAME: &'static str = "GstNvspriorDecoder";
    type Type = super::Decoder;
    type ParentType = gst_video::VideoDecoder;
}

impl ObjectImpl for Decoder {
    properties_with_stats!();

    fn constructed(&self) {
        self.parent_constructed();
        self.obj().set_packetized(true);
        self.obj().set_needs_format(true);
        // What an intra frame brings is asked for by `request_sync_point`.
        self.obj().set_needs_sync_point(false);
    }
}

impl GstObjectImpl for Decoder {}

impl ElementImpl for Decoder {
    registry!(
        "nvsprior decoder",
        "Codec/Decoder/Video",
        "Draws the prior at a packet's pose and adds the packet's difference picture",
        sink: caps::any(caps::PACKET),
        src: caps::pictures(&FORMATS.map(|(format, _)| format), nvsprior::Camera::MAX_SIDE)
    );
}

impl VideoDecoderImpl for Decoder {
    fn start(&self) -> Result<(), gst::ErrorMessage> {
        let prior = lock(&self.prior).clone();
        let held = HeldPrior::open(&prior)?;
        gst::info!(CATEGORY, imp = self, "device: {}", held.engine.device());
        let mut decoder = nvsprior::Decoder::new(&held.engine, &held.scene);
        if let Some(camera) = &lock(&self.settings).camera {
            let wrong = |error: &dyn std::fmt::Display| {
                gst::error_msg!(gst::LibraryError::Settings, ("{error}"))
            };
            let camera = property::sized_camera(camera).map_err(|error| wrong(&error))?;
            decoder.add_camera(&camera).map_err(|error| wrong(&error))?;
        }
        let filtered = decoder.set_filter(lock(&self.settings).filter);
        filtered.map_err(|error| gst::error_msg!(gst::LibraryError::Init, ("filter: {error}")))?;
        *lock(&self.counts) = Counts::default();
        let (held, decoder) = (Some(held), Some(decoder));
        *lock(&self.state) = State { held, decoder, ..State::default() };
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
        let mut state = lock(&self.state);
        let fields = input.caps().and_then(|caps| caps.structure(0));
        let field = |name| fields.and_then(|fields| fields.get::<String>(name).ok());
        if let (Some(theirs), Some(held)) = (field("prior"), &state.held) {
            let ours = held.scene.id().to_string();
            if theirs != ours {
                let file = lock(&self.prior).prior.clone().unwrap_or_default();
                let text = format!(
                    "packets about prior {theirs}, but {file} is prior {ours}: vehicle and topside \
                     must hold the same prior"
                );
                gst::element_imp_error!(self, gst::StreamError::Format, ("{text}"));
                return Err(gst::loggable_error!(CATEGORY, "{text}"));
            }
        }
        state.starts = field("trust").is_some_and(|trust| trust == "start");
        state.input = Some(input.clone());
        // The frame rate may be new.
        state.output = None;
        Ok(())
    }

    fn handle_frame(
        &self,
        mut frame: gst_video::VideoCodecFrame,
    ) -> Result<gst::FlowSuccess, gst::FlowError> {
        lock(&self.counts).packets += 1;
        let late = self.obj().is_qos() && self.obj().max_decode_time(&frame) < 0;
        let mut state = lock(&self.state);
        let input = frame.input_buffer_owned().ok_or(gst::FlowError::Error)?;
        let packet = input.map_readable().map_err(|_| gst::FlowError::Error)?;
        let outcome = match self.decode(&mut state, &packet, late) {
            Ok(outcome) => outcome,
            Err(error) => {
                drop(state);
                self.obj().release_frame(frame);
                self.post_error_message(error);
                return Err(gst::FlowError::Error);
            }
        };
        match outcome {
            Fate::Picture => {
                let damage = state.decoded.damage.take();
                if damage.as_ref().is_some_and(wants_key) {
                    self.obj()
                        .request_sync_point(&frame, VideoDecoderRequestSyncPointFlags::empty());
                }
                let effect = "showing what the packet gives without it";
                self.complain(&mut state, damage.as_ref().map(|error| (error, effect)));
                if let Err(error) = self.show(&mut state, &mut frame) {
                    drop(state);
                    self.obj().release_frame(frame);
                    return Err(error);
                }
                drop(state);
                self.obj().finish_frame(frame)
            }
            Fate::Nothing(error) => {
                lock(&self.counts).refused += 1;
                if wants_key(&error) {
                    self.obj()
                        .request_sync_point(&frame, VideoDecoderRequestSyncPointFlags::empty());
                }
                self.complain(&mut state, Some((&error, "the packet is left out")));
                drop(state);
                self.obj().drop_frame(frame)
            }
            Fate::Late => {
                lock(&self.counts).late += 1;
                drop(state);
                self.obj().drop_frame(frame)
            }
        }
    }
}

// Sizes that packets can state are sizes that images can have.
const _: () = assert!(nvsprior::Camera::MAX_SIDE <= ImageView::MAX_SIDE);
