//! The element `nvspdepay`.
//!
//! Packets that are due go on from the thread that brings shares. In live pipelines a second thread sees to those that
//! are due while no share comes.

use std::sync::{Condvar, Mutex, OnceLock, PoisonError};

use gst::glib;
use gst::glib::subclass::Signal;
use gst::prelude::*;
use gst::subclass::prelude::*;

use nvsprior::link::{DuePacket, Playout, TopsideLink, TopsideOptions};

use crate::caps;
use crate::element::{add_pads, log_category, pad, registry};
use crate::keys::{KeySettings, key_properties};
use crate::lock::lock;
use crate::stats::properties_with_stats;

log_category!("nvspdepay", "nvsprior depayloader");

#[derive(Clone, Debug)]
struct Settings {
    mtu: u32,
    shares: u32,
    stream: u32,
    /// Milliseconds.
    latency: u32,
    keys: KeySettings,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { mtu: 1500, shares: 64, stream: 0, latency: 1500, keys: KeySettings::default() }
    }
}

/// What the element holds while it runs.
#[derive(Default)]
struct State {
    playout: Option<TopsideLink>,
    /// What the caps state.
    frame_rate: Option<gst::Fraction>,
    /// That of the shares' times.
    segment: Option<gst::FormattedSegment<gst::ClockTime>>,
    /// The time of the last share, seconds.
    now: f64,
    /// Caps and segment have gone on.
    begun: bool,
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
    complete: u64,
}

#[derive(glib::Properties)]
#[properties(wrapper_type = super::Depayloader)]
pub struct Depayloader {
    sink: gst::Pad,
    src: gst::Pad,

    #[property(name = "mtu", get, set, type = u32, member = mtu, mutable_ready, default_value = 1500, minimum = 16,
        maximum = 65535,
        blurb = "The largest share that comes, bytes; what lies beyond it is padding")]
    #[property(name = "shares", get, set, type = u32, member = shares, mutable_ready, default_value = 64, minimum = 1,
        maximum = 256,
        blurb = "Most shares of a packet; together with mtu it decides the memory")]
    #[property(name = "stream", get, set, type = u32, member = stream, mutable_ready, maximum = 3,
        blurb = "Number of the stream, if several cameras share a link")]
    #[property(name = "latency", get = Self::latency, set = Self::set_latency, type = u32, mutable_playing,
        default_value = 1500,
        blurb = "Milliseconds for which a packet waits for its shares; after them what came of it goes on")]
    #[property(name = "key-file", get = Self::key_file, set = Self::set_key_file, type = Option<String>, mutable_ready,
        blurb = "File with the key of nvsppay, as nvsprior key makes it: other datagrams are counted and not used")]
    #[property(name = "epoch", get = Self::epoch, set = Self::set_epoch, type = u64, mutable_ready,
        blurb = "Number of the dive, as for nvsppay, with key-file")]
    #[property(name = "tag-bytes", get = Self::tag_bytes, set = Self::set_tag_bytes, type = u32, mutable_ready,
        default_value = 4, minimum = 2, maximum = 16,
        blurb = "Bytes of a tag, as for nvsppay, with key-file")]
    #[property(name = "first-number", get = Self::first_number, set = Self::set_first_number, type = u64, mutable_ready,
        maximum = (1 << 48) - 1,
        blurb = "Number of the first report, with key-file: next-number of stats, if an epoch goes on")]
    settings: Mutex<Settings>,

    counts: Mutex<Counts>,
    state: Mutex<State>,
    /// The state has changed in a way that the timer cares about.
    changed: Condvar,
    /// Held while packets go on, so that both threads keep their order.
    output: Mutex<()>,
}

impl Depayloader {
    key_properties!();

    fn latency(&self) -> u32 {
        lock(&self.settings).latency
    }

    fn set_latency(&self, milliseconds: u32) {
        lock(&self.settings).latency = milliseconds;
        if let Some(playout) = &mut lock(&self.state).playout {
            playout.set_latency(f64::from(milliseconds) / 1e3);
        }
        // The pipeline asks anew how long sinks must wait.
        let message = gst::message::Latency::builder().src(&*self.obj()).build();
        let _ = self.obj().post_message(message);
    }

    fn stats(&self) -> gst::Structure {
        let (shares, late, next_number) = {
            let state = lock(&self.state);
            let playout = state.playout.as_ref();
            let shares = playout.map(TopsideLink::statistics).unwrap_or_default();
            let next_number = playout.and_then(|playout| playout.collector().next_number());
            (shares, playout.map_or(0, TopsideLink::late), next_number.unwrap_or(0))
        };
        let counts = lock(&self.counts);
        let mut stats = gst::Structure::builder("nvspdepay-stats")
            .field("datagrams", counts.datagrams)
            .field("refused", counts.refused)
            .field("duplicates", shares.duplicates)
            .field("packets", counts.packets)
            .field("complete", counts.complete)
            .field("late", late)
            .field("repaired", shares.repaired)
            .field("partial", shares.partial)
            .field("lost", shares.lost)
            .field("damaged", shares.damaged)
            .field("foreign", shares.foreign)
            .field("replayed", shares.replayed)
            .field("next-number", next_number)
            .build();
        if shares.sent > 0 {
            stats.set("loss", 1.0 - shares.arrived as f64 / shares.sent as f64);
        }
        stats
    }

    /// A report for the vehicle; `None`: there is nothing to tell.
    fn report(&self) -> Option<glib::Bytes> {
        let mut state = lock(&self.state);
        let now = state.now;
        let report = state.playout.as_mut()?.report_packets(now);
        let report =
            report.inspect_err(|error| gst::debug!(CATEGORY, imp = self, "a report: {error}"));
        Some(glib::Bytes::from(report.ok()??))
    }

    /// Asks what comes before whether it is live. Its latency, if it is.
    fn ask_upstream(&self) -> Option<gst::ClockTime> {
        let mut query = gst::query::Latency::new();
        let (live, least, _) = if self.sink.peer_query(&mut query) {
            query.result()
        } else {
            (false, gst::ClockTime::ZERO, None)
        };
        live.then_some(least)
    }

    /// The pipeline's running time less the latency of what comes before, seconds.
    fn clock_now(&self, upstream: gst::ClockTime) -> Option<f64> {
        let running = self.obj().current_running_time()?;
        Some(running.seconds_f64() - upstream.seconds_f64())
    }

    /// When a datagram came, seconds of running time.
    fn arrival(&self, state: &State, buffer: &gst::BufferRef) -> f64 {
        let segment = state.segment.as_ref();
        let running = segment.and_then(|segment| segment.to_running_time(buffer.dts_or_pts()?));
        let clock = || self.clock_now(state.upstream.unwrap_or_default());
        let now = running.map(|time| time.seconds_f64()).or_else(clock);
        now.unwrap_or(state.now).max(state.now)
    }

    fn playout(&self, state: &State) -> Result<TopsideLink, gst::ErrorMessage> {
        let settings = lock(&self.settings).clone();
        let keys = settings.keys.open();
        let keys =
            keys.map_err(|error| gst::error_msg!(gst::ResourceError::OpenRead, ("{error}")))?;
        let options = TopsideOptions {
            stream: settings.stream as u8,
            playout: Playout::InOrder {
                latency: f64::from(settings.latency) / 1e3,
                frame_rate: state.frame_rate.map(caps::per_second),
            },
            max_shares: Some(settings.shares as usize),
            // The application asks when it wants one.
            report_every: Some(0.0),
            keys,
            ..TopsideOptions::new(settings.mtu as usize)
        };
        TopsideLink::new(&options)
            .map_err(|error| gst::error_msg!(gst::LibraryError::Settings, ("{error}")))
    }

    /// Takes a datagram. Returns when it came.
    fn take(&self, buffer: &gst::BufferRef) -> Result<f64, gst::ErrorMessage> {
        let mut state = lock(&self.state);
        if state.playout.is_none() {
            state.playout = Some(self.playout(&state)?);
        }
        let now = self.arrival(&state, buffer);
        state.now = now;
        let mapped = buffer.map_readable();
        let datagram = mapped.as_deref().unwrap_or(&[]);
        let taken = state.playout.as_mut().map(|playout| playout.receive(now, datagram));
        let mut counts = lock(&self.counts);
        counts.datagrams += 1;
        if let Some(Err(error)) = taken {
            // Others may use the link, too, and it may damage what it carries.
            counts.refused += 1;
            gst::debug!(CATEGORY, imp = self, "{error}");
        }
        Ok(now)
    }

    /// Wakes the timer, if it waits for nothing or for too long.
    fn set_timer(&self) {
        let state = lock(&self.state);
        let deadline = state.playout.as_ref().and_then(TopsideLink::picture_due);
        if let (Some((id, until)), Some(deadline)) = (&state.timer, deadline)
            && deadline < *until
        {
            id.unschedule();
        }
        self.changed.notify_all();
    }

    /// Passes on the packets that are due at `now`, seconds.
    fn play(&self, now: f64) -> Result<gst::FlowSuccess, gst::FlowError> {
        let _output = lock(&self.output);
        loop {
            let Some(buffer) = self.next_buffer(now) else { return Ok(gst::FlowSuccess::Ok) };
            self.begin();
            self.src.push(buffer)?;
        }
    }

    /// Sends caps and segment before the first packet.
    fn begin(&self) {
        let (rate, begun) = {
            let mut state = lock(&self.state);
            (state.frame_rate, std::mem::replace(&mut state.begun, true))
        };
        if begun {
            return;
        }
        if self.src.sticky_event::<gst::event::StreamStart>(0).is_none() {
            let id = self.src.create_stream_id(&*self.obj(), None);
            self.src.push_event(gst::event::StreamStart::new(&id));
        }
        let mut caps = caps::any(caps::PACKET);
        let fields = caps.make_mut();
        fields.set("trust", "start");
        if let Some(rate) = rate {
            fields.set("framerate", rate);
        }
        self.src.push_event(gst::event::Caps::new(&caps));
        // Times are running times.
        let segment = gst::FormattedSegment::<gst::ClockTime>::new();
        self.src.push_event(gst::event::Segment::new(&segment));
    }

    /// The next packet that goes on at `now`, seconds; infinite: all do.
    fn next_buffer(&self, now: f64) -> Option<gst::Buffer> {
        let mut state = lock(&self.state);
        let rate = state.frame_rate;
        let now = if now.is_finite() { now } else { f64::MAX };
        let (due, packet) = state.playout.as_mut()?.next_packet(now).ok()??;
        let DuePacket { frame, time, restarted } = due;
        let mut counts = lock(&self.counts);
        counts.packets += 1;
        counts.complete += u64::from(packet.complete);
        drop(counts);
        let mut buffer = gst::Buffer::from_slice(packet.bytes.to_vec());
        let fields = buffer.make_mut();
        fields.set_pts(gst::ClockTime::from_seconds_f64(time.max(0.0)));
        fields.set_duration(
            rate.map(|rate| gst::ClockTime::from_seconds_f64(1.0 / caps::per_second(rate))),
        );
        fields.set_offset(frame.max(0) as u64);
        if restarted {
            fields.set_flags(gst::BufferFlags::DISCONT);
        }
        if !packet.complete {
            fields.set_flags(gst::BufferFlags::CORRUPTED);
        }
        Some(buffer)
    }

    fn chain(&self, buffer: gst::Buffer) -> Result<gst::FlowSuccess, gst::FlowError> {
        self.watch();
        let now = self.take(&buffer).map_err(|error| {
            self.post_error_message(error);
            gst::FlowError::Error
        })?;
        let played = self.play(now);
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
            let started = self.src.start_task(move || {
                if let Some(element) = element.upgrade() {
                    element.imp().wait();
                }
            });
            if let Err(error) = started {
                gst::warning!(CATEGORY, imp = self, "the timer's thread: {error}");
            }
        }
    }

    /// Waits for the next packet's time, and passes it on. The timer's thread calls it again and again.
    fn wait(&self) {
        let (id, until) = {
            let mut state = lock(&self.state);
            loop {
                if state.stopping {
                    // Under the lock, so that a flush cannot start the task in between.
                    let _ = self.src.pause_task();
                    return;
                }
                let deadline = state.playout.as_ref().and_then(TopsideLink::picture_due);
                let times = self.obj().clock().zip(self.obj().base_time());
                if let (Some(until), Some((clock, base)), Some(upstream)) =
                    (deadline, times, state.upstream)
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
        lock(&self.state).timer = None;
        // On a slow machine the time may be over already.
        let due = waited.is_ok() || waited == Err(gst::ClockError::Early);
        if due && let Err(error) = self.play(until) {
            gst::debug!(CATEGORY, imp = self, "a packet at its latest time: {error}");
            lock(&self.state).stopping = true;
        }
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
        let _ = self.src.stop_task();
    }

    fn sink_event(&self, event: gst::Event) -> bool {
        match event.view() {
            gst::EventView::Caps(of) => {
                let rate = caps::frame_rate(of.caps());
                let mut state = lock(&self.state);
                if state.frame_rate != rate {
                    state.frame_rate = rate;
                    // Other caps, other times.
                    (state.playout, state.begun) = (None, false);
                }
                true
            }
            gst::EventView::Segment(of) => {
                let segment = of.segment().clone();
                lock(&self.state).segment = segment.downcast::<gst::ClockTime>().ok();
                true
            }
            gst::EventView::Eos(_) => {
                if let Err(error) = self.play(f64::INFINITY) {
                    gst::debug!(CATEGORY, imp = self, "the last packets: {error}");
                }
                gst::Pad::event_default(&self.sink, Some(&*self.obj()), event)
            }
            gst::EventView::FlushStart(_) => {
                if let Some((id, _)) = &lock(&self.state).timer {
                    id.unschedule();
                }
                gst::Pad::event_default(&self.sink, Some(&*self.obj()), event)
            }
            gst::EventView::FlushStop(_) => {
                let done = gst::Pad::event_default(&self.sink, Some(&*self.obj()), event);
                let _output = lock(&self.output);
                let mut state = lock(&self.state);
                (state.playout, state.now, state.begun) = (None, 0.0, false);
                // The flush may have ended the timer.
                (state.asked, state.stopping) = (false, false);
                done
            }
            // Gaps in the datagrams say nothing of pictures.
            gst::EventView::Gap(_) => true,
            _ => gst::Pad::event_default(&self.sink, Some(&*self.obj()), event),
        }
    }

    fn src_query(&self, query: &mut gst::QueryRef) -> bool {
        match query.view_mut() {
            gst::QueryViewMut::Latency(query) => {
                let mut above = gst::query::Latency::new();
                if !self.sink.peer_query(&mut above) {
                    return false;
                }
                let (live, least, most) = above.result();
                let own = gst::ClockTime::from_mseconds(u64::from(self.latency()));
                query.set(live, least + own, most.map(|most| most + own));
                let mut state = lock(&self.state);
                if state.asked {
                    state.upstream = state.upstream.and(Some(least));
                }
                drop(state);
                self.changed.notify_all();
                true
            }
            _ => gst::Pad::query_default(&self.src, Some(&*self.obj()), query),
        }
    }
}

#[glib::object_subclass]
impl ObjectSubclass for Depayloader {
    const NAME: &'static str = "GstNvspriorDepayloader";
    type Type = super::Depayloader;
    type ParentType = gst::Element;

    fn with_class(class: &Self::Class) -> Self {
        let sink = pad(class.pad_template("sink"))
            .chain_function(|_, parent, buffer| {
                Depayloader::catch_panic_pad_function(
                    parent,
                    || Err(gst::FlowError::Error),
                    |this| this.chain(buffer),
                )
            })
            .event_function(|_, parent, event| {
                Depayloader::catch_panic_pad_function(
                    parent,
                    || false,
                    |this| this.sink_event(event),
                )
            })
            .build();
        let src = pad(class.pad_template("src"))
            .query_function(|_, parent, query| {
                Depayloader::catch_panic_pad_function(
                    parent,
                    || false,
                    |this| this.src_query(query),
                )
            })
            .activatemode_function(|_, parent, _, active| {
                Depayloader::catch_panic_pad_function(
                    parent,
                    || Err(gst::loggable_error!(CATEGORY, "a panic while (de)activating")),
                    |this| {
                        if !active {
                            this.stop_timer();
                        }
                        Ok(())
                    },
                )
            })
            .build();
        Depayloader {
            sink,
            src,
            settings: Mutex::default(),
            counts: Mutex::default(),
            state: Mutex::default(),
            changed: Condvar::new(),
            output: Mutex::default(),
        }
    }
}

impl ObjectImpl for Depayloader {
    properties_with_stats!();

    fn signals() -> &'static [Signal] {
        static SIGNALS: OnceLock<Vec<Signal>> = OnceLock::new();
        SIGNALS.get_or_init(|| {
            let report = Signal::builder("report")
                .return_type::<Option<glib::Bytes>>()
                .run_last()
                .action()
                .class_handler(|values| {
                    let element = values[0].get::<super::Depayloader>().ok()?;
                    Some(element.imp().report().to_value())
                });
            vec![report.build()]
        })
    }

    fn constructed(&self) {
        self.parent_constructed();
        add_pads(&*self.obj(), [&self.sink, &self.src]);
    }
}

impl GstObjectImpl for Depayloader {}

impl ElementImpl for Depayloader {
    registry!(
        "nvsprior depayloader",
        "Codec/Depayloader/Network",
        "Puts packets together from shares, which may come in any order, late, or not at all",
        sink: caps::any(caps::SHARE),
        src: caps::any(caps::PACKET)
    );

    fn change_state(
        &self,
        transition: gst::StateChange,
    ) -> Result<gst::StateChangeSuccess, gst::StateChangeError> {
        if transition == gst::StateChange::ReadyToPaused {
            *lock(&self.state) = State::default();
            *lock(&self.counts) = Counts::default();
        }
        let changed = self.parent_change_state(transition);
        // Playing or not decides whether the timer can wait.
        self.changed.notify_all();
        changed
    }
}
