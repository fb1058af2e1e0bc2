//! The element `nvspvehicle`.
//!
//! All work is done by the thread that brings frames: reports wait until the next one.

use std::collections::VecDeque;
use std::sync::{Mutex, OnceLock};

use gst::glib;
use gst::glib::subclass::Signal;
use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::VideoInfo;

use nvsprior::Error;
use nvsprior::image::ImageView;
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior_link::keys::Keys;
use nvsprior_link::modem::{Loss, SenderStatistics};
use nvsprior_link::{CameraFrame, LinkError, Vehicle, VehicleEvent};

use super::settings::{LinkSettings, ProtectionKind};
use crate::caps;
use crate::coding::{self, ModeKind, SetUpError, StructureKind, TuneKind, Views, coding_element};
use crate::element::{add_pads, guarded, linked, log_category, pad, registry, running_time};
use crate::end_files::EndFiles;
use crate::held_prior::{HeldPrior, PriorSettings, is_fatal};
use crate::lock::lock;
use crate::property;
use crate::stats::{self, properties_with_stats};

log_category!("nvspvehicle", "nvsprior vehicle's end of a link");

/// What the element holds while it runs.
#[derive(Default)]
struct State {
    held: Option<HeldPrior>,
    keys: Option<Keys>,
    /// What the vehicle goes on with.
    stored: Vec<u8>,
    end: Option<End>,
    /// The running time of the last frame, seconds.
    last: Option<f64>,
    /// The last frames gave no packets, and a warning has said why.
    starved: bool,
}

/// What there is once the frames' caps are known.
struct End {
    vehicle: Vehicle,
    views: Views,
    info: VideoInfo,
    /// Bit rate and loss as the properties had them last.
    link: (u32, Loss),
}

/// What has been done since the start.
#[derive(Default)]
struct Counts {
    frames: u64,
    uncertain: u64,
    /// Frames that could not be encoded.
    starved: u64,
    reports: u64,
    refused: u64,
    link: SenderStatistics,
    resent_bytes: u64,
    last: Option<gst::Structure>,
}

/// A report, and when it came, seconds of running time.
type Heard = (Option<f64>, Vec<u8>);

/// Reports that wait for a frame.
const REPORTS: usize = 16;

coding_element! {
    wrapper: [super::VehicleEnd];
    struct VehicleEnd {
        #[property(name = "bit-rate", get, set, type = u32, member = bit_rate, mutable_playing, default_value = 5000,
            minimum = 1,
            blurb = "What the link carries, bit/s")]
        #[property(name = "mtu", get, set, type = u32, member = mtu, mutable_ready, default_value = 64, minimum = 8,
            maximum = 65535,
            blurb = "Most bytes of a modem frame or datagram, as of nvsptopside; with protection from 16")]
        #[property(name = "overhead", get, set, type = u32, member = overhead, mutable_ready, maximum = 65535,
            blurb = "What each modem frame or datagram takes beside its bytes, as bytes")]
        #[property(name = "latency", get, set, type = u32, member = latency, mutable_ready, default_value = 1500,
            minimum = 1,
            blurb = "Longest time from the exposure of a frame to the end of its packet's last modem frame, \
                milliseconds")]
        #[property(name = "delay", get, set, type = u32, member = delay, mutable_ready, default_value = 300,
            blurb = "What of the latency is no transmission: search, coding, propagation; milliseconds")]
        #[property(name = "spread", get, set, type = i32, member = spread, mutable_ready, default_value = -1,
            minimum = -1,
            blurb = "Milliseconds from a packet's first modem frame to its last one; those of other packets lie \
                between them (-1: a quarter of what the delay leaves, 0 without loss or protection)")]
        #[property(name = "frame-rate", get, set, type = f64, member = frame_rate, mutable_ready, minimum = 0.0,
            maximum = 1000.0,
            blurb = "Most pictures per second; 0: as many as frames come")]
        #[property(name = "least", get, set, type = u32, member = least, mutable_ready, default_value = 40,
            blurb = "Fewest bytes for a picture, all counted; below it frames are left out")]
        #[property(name = "shares", get, set, type = u32, member = shares, mutable_ready, maximum = 256,
            blurb = "Most modem frames of a packet; 0: as many as MTU and rate take, 16 to 64")]
        #[property(name = "loss", get, set, type = f64, member = loss, mutable_playing, default_value = 0.1,
            minimum = 0.0, maximum = 0.99,
            blurb = "Part of the modem frames or datagrams that is lost, until reports tell it")]
        #[property(name = "burst", get, set, type = f64, member = burst, mutable_playing, default_value = 1.0,
            minimum = 1.0, maximum = 1000.0,
            blurb = "Mean number of them that are lost in a row")]
        #[property(name = "stream", get, set, type = u32, member = stream, mutable_ready, maximum = 3,
            blurb = "Number of the stream, if several cameras share a link")]
        #[property(name = "protection", get, set, type = ProtectionKind, member = protection, mutable_ready,
            blurb = "What is done against losses", builder(ProtectionKind::Layers))]
        #[property(name = "expect-reports", get, set, type = bool, member = expect_reports, mutable_ready,
            default_value = true,
            blurb = "The topside sends reports: by the pad reports, or the signal report")]
        #[property(name = "state-poses", get, set, type = bool, member = state_poses, mutable_ready,
            blurb = "State all poses in full, even if the topside has reported others that they could be predicted \
                from")]
        #[property(name = "stamps", get, set, type = bool, member = stamps, mutable_ready, default_value = true,
            blurb = "Packets tell when their frame was exposed, once a report has come; with protection alone")]
        link: Mutex<LinkSettings>,

        #[property(name = "key-file", get, set, type = Option<String>, member = key_file, mutable_ready,
            blurb = "File with a key, as nvsprior key makes it: modem frames get a tag")]
        #[property(name = "epoch", get, set, type = u64, member = epoch, mutable_ready,
            blurb = "Number of the dive, with key-file: nothing of another one passes")]
        #[property(name = "tag-bytes", get, set, type = u32, member = tag_bytes, mutable_ready, default_value = 4,
            minimum = 2, maximum = 16,
            blurb = "Bytes of a tag, with key-file; 2 more are a number")]
        #[property(name = "state-file", get, set, type = Option<String>, member = state_file, mutable_ready,
            blurb = "File of what this end goes on with after a restart: numbers of frames and keys")]
        files: Mutex<EndFiles>,

        pads: OnceLock<[gst::Pad; 2]>,
        counts: Mutex<Counts>,
        heard: Mutex<VecDeque<Heard>>,
        state: Mutex<State>,
    }
}

/// A modem frame that goes out, and when it is due, seconds.
type DueFrame = (f64, Vec<u8>);

impl VehicleEnd {
    fn pads(&self) -> &[gst::Pad; 2] {
        self.pads.get().expect("a constructed element has pads")
    }

    fn stats(&self) -> gst::Structure {
        let counts = lock(&self.counts);
        let mut stats = gst::Structure::builder("nvspvehicle-stats")
            .field("frames", counts.frames)
            .field("packets", counts.link.packets)
            .field("left-out", counts.link.left_out + counts.starved)
            .field("uncertain", counts.uncertain)
            .field("shares", counts.link.shares)
            .field("bytes", counts.link.bytes)
            .field("cut", counts.link.cut)
            .field("resent", counts.link.resent)
            .field("resent-bytes", counts.resent_bytes)
            .field("reports", counts.reports)
            .field("refused", counts.refused)
            .field("foreign", counts.link.foreign)
            .field("replayed", counts.link.replayed)
            .build();
        if let Some(last) = &counts.last {
            stats.set("last", last);
        }
        stats
    }

    /// Makes the vehicle for frames of these caps, or has it go on with them.
    fn set_caps(&self, caps: &gst::CapsRef) -> Result<(), gst::ErrorMessage> {
        let wrong = |error: &dyn std::fmt::Display| {
            gst::error_msg!(gst::LibraryError::Settings, ("{error}"))
        };
        let info = VideoInfo::from_caps(caps)
            .map_err(|error| gst::error_msg!(gst::StreamError::Format, ("{error}")))?;
        let (coding, size) = (lock(&self.coding).clone(), (info.width(), info.height()));
        let mut state = lock(&self.state);
        let State { held: Some(held), keys, stored, end, .. } = &mut *state else {
            return Err(gst::error_msg!(gst::CoreError::Negotiation, ("caps before the start")));
        };
        if let Some(end) = end.as_mut().filter(|end| end.info.fps() == info.fps()) {
            let encoder = end.vehicle.encoder();
            end.views = Views::changed(&coding, size, encoder).map_err(|e| wrong(&e))?;
            end.info = info;
            return Ok(());
        }
        if let Some(End { mut vehicle, .. }) = end.take() {
            // Numbers and pose carry over.
            vehicle.link().state(stored);
            if vehicle.encoded().stats.certain {
                let pose = FrameInfo::from(Hint::of(vehicle.encoded().pose));
                lock(&self.coding).info.get_or_insert(pose);
            }
        }
        let link = lock(&self.link).clone();
        let options = link.options(
            caps::frame_rate(caps).map(caps::per_second),
            keys.clone(),
            stored.clone(),
        );
        let made = || -> Result<(Vehicle, Views), SetUpError> {
            let (camera, mut views, mask) = Views::new(&coding, size)?;
            let (engine, scene) = (&held.engine, &held.scene);
            let mut vehicle =
                Vehicle::new(engine, scene, &camera, coding.encoder_options(), &options)?;
            vehicle.encoder().set_mask(mask.as_ref())?;
            views.look(&coding, vehicle.encoder())?;
            Ok((vehicle, views))
        };
        let (vehicle, views) = made().map_err(|error| wrong(&error))?;
        *end = Some(End { vehicle, views, info, link: (link.bit_rate, link.loss()) });
        Ok(())
    }

    /// Drops what was not sent yet, and searches anew, with a clock that may begin anew. Numbers carry over.
    fn begin_anew(&self) -> Result<(), gst::ErrorMessage> {
        let info = {
            let mut state = lock(&self.state);
            let State { stored, end, .. } = &mut *state;
            let Some(End { mut vehicle, info, .. }) = end.take() else { return Ok(()) };
            vehicle.link().state(stored);
            (state.last, state.starved) = (None, false);
            info
        };
        let failed = |error| gst::error_msg!(gst::CoreError::Failed, ("{error}"));
        let caps = info.to_caps().map_err(failed)?;
        self.set_caps(&caps)
    }

    /// Takes a frame. Gives the modem frames that are due before the next one.
    fn take(&self, buffer: &gst::BufferRef) -> Result<Vec<DueFrame>, gst::ErrorMessage> {
        lock(&self.counts).frames += 1;
        let mut state = lock(&self.state);
        let State { end: Some(end), last, starved, .. } = &mut *state else {
            return Err(gst::error_msg!(gst::CoreError::Negotiation, ("a frame before its caps")));
        };
        let rate = end.vehicle.link().sender().options().frame_rate;
        let duration = buffer.duration().map_or(1.0 / rate, |duration| duration.seconds_f64());
        let time = match (running_time(&self.pads()[0], buffer), buffer.pts()) {
            (Some(time), _) => time,
            // Out of the segment.
            (None, Some(_)) => return Ok(Vec::new()),
            (None, None) => last.map_or(0.0, |last| last + duration),
        };
        *last = Some(time);
        self.hear(end, time);
        self.follow(end, time);
        match self.encode(end, buffer, time)? {
            None => *starved = false,
            Some(why) => {
                lock(&self.counts).starved += 1;
                if !std::mem::replace(starved, true) {
                    gst::element_imp_warning!(self, gst::StreamError::Encode, ("{why}"));
                }
            }
        }
        // What is due before the next frame goes now, so that it is at the sink in time. Beyond that, modem frames of
        // the next packet may lie between them.
        Ok(self.release(end, time + duration.max(1e-9)))
    }

    /// Reads the reports that came since the last frame.
    fn hear(&self, end: &mut End, now: f64) {
        for (came, report) in lock(&self.heard).drain(..) {
            let read = end.vehicle.link().receive(came.unwrap_or(now), &report);
            let mut counts = lock(&self.counts);
            counts.reports += 1;
            if let Err(error) = read {
                counts.refused += 1;
                gst::debug!(CATEGORY, imp = self, "a report: {error}");
            }
        }
    }

    /// Follows the properties that may change while frames come.
    fn follow(&self, end: &mut End, now: f64) {
        let (bit_rate, loss) = {
            let link = lock(&self.link);
            (link.bit_rate, link.loss())
        };
        let link = end.vehicle.link();
        let mut done = Ok(());
        if end.link.0 != bit_rate {
            done = link.set_bit_rate(now, f64::from(bit_rate));
        }
        if end.link.1 != loss {
            done = done.and(link.set_loss(loss));
        }
        end.link = (bit_rate, loss);
        if let Err(error) = done {
            gst::element_imp_warning!(self, gst::LibraryError::Settings, ("{error}"));
        }
    }

    /// Encodes a frame. Tells why it gives no packet, unless the link has no bytes for it.
    fn encode(
        &self,
        end: &mut End,
        buffer: &gst::BufferRef,
        time: f64,
    ) -> Result<Option<String>, gst::ErrorMessage> {
        let failed = |text: String| gst::error_msg!(gst::StreamError::Encode, ("{text}"));
        let (coding, frame_info) = {
            let mut coding = lock(&self.coding);
            (coding.clone(), coding.info.take().unwrap_or_default())
        };
        if let Err(error) = end.views.look(&coding, end.vehicle.encoder()) {
            gst::element_imp_warning!(self, gst::StreamError::Encode, ("{error}"));
        }
        let mapped = gst_video::VideoFrameRef::from_buffer_ref_readable(buffer, &end.info)
            .map_err(|error| failed(format!("mapping a frame: {error}")))?;
        let view = coding::view(&mapped)?;
        let picture = end.views.picture(&view).map_err(|error| failed(error.to_string()))?;
        let frame = CameraFrame { exposed: time, picture, info: frame_info, user: &[] };
        // Times are those of frames, on a slow machine, too: the delay says what coding takes.
        match end.vehicle.frame(time, &frame, || time) {
            Ok(Some(_)) => {
                self.count(&end.vehicle, &coding);
                Ok(None)
            }
            Ok(None) => {
                // The next frame takes it, unless there is a newer one by then.
                lock(&self.coding).info.get_or_insert(frame_info);
                Ok(None)
            }
            // A pose may come while the pipeline plays.
            Err(LinkError::Picture(error @ Error::NoStart { .. })) => {
                Ok(Some(format!("{error}; the property start gives a pose")))
            }
            Err(LinkError::Picture(error @ (Error::HintPose { .. } | Error::HintFar { .. }))) => {
                Ok(Some(format!("property start: {error}")))
            }
            Err(LinkError::Picture(error)) if is_fatal(&error) => {
                Err(gst::error_msg!(gst::ResourceError::Failed, ("{error}")))
            }
            Err(LinkError::Picture(error)) => Err(failed(error.to_string())),
            Err(error) => Ok(Some(error.to_string())),
        }
    }

    fn count(&self, vehicle: &Vehicle, coding: &coding::Coding) {
        let figures = coding::figures("nvspvehicle-frame", vehicle.encoded());
        {
            let mut counts = lock(&self.counts);
            counts.uncertain += u64::from(!vehicle.encoded().stats.certain);
            counts.last = Some(figures.clone());
        }
        if coding.post_messages {
            stats::post(self.obj().upcast_ref(), figures);
        }
    }

    /// Takes the modem frames that are due before `until`, seconds.
    fn release(&self, end: &mut End, until: f64) -> Vec<DueFrame> {
        let link = end.vehicle.link();
        let mtu = link.sender().mtu();
        let mut released = Vec::new();
        while let Some(due) = link.due().filter(|due| *due < until) {
            // A time has rounding.
            match link.transmit(until.min(due + 1e-6), mtu) {
                Ok(Some(frame)) => released.push((due, frame.to_vec())),
                _ => break,
            }
        }
        self.tell(end);
        released
    }

    /// Tells what the vehicle tells, before more goes.
    fn tell(&self, end: &mut End) {
        let link = end.vehicle.link();
        while let Some(event) = link.event() {
            let message = gst::Structure::builder("nvspvehicle-event");
            let message = match event {
                VehicleEvent::TopsideHeard => message.field("event", "topside-heard"),
                VehicleEvent::TopsideSilent(seconds) => {
                    message.field("event", "topside-silent").field("seconds", seconds)
                }
                VehicleEvent::Strangers(count) => {
                    message.field("event", "strangers").field("count", count)
                }
                VehicleEvent::Asked => message.field("event", "asked"),
                VehicleEvent::Region(region) => {
                    message.field("event", "region").field("given", region.is_some())
                }
                VehicleEvent::User => {
                    let user = glib::Bytes::from(link.user());
                    message.field("event", "user").field("bytes", user)
                }
                VehicleEvent::FrameRate(rate) => {
                    message.field("event", "frame-rate").field("rate", rate)
                }
                VehicleEvent::Store => {
                    lock(&self.files).store(&*self.obj(), |into| link.state(into));
                    continue;
                }
            };
            stats::post(self.obj().upcast_ref(), message.build());
        }
        let mut counts = lock(&self.counts);
        counts.link = link.statistics();
        counts.resent_bytes = link.resent_bytes();
    }

    fn push(&self, frames: Vec<DueFrame>) -> Result<gst::FlowSuccess, gst::FlowError> {
        for (due, frame) in frames {
            let mut buffer = gst::Buffer::from_slice(frame);
            buffer.make_mut().set_pts(gst::ClockTime::from_seconds_f64(due.max(0.0)));
            self.pads()[1].push(buffer)?;
        }
        Ok(gst::FlowSuccess::Ok)
    }

    /// Pushes the modem frames that are due before `until`, seconds.
    fn push_until(&self, until: f64) -> Result<gst::FlowSuccess, gst::FlowError> {
        let frames = match &mut lock(&self.state).end {
            Some(end) => self.release(end, until),
            None => Vec::new(),
        };
        self.push(frames)
    }

    fn chain(&self, buffer: &gst::BufferRef) -> Result<gst::FlowSuccess, gst::FlowError> {
        let frames = self.take(buffer).map_err(|error| self.fail(error))?;
        self.push(frames)
    }

    fn fail(&self, error: gst::ErrorMessage) -> gst::FlowError {
        self.post_error_message(error);
        gst::FlowError::Error
    }

    /// Keeps a report for the next frame. Nobody waits for a frame here.
    fn keep_report(&self, came: Option<f64>, report: &[u8]) {
        let mut heard = lock(&self.heard);
        if heard.len() == REPORTS {
            heard.pop_front();
        }
        heard.push_back((came, report.to_vec()));
    }

    fn sink_event(&self, sink: &gst::Pad, event: gst::Event) -> bool {
        match event.view() {
            gst::EventView::Caps(of) => {
                if let Err(error) = self.set_caps(of.caps()) {
                    let _ = self.fail(error);
                    return false;
                }
                let mut caps = caps::any(caps::SHARE);
                let fields = caps.make_mut();
                fields.set("stream", lock(&self.link).stream as i32);
                if let Some(rate) = caps::frame_rate(of.caps()) {
                    fields.set("framerate", rate);
                }
                self.pads()[1].push_event(gst::event::Caps::new(&caps))
            }
            gst::EventView::Segment(_) => {
                // Times are running times.
                let segment = gst::FormattedSegment::<gst::ClockTime>::new();
                self.pads()[1].push_event(gst::event::Segment::new(&segment))
            }
            gst::EventView::Gap(gap) => {
                let (from, duration) = gap.get();
                let segment = sink.sticky_event::<gst::event::Segment>(0);
                let running = segment.and_then(|segment| {
                    let segment = segment.segment().downcast_ref::<gst::ClockTime>()?;
                    segment.to_running_time(from)
                });
                let Some(from) = running else { return true };
                let until = from + duration.unwrap_or(gst::ClockTime::ZERO);
                let pushed = self.push_until(until.seconds_f64());
                let gap = gst::event::Gap::builder(from).duration(duration).build();
                self.pads()[1].push_event(gap) && pushed.is_ok()
            }
            gst::EventView::Eos(_) => {
                if let Err(error) = self.push_until(f64::INFINITY) {
                    gst::debug!(CATEGORY, imp = self, "the last modem frames: {error}");
                }
                gst::Pad::event_default(sink, Some(&*self.obj()), event)
            }
            gst::EventView::FlushStop(_) => {
                lock(&self.coding).start_again();
                if let Err(error) = self.begin_anew() {
                    let _ = self.fail(error);
                }
                gst::Pad::event_default(sink, Some(&*self.obj()), event)
            }
            _ => gst::Pad::event_default(sink, Some(&*self.obj()), event),
        }
    }

    fn src_query(&self, query: &mut gst::QueryRef) -> bool {
        let [sink, src] = self.pads();
        match query.view_mut() {
            gst::QueryViewMut::Latency(query) => {
                let mut above = gst::query::Latency::new();
                if !sink.peer_query(&mut above) {
                    return false;
                }
                let (live, least, most) = above.result();
                // A packet leaves when its frame is coded, within a frame's time if the device keeps up.
                let caps = sink.current_caps();
                let own = match caps.as_deref().and_then(caps::frame_rate) {
                    Some(rate) => gst::ClockTime::from_seconds_f64(1.0 / caps::per_second(rate)),
                    None => caps::UNKNOWN_FRAME_TIME,
                };
                query.set(live, least + own, most.map(|most| most + own));
                true
            }
            _ => gst::Pad::query_default(src, Some(&*self.obj()), query),
        }
    }

    fn start(&self) -> Result<(), gst::ErrorMessage> {
        if let Err(error) = lock(&self.coding).start.as_deref().map(property::pose).transpose() {
            return Err(gst::error_msg!(gst::LibraryError::Settings, ("{error}")));
        }
        let (keys, stored) = lock(&self.files).read()?;
        let prior = lock(&self.prior).clone();
        let held = HeldPrior::open(&prior, &*self.obj())?;
        gst::info!(CATEGORY, imp = self, "device: {}", held.engine.device());
        *lock(&self.counts) = Counts::default();
        lock(&self.heard).clear();
        *lock(&self.state) = State { held: Some(held), keys, stored, ..State::default() };
        lock(&self.coding).start_again();
        Ok(())
    }
}

#[glib::object_subclass]
impl ObjectSubclass for VehicleEnd {
    const NAME: &'static str = "GstNvspriorVehicle";
    type Type = super::VehicleEnd;
    type ParentType = gst::Element;
}

impl ObjectImpl for VehicleEnd {
    properties_with_stats!();

    fn signals() -> &'static [Signal] {
        static SIGNALS: OnceLock<Vec<Signal>> = OnceLock::new();
        SIGNALS.get_or_init(|| {
            let report = Signal::builder("report")
                .param_types([glib::Bytes::static_type()])
                .run_last()
                .action()
                .class_handler(|values| {
                    let element = values[0].get::<super::VehicleEnd>().ok()?;
                    element.imp().keep_report(None, &values[1].get::<glib::Bytes>().ok()?);
                    None
                });
            vec![report.build()]
        })
    }

    fn constructed(&self) {
        self.parent_constructed();
        let element = self.obj();
        let sink = linked(pad(element.pad_template("sink")), Some("src"))
            .chain_function(guarded!(VehicleEnd, Err(gst::FlowError::Error), |this, _, buffer| {
                this.chain(&buffer)
            }))
            .event_function(
                guarded!(VehicleEnd, false, |this, pad, event| this.sink_event(pad, event))
            )
            .build();
        let src = linked(pad(element.pad_template("src")), Some("sink"))
            .query_function(guarded!(VehicleEnd, false, |this, _, query| this.src_query(query)))
            .build();
        add_pads(&*element, [&sink, &src]);
        let _ = self.pads.set([sink, src]);
    }
}

impl GstObjectImpl for VehicleEnd {}

impl ElementImpl for VehicleEnd {
    registry!(
        "nvsprior vehicle",
        "Codec/Encoder/Payloader/Video",
        "The vehicle's end of a link: frames in, modem frames out, and the topside's reports in",
        [
            ("sink", Sink, Always, caps::pictures(&coding::FORMATS, ImageView::MAX_SIDE)),
            ("reports", Sink, Request, caps::any(caps::REPORT)),
            ("src", Src, Always, caps::any(caps::SHARE)),
        ]
    );

    fn request_new_pad(
        &self,
        template: &gst::PadTemplate,
        _: Option<&str>,
        _: Option<&gst::Caps>,
    ) -> Option<gst::Pad> {
        let reports = linked(pad(Some(template.clone())), None)
            .chain_function(guarded!(
                VehicleEnd,
                Err(gst::FlowError::Error),
                |this, pad, buffer| {
                    let report = buffer.map_readable().map_err(|_| gst::FlowError::Error)?;
                    this.keep_report(running_time(pad, &buffer), &report);
                    Ok(gst::FlowSuccess::Ok)
                }
            ))
            // They say nothing of the frames.
            .event_function(|_, _, _| true)
            .build();
        self.obj().add_pad(&reports).ok()?;
        Some(reports)
    }

    fn release_pad(&self, pad: &gst::Pad) {
        let _ = pad.set_active(false);
        let _ = self.obj().remove_pad(pad);
    }

    fn change_state(
        &self,
        transition: gst::StateChange,
    ) -> Result<gst::StateChangeSuccess, gst::StateChangeError> {
        if transition == gst::StateChange::ReadyToPaused {
            self.start().map_err(|error| {
                self.post_error_message(error);
                gst::StateChangeError
            })?;
        }
        let changed = self.parent_change_state(transition);
        if transition == gst::StateChange::PausedToReady {
            *lock(&self.state) = State::default();
        }
        changed
    }
}
