//! The element `nvspdec`.

use std::sync::Mutex;
use std::time::Instant;

use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::VideoDecoderRequestSyncPointFlags;
use gst_video::prelude::*;
use gst_video::subclass::prelude::*;

use nvsprior::image::PixelFormat;
use nvsprior::packet::Parsed;
use nvsprior::residual::ResidualError;
use nvsprior::{Decoded, Error, Trust};

use crate::caps;
use crate::element::{log_category, registry};
use crate::held_prior::{HeldPrior, PriorSettings, is_fatal};
use crate::lock::lock;
use crate::showing::{self, Complaint, showing_element};
use crate::stats::{self, properties_with_stats};

log_category!("nvspdec", "nvsprior decoder");

/// What is known of a packet's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorTrust")]
pub enum TrustKind {
    #[enum_value(name = "As the caps say: start, else whole", nick = "auto")]
    #[default]
    Auto,
    #[enum_value(name = "Nothing: parts whose check does not match are left out", nick = "whole")]
    Whole,
    #[enum_value(name = "They are the undamaged start of a packet", nick = "start")]
    Start,
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
    complaint: Complaint,
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

showing_element! {
    wrapper: [super::Decoder];
    #[derive(Default)]
    struct Decoder {
        #[property(name = "trust", get, set, mutable_playing,
            blurb = "What is known of a packet's bytes", builder(TrustKind::Auto))]
        trust: Mutex<TrustKind>,

        counts: Mutex<Counts>,
        state: Mutex<State>,
    }
}

/// What becomes of a packet.
enum Fate {
    /// [`State::decoded`] has the picture.
    Picture,
    Nothing(Error),
    /// It was too late, and no later frame needs it.
    Late,
}

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
        let trust = match *lock(&self.trust) {
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
        let latency = showing::latency_of(taken);
        if latency > state.latency {
            state.latency = latency;
            self.obj().set_latency(latency, None);
        }
    }

    fn count(&self, decoded: &Decoded, bytes: usize, taken: gst::ClockTime) {
        let figures = showing::figures("nvspdec-frame", decoded, bytes, taken);
        {
            let mut counts = lock(&self.counts);
            counts.pictures += 1;
            counts.damaged += u64::from(decoded.damage.is_some());
            counts.last = Some(figures.clone());
        }
        let (figures_wanted, truth_wanted) = {
            let settings = lock(&self.showing);
            (settings.post_messages, settings.truth_messages)
        };
        if figures_wanted {
            stats::post(self.obj().upcast_ref(), figures);
        }
        if truth_wanted {
            let truth = showing::truth("nvspdec-truth", decoded);
            stats::post(self.obj().upcast_ref(), truth);
        }
    }

    /// Says what is wrong with a packet, unless the packet before said the same.
    fn complain(&self, state: &mut State, wrong: Option<(&Error, &str)>) {
        if state.complaint.is_new(wrong.map(|(error, _)| error))
            && let Some((error, effect)) = wrong
        {
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
        let (format, written) = showing::choose_format(self.obj().src_pad())?;
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
        let overlay = lock(&self.showing).overlay;
        let written = showing::write(&state.decoded, overlay, (output.info(), format), buffer);
        written.map_err(|error| {
            self.post_error_message(error);
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
        [("sink", Sink, Always, caps::any(caps::PACKET)), ("src", Src, Always, showing::caps()),]
    );
}

impl VideoDecoderImpl for Decoder {
    fn start(&self) -> Result<(), gst::ErrorMessage> {
        let prior = lock(&self.prior).clone();
        let held = HeldPrior::open(&prior, &*self.obj())?;
        gst::info!(CATEGORY, imp = self, "device: {}", held.engine.device());
        let decoder = lock(&self.showing).decoder(&held)?;
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
