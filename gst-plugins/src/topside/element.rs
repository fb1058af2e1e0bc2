//! The element `nvsptopside`.
//!
//! Pictures that are due go on from the thread that brings modem frames. In live pipelines a second thread sees to
//! those that are due while none comes, and to reports.

use std::sync::{Condvar, Mutex, OnceLock, PoisonError};

use gst::glib;
use gst::glib::subclass::Signal;
use gst::prelude::*;
use gst::subclass::prelude::*;

use nvsprior_link::keys::Keys;
use nvsprior_link::modem::CollectorStatistics;
use nvsprior_link::{Playout, Topside, TopsideEvent, TopsideOptions};

use super::end::{End, NextError, Picture};
use crate::caps;
use crate::element::{add_pads, guarded, linked, log_category, pad, registry, running_time};
use crate::end_files::EndFiles;
use crate::held_prior::{HeldPrior, PriorSettings};
use crate::lock::lock;
use crate::property;
use crate::showing::{self, showing_element};
use crate::stats::{self, properties_with_stats};

log_category!("nvsptopside", "nvsprior topside's end of a link");

#[derive(Clone, Debug)]
struct Settings {
    mtu: u32,
    /// 0: as many as the MTU takes.
    shares: u32,
    stream: u32,
    /// Milliseconds.
    latency: u32,
    /// Milliseconds.
    report_every: u32,
    region: Option<String>,
    region_weight: u32,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            mtu: 64,
            shares: 0,
            stream: 0,
            latency: 1500,
            report_every: 1000,
            region: None,
            region_weight: 8,
        }
    }
}

/// What it takes to make the topside.
#[derive(Default)]
struct Maker {
    held: Option<HeldPrior>,
    keys: Option<Keys>,
    /// What it goes on with.
    stored: Vec<u8>,
    end: Option<End>,
}

/// What the element holds while it runs.
#[derive(Default)]
struct State {
    /// What the caps state.
    frame_rate: Option<gst::Fraction>,
    /// The time of the last modem frame, seconds.
    now: f64,
    /// When the next picture goes on at the latest, seconds.
    picture_due: Option<f64>,
    /// When a report was asked for last, seconds.
    asked_report: Option<f64>,
    /// The longest that a picture took, as it was told downstream.
    taken: gst::ClockTime,
    /// The latency of what comes before, if that is live.
    upstream: Option<gst::ClockTime>,
    /// What comes before was asked.
    asked: bool,
    /// The timer's thread is to end.
    stopping: bool,
    /// What the timer waits for, and until when, seconds.
    timer: Option<(gst::SingleShotClockId, f64)>,
}

#[derive(Default)]
struct Counts {
    datagrams: u64,
    refused: u64,
    packets: u64,
    between: u64,
    complete: u64,
    damaged_pictures: u64,
    reports: u64,
    shares: CollectorStatistics,
    late: u64,
    last: Option<gst::Structure>,
}

showing_element! {
    wrapper: [super::TopsideEnd];
    #[derive(Default)]
    struct TopsideEnd {
        #[property(name = "mtu", get, set, type = u32, member = mtu, mutable_ready, default_value = 64, minimum = 8,
            maximum = 65535,
            blurb = "Most bytes of a modem frame or datagram, as of nvspvehicle; what lies beyond it is padding")]
        #[property(name = "shares", get, set, type = u32, member = shares, mutable_ready, maximum = 256,
            blurb = "Modem frames of a packet that there is room for; 0: 64, with a small MTU more")]
        #[property(name = "stream", get, set, type = u32, member = stream, mutable_ready, maximum = 3,
            blurb = "Number of the stream, if several cameras share a link")]
        #[property(name = "latency", get = Self::latency, set = Self::set_latency, type = u32, mutable_playing,
            default_value = 1500,
            blurb = "Milliseconds for which a packet waits for its modem frames; after them what came of it is shown")]
        #[property(name = "report-every", get, set, type = u32, member = report_every, mutable_ready,
            default_value = 1000,
            blurb = "Milliseconds between two reports on the pad reports")]
        #[property(name = "region", get = Self::region, set = Self::set_region, type = Option<String>, mutable_playing,
            blurb = "What the pilot looks at, x,y,width,height as parts (0 to 1) of the picture's width and height: \
                reports tell the vehicle, and it gets more of the bytes")]
        #[property(name = "region-weight", get, set, type = u32, member = region_weight, mutable_playing,
            default_value = 8, minimum = 1, maximum = 255,
            blurb = "How many times more an error in the region counts")]
        settings: Mutex<Settings>,

        #[property(name = "key-file", get, set, type = Option<String>, member = key_file, mutable_ready,
            blurb = "File with the vehicle's key, as nvsprior key makes it: other datagrams are counted and not used")]
        #[property(name = "epoch", get, set, type = u64, member = epoch, mutable_ready,
            blurb = "Number of the dive, as for nvspvehicle, with key-file")]
        #[property(name = "tag-bytes", get, set, type = u32, member = tag_bytes, mutable_ready, default_value = 4,
            minimum = 2, maximum = 16,
            blurb = "Bytes of a tag, as for nvspvehicle, with key-file")]
        #[property(name = "state-file", get, set, type = Option<String>, member = state_file, mutable_ready,
            blurb = "File of what this end goes on with after a restart: the vehicle's camera, and numbers of keys")]
        files: Mutex<EndFiles>,

        pads: OnceLock<[gst::Pad; 2]>,
        reports: Mutex<Option<gst::Pad>>,
        counts: Mutex<Counts>,
        state: Mutex<State>,
        // The state has changed in a way that the timer cares about.
        changed: Condvar,
        // Decoding holds it, so take it before the others.
        maker: Mutex<Maker>,
        // Held while pictures go on, so that both threads keep their order.
        output: Mutex<()>,
    }
}

impl TopsideEnd {
    fn pads(&self) -> &[gst::Pad; 2] {
        self.pads.get().expect("a constructed element has pads")
    }

    fn latency(&self) -> u32 {
        lock(&self.settings).latency
    }

    fn set_latency(&self, milliseconds: u32) {
        lock(&self.settings).latency = milliseconds;
        self.post_latency();
    }

    /// The pipeline asks anew how long sinks must wait.
    fn post_latency(&self) {
        let message = gst::message::Latency::builder().src(&*self.obj()).build();
        let _ = self.obj().post_message(message);
    }

    fn region(&self) -> Option<String> {
        lock(&self.settings).region.clone()
    }

    fn set_region(&self, text: Option<String>) {
        if let Err(error) = text.as_deref().map(|text| property::pilots_region(text, 1)).transpose()
        {
            // What holds goes on.
            gst::element_imp_warning!(self, gst::LibraryError::Settings, ("{error}"));
            return;
        }
        lock(&self.settings).region = text;
    }

    fn stats(&self) -> gst::Structure {
        let counts = lock(&self.counts);
        let shares = &counts.shares;
        let mut stats = gst::Structure::builder("nvsptopside-stats")
            .field("datagrams", counts.datagrams)
            .field("refused", counts.refused)
            .field("duplicates", shares.duplicates)
            .field("pictures", counts.packets + counts.between)
            .field("packets", counts.packets)
            .field("between", counts.between)
            .field("complete", counts.complete)
            .field("incomplete", counts.damaged_pictures)
            .field("late", counts.late)
            .field("reports", counts.reports)
            .field("repaired", shares.repaired)
            .field("partial", shares.partial)
            .field("lost", shares.lost)
            .field("damaged", shares.damaged)
            .field("foreign", shares.foreign)
            .field("replayed", shares.replayed)
            .build();
        if shares.sent > 0 {
            stats.set("loss", 1.0 - shares.arrived as f64 / shares.sent as f64);
        }
        if let Some(last) = &counts.last {
            stats.set("last", last);
        }
        stats
    }

    /// A report for the vehicle, if one is due at `now`, seconds.
    fn report(&self, now: f64) -> Option<glib::Bytes> {
        let mut maker = lock(&self.maker);
        let end = maker.end.as_mut()?;
        self.follow(end);
        let report = end.topside.report(now);
        let report =
            report.inspect_err(|error| gst::debug!(CATEGORY, imp = self, "a report: {error}"));
        let report = glib::Bytes::from(report.ok()??);
        self.tell(&mut maker);
        lock(&self.counts).reports += 1;
        Some(report)
    }

    /// Sends the report that is due on the pad, if there is one.
    fn send_report(&self, now: f64) {
        let Some(pad) = lock(&self.reports).clone() else { return };
        lock(&self.state).asked_report = Some(now);
        let Some(report) = self.report(now) else { return };
        if pad.sticky_event::<gst::event::Segment>(0).is_none() {
            let id = pad.create_stream_id(&*self.obj(), Some("reports"));
            pad.push_event(gst::event::StreamStart::new(&id));
            pad.push_event(gst::event::Caps::new(&caps::any(caps::REPORT)));
            let segment = gst::FormattedSegment::<gst::ClockTime>::new();
            pad.push_event(gst::event::Segment::new(&segment));
        }
        // Without a time it goes at once.
        if let Err(error) = pad.push(gst::Buffer::from_slice(report)) {
            gst::debug!(CATEGORY, imp = self, "a report: {error}");
        }
    }

    /// Asks what comes before whether it is live. Its latency, if it is.
    fn ask_upstream(&self) -> Option<gst::ClockTime> {
        let mut query = gst::query::Latency::new();
        let (live, least, _) = if self.pads()[0].peer_query(&mut query) {
            query.result()
        } else {
            (false, gst::ClockTime::ZERO, None)
        };
        live.then_some(least)
    }

    /// When a datagram came, seconds of running time.
    fn arrival(&self, state: &State, buffer: &gst::BufferRef) -> f64 {
        // The pipeline's running time less the latency of what comes before.
        let clock = || {
            let running = self.obj().current_running_time()?;
            Some(running.seconds_f64() - state.upstream.unwrap_or_default().seconds_f64())
        };
        let now = running_time(&self.pads()[0], buffer).or_else(clock);
        now.unwrap_or(state.now).max(state.now)
    }

    fn make(&self, maker: &Maker) -> Result<End, gst::ErrorMessage> {
        let Some(held) = &maker.held else {
            return Err(gst::error_msg!(gst::CoreError::Failed, ("a datagram before the start")));
        };
        let settings = lock(&self.settings).clone();
        let frame_rate = lock(&self.state).frame_rate;
        // Without the pad the application asks when it wants one.
        let has_pad = lock(&self.reports).is_some();
        let every = if has_pad { settings.report_every } else { 0 };
        let options = TopsideOptions {
            stream: settings.stream as u8,
            playout: Playout::InOrder {
                latency: f64::from(settings.latency) / 1e3,
                frame_rate: frame_rate.map(caps::per_second),
            },
            max_shares: (settings.shares > 0).then_some(settings.shares as usize),
            report_every: Some(f64::from(every) / 1e3),
            keys: maker.keys.clone(),
            state: maker.stored.clone(),
            ..TopsideOptions::new(settings.mtu as usize)
        };
        let decoder = lock(&self.showing).decoder(held)?;
        let topside = Topside::with(decoder, &options)
            .map_err(|error| gst::error_msg!(gst::LibraryError::Settings, ("{error}")))?;
        Ok(End::new(topside, frame_rate))
    }

    /// Follows the properties that may change while modem frames come.
    fn follow(&self, end: &mut End) {
        let (latency, region) = {
            let settings = lock(&self.settings);
            let region = settings.region.clone().map(|text| (text, settings.region_weight));
            (settings.latency, region)
        };
        let link = end.topside.link();
        link.set_latency(f64::from(latency) / 1e3);
        if end.region != region {
            let told = region.as_ref();
            link.set_region(
                told.and_then(|(text, weight)| property::pilots_region(text, *weight).ok()),
            );
            end.region = region;
        }
    }

    /// Takes a datagram. Returns when it came.
    fn take(&self, buffer: &gst::BufferRef) -> Result<f64, gst::ErrorMessage> {
        let now = {
            let mut state = lock(&self.state);
            state.now = self.arrival(&state, buffer);
            state.now
        };
        let mut maker = lock(&self.maker);
        if maker.end.is_none() {
            maker.end = Some(self.make(&maker)?);
        }
        let mapped = buffer.map_readable();
        let datagram = mapped.as_deref().unwrap_or(&[]);
        if let Some(end) = &mut maker.end {
            self.follow(end);
            let taken = end.topside.receive(now, datagram);
            let mut counts = lock(&self.counts);
            counts.datagrams += 1;
            if let Err(error) = taken {
                // Others may use the link, too, and it may damage what it carries.
                counts.refused += 1;
                gst::debug!(CATEGORY, imp = self, "{error}");
            }
        }
        self.tell(&mut maker);
        Ok(now)
    }

    /// Tells what the topside tells, and notes its figures.
    fn tell(&self, maker: &mut Maker) {
        let Some(end) = &mut maker.end else { return };
        let link = end.topside.link();
        while let Some(event) = link.event() {
            let message = gst::Structure::builder("nvsptopside-event");
            let message = match event {
                TopsideEvent::VehicleHeard => message.field("event", "vehicle-heard"),
                TopsideEvent::VehicleSilent(seconds) => {
                    message.field("event", "vehicle-silent").field("seconds", seconds)
                }
                TopsideEvent::Strangers(count) => {
                    message.field("event", "strangers").field("count", count)
                }
                TopsideEvent::Store => {
                    lock(&self.files).store(&*self.obj(), |into| link.state(into));
                    continue;
                }
            };
            stats::post(self.obj().upcast_ref(), message.build());
        }
        {
            let mut counts = lock(&self.counts);
            (counts.shares, counts.late) = (link.statistics(), link.late());
        }
        lock(&self.state).picture_due = link.picture_due();
    }

    /// Forgets the topside, and keeps what the next one goes on with.
    fn put_away(&self) {
        let mut maker = lock(&self.maker);
        if let Some(mut end) = maker.end.take() {
            end.topside.link().state(&mut maker.stored);
        }
        lock(&self.state).picture_due = None;
    }

    /// When the timer has something to do, seconds.
    fn deadline(&self, state: &State) -> Option<f64> {
        let every = f64::from(lock(&self.settings).report_every.max(10)) / 1e3;
        let has_pad = lock(&self.reports).is_some();
        let report = state.asked_report.filter(|_| has_pad).map(|asked| asked + every);
        [state.picture_due, report].into_iter().flatten().reduce(f64::min)
    }

    /// Wakes the timer, if it waits for nothing or for too long.
    fn set_timer(&self) {
        let state = lock(&self.state);
        if let (Some((id, until)), Some(deadline)) = (&state.timer, self.deadline(&state))
            && deadline < *until
        {
            id.unschedule();
        }
        self.changed.notify_all();
    }

    /// Passes on the pictures that are due at `now`, seconds.
    fn play(&self, now: f64) -> Result<gst::FlowSuccess, gst::FlowError> {
        let _output = lock(&self.output);
        while let Some(picture) = self.next(now)? {
            let src = &self.pads()[1];
            if let Some(caps) = picture.caps {
                src.push_event(gst::event::Caps::new(&caps));
            }
            if src.sticky_event::<gst::event::Segment>(0).is_none() {
                // Times are running times.
                let segment = gst::FormattedSegment::<gst::ClockTime>::new();
                src.push_event(gst::event::Segment::new(&segment));
            }
            src.push(picture.buffer)?;
        }
        Ok(gst::FlowSuccess::Ok)
    }

    /// The next picture that goes on at `now`, seconds.
    fn next(&self, now: f64) -> Result<Option<Picture>, gst::FlowError> {
        let showing = lock(&self.showing).clone();
        let mut maker = lock(&self.maker);
        let Some(end) = &mut maker.end else { return Ok(None) };
        let next = end.next(now, &self.pads()[1], &showing);
        self.tell(&mut maker);
        drop(maker);
        let (next, said) = next.map_err(|error| match error {
            NextError::Flow(error) => error,
            NextError::Failed(message) => self.fail(message),
        })?;
        if let Some(said) = said {
            gst::element_imp_warning!(self, gst::StreamError::Decode, ("{said}"));
        }
        let Some(picture) = next else { return Ok(None) };
        {
            let mut counts = lock(&self.counts);
            counts.packets += u64::from(picture.is_own);
            counts.between += u64::from(!picture.is_own);
            counts.complete += u64::from(picture.is_complete);
            counts.damaged_pictures += u64::from(picture.is_damaged);
            counts.last = Some(picture.figures.clone());
        }
        if showing.post_messages {
            stats::post(self.obj().upcast_ref(), picture.figures.clone());
        }
        if let Some(truth) = &picture.truth {
            stats::post(self.obj().upcast_ref(), truth.clone());
        }
        let taken = showing::latency_of(picture.taken);
        let is_longer = {
            let mut state = lock(&self.state);
            let before = state.taken;
            state.taken = before.max(taken);
            before < taken
        };
        if is_longer {
            self.post_latency();
        }
        Ok(Some(picture))
    }

    fn fail(&self, error: gst::ErrorMessage) -> gst::FlowError {
        self.post_error_message(error);
        gst::FlowError::Error
    }

    fn chain(&self, buffer: &gst::BufferRef) -> Result<gst::FlowSuccess, gst::FlowError> {
        self.watch();
        let now = self.take(buffer).map_err(|error| self.fail(error))?;
        let played = self.play(now);
        self.send_report(now);
        self.set_timer();
        played
    }

    /// Starts the timer if what comes before is live.
    fn watch(&self) {
        if std::mem::replace(&mut lock(&self.state).asked, true) {
            return;
        }
        let upstream = self.ask_upstream();
        lock(&self.state).upstream = upstream;
        if upstream.is_some() {
            let element = self.obj().downgrade();
            let started = self.pads()[1].start_task(move || {
                if let Some(element) = element.upgrade() {
                    element.imp().wait();
                }
            });
            if let Err(error) = started {
                gst::warning!(CATEGORY, imp = self, "the timer's thread: {error}");
            }
        }
    }

    /// Waits for the next picture's time, or report's, and sees to it. The timer's thread calls it again and again.
    fn wait(&self) {
        let (id, until) = {
            let mut state = lock(&self.state);
            loop {
                if state.stopping {
                    // Under the lock, so that a flush cannot start the task in between.
                    let _ = self.pads()[1].pause_task();
                    return;
                }
                let times = self.obj().clock().zip(self.obj().base_time());
                if let (Some(until), Some((clock, base)), Some(upstream)) =
                    (self.deadline(&state), times, state.upstream)
                {
                    let until_clock = gst::ClockTime::from_seconds_f64(until.max(0.0));
                    let id = clock.new_single_shot_id(base + upstream + until_clock);
                    state.timer = Some((id.clone(), until));
                    break (id, until);
                }
                let waited = self.changed.wait(state);
                state = waited.unwrap_or_else(PoisonError::into_inner);
            }
        };
        let (waited, _) = id.wait();
        {
            let mut state = lock(&self.state);
            state.timer = None;
            state.now = state.now.max(until);
        }
        // On a slow machine the time may be over already.
        let due = waited.is_ok() || waited == Err(gst::ClockError::Early);
        if !due {
            return;
        }
        // A time has rounding.
        if let Err(error) = self.play(until + 1e-6) {
            gst::debug!(CATEGORY, imp = self, "a picture at its latest time: {error}");
            lock(&self.state).stopping = true;
        }
        self.send_report(until);
    }

    fn stop_timer(&self) {
        {
            let mut state = lock(&self.state);
            state.stopping = true;
            if let Some((id, _)) = &state.timer {
                id.unschedule();
            }
        }
        self.changed.notify_all();
        let _ = self.pads()[1].stop_task();
    }

    /// Passes on all that waits.
    fn play_all(&self) -> Result<(), gst::FlowError> {
        let mut before = None;
        loop {
            let due = lock(&self.state).picture_due.filter(|due| Some(*due) != before);
            let Some(due) = due else { return Ok(()) };
            self.play(due + 1e-6)?;
            before = Some(due);
        }
    }

    fn sink_event(&self, sink: &gst::Pad, event: gst::Event) -> bool {
        match event.view() {
            gst::EventView::Caps(of) => {
                let rate = caps::frame_rate(of.caps());
                let before = std::mem::replace(&mut lock(&self.state).frame_rate, rate);
                if before != rate {
                    // Other caps, other times.
                    self.put_away();
                }
                true
            }
            gst::EventView::Segment(_) => true,
            gst::EventView::Eos(_) => {
                if let Err(error) = self.play_all() {
                    gst::debug!(CATEGORY, imp = self, "the last pictures: {error}");
                }
                if let Some(pad) = lock(&self.reports).clone() {
                    pad.push_event(gst::event::Eos::new());
                }
                self.pads()[1].push_event(event)
            }
            gst::EventView::FlushStart(_) => {
                if let Some((id, _)) = &lock(&self.state).timer {
                    id.unschedule();
                }
                self.pads()[1].push_event(event)
            }
            gst::EventView::FlushStop(_) => {
                let done = self.pads()[1].push_event(event);
                let _output = lock(&self.output);
                self.put_away();
                let mut state = lock(&self.state);
                (state.now, state.asked_report) = (0.0, None);
                // The flush may have ended the timer.
                (state.asked, state.stopping) = (false, false);
                done
            }
            // Gaps in the datagrams say nothing of pictures.
            gst::EventView::Gap(_) => true,
            gst::EventView::StreamStart(_) => self.pads()[1].push_event(event),
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
                let mut state = lock(&self.state);
                let latency = gst::ClockTime::from_mseconds(u64::from(self.latency()));
                let own = latency + state.taken;
                query.set(live, least + own, most.map(|most| most + own));
                if state.asked {
                    state.upstream = state.upstream.and(Some(least));
                }
                drop(state);
                self.changed.notify_all();
                true
            }
            _ => gst::Pad::query_default(src, Some(&*self.obj()), query),
        }
    }

    fn start(&self) -> Result<(), gst::ErrorMessage> {
        let (keys, stored) = lock(&self.files).read()?;
        let prior = lock(&self.prior).clone();
        let held = HeldPrior::open(&prior, &*self.obj())?;
        gst::info!(CATEGORY, imp = self, "device: {}", held.engine.device());
        // What is wrong with camera or filter is said before the first datagram.
        lock(&self.showing).decoder(&held)?;
        *lock(&self.maker) = Maker { held: Some(held), keys, stored, end: None };
        *lock(&self.state) = State::default();
        *lock(&self.counts) = Counts::default();
        Ok(())
    }
}

#[glib::object_subclass]
impl ObjectSubclass for TopsideEnd {
    const NAME: &'static str = "GstNvspriorTopside";
    type Type = super::TopsideEnd;
    type ParentType = gst::Element;
}

impl ObjectImpl for TopsideEnd {
    properties_with_stats!();

    fn signals() -> &'static [Signal] {
        static SIGNALS: OnceLock<Vec<Signal>> = OnceLock::new();
        SIGNALS.get_or_init(|| {
            let report = Signal::builder("report")
                .return_type::<Option<glib::Bytes>>()
                .run_last()
                .action()
                .class_handler(|values| {
                    let element = values[0].get::<super::TopsideEnd>().ok()?;
                    let now = lock(&element.imp().state).now;
                    Some(element.imp().report(now).to_value())
                });
            vec![report.build()]
        })
    }

    fn constructed(&self) {
        self.parent_constructed();
        let element = self.obj();
        let sink = linked(pad(element.pad_template("sink")), Some("src"))
            .chain_function(guarded!(TopsideEnd, Err(gst::FlowError::Error), |this, _, buffer| {
                this.chain(&buffer)
            }))
            .event_function(
                guarded!(TopsideEnd, false, |this, pad, event| this.sink_event(pad, event))
            )
            .build();
        let src = linked(pad(element.pad_template("src")), Some("sink"))
            .query_function(guarded!(TopsideEnd, false, |this, _, query| this.src_query(query)))
            .activatemode_function(|_, parent, _, active| {
                let failed = || Err(gst::loggable_error!(CATEGORY, "a panic while (de)activating"));
                TopsideEnd::catch_panic_pad_function(parent, failed, |this| {
                    if !active {
                        this.stop_timer();
                    }
                    Ok(())
                })
            })
            .build();
        add_pads(&*element, [&sink, &src]);
        let _ = self.pads.set([sink, src]);
    }
}

impl GstObjectImpl for TopsideEnd {}

impl ElementImpl for TopsideEnd {
    registry!(
        "nvsprior topside",
        "Codec/Decoder/Depayloader/Video",
        "The topside's end of a link: modem frames in, pictures out, and reports for the vehicle out",
        [
            ("sink", Sink, Always, caps::any(caps::SHARE)),
            ("src", Src, Always, showing::caps()),
            ("reports", Src, Request, caps::any(caps::REPORT)),
        ]
    );

    fn request_new_pad(
        &self,
        template: &gst::PadTemplate,
        _: Option<&str>,
        _: Option<&gst::Caps>,
    ) -> Option<gst::Pad> {
        let reports = linked(pad(Some(template.clone())), None).build();
        self.obj().add_pad(&reports).ok()?;
        *lock(&self.reports) = Some(reports.clone());
        Some(reports)
    }

    fn release_pad(&self, pad: &gst::Pad) {
        *lock(&self.reports) = None;
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
            *lock(&self.maker) = Maker::default();
        }
        // Playing or not decides whether the timer can wait.
        self.changed.notify_all();
        changed
    }
}
