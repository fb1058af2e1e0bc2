//! The element `nvsppay`.

use std::sync::Mutex;

use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;

use nvsprior::keys::{Authenticator, Content};
use nvsprior::modem::{Interleaver, Loss, ModemError, Sharer};
use nvsprior::packet::Extent;

use crate::budget::Budget;
use crate::caps;
use crate::element::{add_pads, log_category, pad, registry};
use crate::keys::{KeyFileError, KeySettings, key_properties};
use crate::lock::lock;
use crate::stats::properties_with_stats;

log_category!("nvsppay", "nvsprior payloader");

#[derive(Clone, Debug)]
struct Settings {
    stream: u32,
    mtu: u32,
    overhead: u32,
    shares: u32,
    /// 0: as much as the loss takes.
    budget: u32,
    bit_rate: u32,
    /// Milliseconds.
    spread: u32,
    loss: f64,
    burst: f64,
    keys: KeySettings,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            stream: 0,
            mtu: 64,
            overhead: 0,
            shares: 32,
            budget: 0,
            bit_rate: 5000,
            spread: 0,
            loss: 0.1,
            burst: 1.0,
            keys: KeySettings::default(),
        }
    }
}

/// Why a packet is left out.
#[derive(Debug, thiserror::Error)]
enum Refused {
    #[error(transparent)]
    Modem(#[from] ModemError),
    #[error(
        "properties mtu, tag-bytes: {mtu} bytes of a modem frame have no room for {tag} of number and tag"
    )]
    NoRoom { mtu: u32, tag: u32 },
    #[error(
        "nvspenc has planned {planned} bytes of each modem frame for number and tag, and they take {taken}: its \
         tag-bytes must be that of nvsppay, or 0 without a key-file"
    )]
    Planned { planned: u32, taken: u32 },
}

impl Settings {
    /// For packets that come without a budget.
    /// `tag`: bytes of number and tag.
    fn budget(&self, tag: u32) -> Result<Budget, Refused> {
        let no_room = Refused::NoRoom { mtu: self.mtu, tag };
        Ok(Budget {
            bit_rate: f64::from(self.bit_rate),
            mtu: self.mtu.checked_sub(tag).ok_or(no_room)?,
            overhead: self.overhead + tag,
            tag,
            shares: self.shares,
            spread: f64::from(self.spread) / 1e3,
            loss: Loss { chance: self.loss, burst: self.burst },
            bytes: self.budget,
        })
    }
}

/// What the element holds while it runs.
#[derive(Default)]
struct State {
    sharer: Sharer,
    interleaver: Option<Interleaver>,
    /// What makes tags; `None`: there are no keys.
    authenticator: Option<Authenticator>,
    /// Seconds from a packet's first share to its last one.
    spread: f64,
    /// Up to when shares were let go, seconds.
    released: f64,
    /// A packet did not fit its shares.
    cut: bool,
    /// The packet before was left out, and a warning has said why.
    refused: bool,
}

#[derive(Default)]
struct Counts {
    packets: u64,
    shares: u64,
    bytes: u64,
    refused: u64,
    cut: u64,
}

#[derive(glib::Properties)]
#[properties(wrapper_type = super::Payloader)]
pub struct Payloader {
    sink: gst::Pad,
    src: gst::Pad,

    #[property(name = "stream", get, set, type = u32, member = stream, mutable_ready, maximum = 3,
        blurb = "Number of the stream, if several cameras share a link")]
    #[property(name = "mtu", get, set, type = u32, member = mtu, mutable_playing, default_value = 64, minimum = 16,
        maximum = 65535,
        blurb = "Most bytes of a modem frame or datagram (unless nvspenc has rate=link)")]
    #[property(name = "overhead", get, set, type = u32, member = overhead, mutable_playing, maximum = 65535,
        blurb = "What each modem frame or datagram takes beside its bytes, as bytes (unless nvspenc has rate=link)")]
    #[property(name = "shares", get, set, type = u32, member = shares, mutable_playing, default_value = 32,
        minimum = 1, maximum = 64,
        blurb = "Most shares of a packet (unless nvspenc has rate=link)")]
    #[property(name = "budget", get, set, type = u32, member = budget, mutable_playing,
        blurb = "Bytes for all shares of a packet; what the packet does not take protects it; 0: as many as the loss \
            takes (unless nvspenc has rate=link)")]
    #[property(name = "bit-rate", get, set, type = u32, member = bit_rate, mutable_playing, default_value = 5000,
        minimum = 1,
        blurb = "What the link carries, bit/s; it tells how far apart shares that are spread are (unless nvspenc has \
            rate=link)")]
    #[property(name = "spread", get, set, type = u32, member = spread, mutable_playing,
        blurb = "Milliseconds from a packet's first share to its last one; those of other packets lie between them \
            (unless nvspenc has rate=link)")]
    #[property(name = "loss", get, set, type = f64, member = loss, mutable_playing, default_value = 0.1,
        minimum = 0.0, maximum = 0.99,
        blurb = "Share of the modem frames or datagrams that is lost (unless nvspenc has rate=link)")]
    #[property(name = "burst", get, set, type = f64, member = burst, mutable_playing, default_value = 1.0,
        minimum = 1.0, maximum = 1000.0,
        blurb = "Mean number of them that are lost in a row (unless nvspenc has rate=link)")]
    #[property(name = "key-file", get = Self::key_file, set = Self::set_key_file, type = Option<String>, mutable_ready,
        blurb = "File with a key, as nvsprior key makes it: modem frames get a tag")]
    #[property(name = "epoch", get = Self::epoch, set = Self::set_epoch, type = u64, mutable_ready,
        blurb = "Number of the dive, with key-file: nothing of another one passes")]
    #[property(name = "tag-bytes", get = Self::tag_bytes, set = Self::set_tag_bytes, type = u32, mutable_ready,
        default_value = 4, minimum = 2, maximum = 16,
        blurb = "Bytes of a tag, with key-file; 2 more are a number")]
    #[property(name = "first-number", get = Self::first_number, set = Self::set_first_number, type = u64, mutable_ready,
        maximum = (1 << 48) - 1,
        blurb = "Number of the first modem frame, with key-file: next-number of stats, if an epoch goes on")]
    settings: Mutex<Settings>,

    counts: Mutex<Counts>,
    state: Mutex<State>,
}

/// A share that goes out, and when it is due, seconds.
type DueShare = (f64, Vec<u8>);

impl Payloader {
    key_properties!();

    fn stats(&self) -> gst::Structure {
        let next_number = lock(&self.state).authenticator.as_ref().map(Authenticator::next_number);
        let counts = lock(&self.counts);
        gst::Structure::builder("nvsppay-stats")
            .field("packets", counts.packets)
            .field("shares", counts.shares)
            .field("bytes", counts.bytes)
            .field("refused", counts.refused)
            .field("cut", counts.cut)
            .field("next-number", next_number.unwrap_or(0))
            .build()
    }

    /// Makes shares of a packet. Returns those of the old spread that are left, if the spread is a new one.
    fn share(&self, now: f64, buffer: &gst::BufferRef) -> Result<Vec<DueShare>, Refused> {
        let settings = lock(&self.settings).clone();
        let mut state = lock(&self.state);
        let mut cut = None;
        let mapped = buffer.map_readable();
        let packet = mapped.as_deref().unwrap_or(&[]);
        let picture = Extent::read(packet).map_err(ModemError::from)?.head;
        let tag = state.authenticator.as_ref().map_or(0, |by| by.overhead() as u32);
        let (budget, sharing) = match Budget::beside(buffer) {
            Some(budget) if budget.tag != tag => {
                return Err(Refused::Planned { planned: budget.tag, taken: tag });
            }
            Some(budget) => (budget, budget.divide(picture, packet.len())?),
            None => {
                let mut budget = settings.budget(tag)?;
                let sharing = match settings.budget {
                    0 => budget.fit(picture, packet.len())?,
                    _ => budget.divide(picture, packet.len())?,
                };
                if sharing.capacity() < packet.len() {
                    cut = Some(sharing.capacity());
                }
                (budget, sharing)
            }
        };
        state.sharer.share(packet, &sharing, settings.stream as u8, None)?;
        let mut left = Vec::new();
        let State { sharer, interleaver, spread, .. } = &mut *state;
        let waiting = match interleaver {
            Some(waiting) if *spread == budget.spread => waiting,
            none => {
                let rest = |old| self.release(old, f64::INFINITY);
                left = none.as_mut().map(rest).unwrap_or_default();
                *spread = budget.spread;
                none.insert(Interleaver::new(budget.spread)?)
            }
        };
        waiting.push(now, sharer);
        let mut counts = lock(&self.counts);
        counts.packets += 1;
        counts.cut += u64::from(cut.is_some());
        drop(counts);
        let first = cut.is_some() && !std::mem::replace(&mut state.cut, cut.is_some());
        drop(state);
        if let (true, Some(held)) = (first, cut) {
            gst::element_imp_warning!(
                self,
                gst::StreamError::Encode,
                (
                    "packet of {} bytes: its shares hold {held}, the end is not sent; give more \
                     shares, a larger mtu or budget, or let nvspenc code in fewer bytes",
                    packet.len()
                )
            );
        }
        Ok(left)
    }

    fn push(&self, shares: Vec<DueShare>) -> Result<gst::FlowSuccess, gst::FlowError> {
        for (due, share) in shares {
            let share = self.authenticated(share);
            let mut buffer = gst::Buffer::from_slice(share);
            let pts = due.is_finite().then(|| gst::ClockTime::from_seconds_f64(due.max(0.0)));
            buffer.make_mut().set_pts(pts);
            self.src.push(buffer)?;
        }
        Ok(gst::FlowSuccess::Ok)
    }

    /// A modem frame with its tag, if there are keys.
    fn authenticated(&self, frame: Vec<u8>) -> Vec<u8> {
        let mut state = lock(&self.state);
        let Some(authenticator) = &mut state.authenticator else { return frame };
        let mut with_tag = Vec::with_capacity(frame.len() + authenticator.overhead());
        authenticator.write(lock(&self.settings).stream as u8, &frame, &mut with_tag);
        with_tag
    }

    /// Reads the key file anew, if there is one.
    fn open_keys(&self) -> Result<Option<Authenticator>, KeyFileError> {
        let settings = lock(&self.settings).keys.clone();
        let keys = settings.open()?;
        Ok(keys.map(|keys| Authenticator::new(&keys, Content::Frame)))
    }

    /// Pushes the shares that are due before `until`, seconds.
    fn push_until(&self, until: f64) -> Result<gst::FlowSuccess, gst::FlowError> {
        let due = {
            let mut state = lock(&self.state);
            state.released = state.released.max(until);
            let waiting = state.interleaver.as_mut();
            waiting.map(|waiting| self.release(waiting, until)).unwrap_or_default()
        };
        self.push(due)
    }

    /// Takes the shares that are due before `until`.
    fn release(&self, waiting: &mut Interleaver, until: f64) -> Vec<DueShare> {
        let mut shares = Vec::new();
        while waiting.due().is_some_and(|due| due < until) {
            let Some((due, share)) = waiting.next(until) else { break };
            let mut counts = lock(&self.counts);
            counts.shares += 1;
            counts.bytes += share.len() as u64;
            shares.push((due, share.to_vec()));
        }
        shares
    }

    fn chain(&self, buffer: gst::Buffer) -> Result<gst::FlowSuccess, gst::FlowError> {
        // A packet without a time comes when the shares before have gone.
        let released = lock(&self.state).released;
        let now = buffer.pts().map_or(released, |pts| pts.seconds_f64());
        let duration = buffer.duration().map_or(0.0, |duration| duration.seconds_f64());
        let shared = self.share(now, &buffer);
        let known = std::mem::replace(&mut lock(&self.state).refused, shared.is_err());
        match shared {
            Ok(left) => {
                self.push(left)?;
            }
            Err(error) => {
                lock(&self.counts).refused += 1;
                if !known {
                    gst::element_imp_warning!(
                        self,
                        gst::StreamError::Format,
                        ("{error}: packets are left out")
                    );
                }
            }
        }
        // Shares that are due before the next frame go now, so that they are at the sink in time. Beyond that, those of
        // the next packet may lie between them.
        self.push_until(now + duration.max(1e-9))
    }

    fn sink_event(&self, event: gst::Event) -> bool {
        match event.view() {
            gst::EventView::Caps(of) => {
                let rate = caps::frame_rate(of.caps());
                let mut caps = caps::any(caps::SHARE);
                let fields = caps.make_mut();
                fields.set("stream", lock(&self.settings).stream as i32);
                if let Some(rate) = rate {
                    fields.set("framerate", rate);
                }
                self.src.push_event(gst::event::Caps::new(&caps))
            }
            gst::EventView::Gap(gap) => {
                let (from, duration) = gap.get();
                let until = from + duration.unwrap_or(gst::ClockTime::ZERO);
                let pushed = self.push_until(until.seconds_f64());
                gst::Pad::event_default(&self.sink, Some(&*self.obj()), event) && pushed.is_ok()
            }
            gst::EventView::Eos(_) => {
                if let Err(error) = self.push_until(f64::INFINITY) {
                    gst::debug!(CATEGORY, imp = self, "the last shares: {error}");
                }
                gst::Pad::event_default(&self.sink, Some(&*self.obj()), event)
            }
            gst::EventView::FlushStop(_) => {
                let mut state = lock(&self.state);
                // Numbers go on.
                let authenticator = state.authenticator.take();
                *state = State { authenticator, ..State::default() };
                drop(state);
                gst::Pad::event_default(&self.sink, Some(&*self.obj()), event)
            }
            _ => gst::Pad::event_default(&self.sink, Some(&*self.obj()), event),
        }
    }
}

#[glib::object_subclass]
impl ObjectSubclass for Payloader {
    const NAME: &'static str = "GstNvspriorPayloader";
    type Type = super::Payloader;
    type ParentType = gst::Element;

    fn with_class(class: &Self::Class) -> Self {
        let sink = pad(class.pad_template("sink"))
            .chain_function(|_, parent, buffer| {
                Payloader::catch_panic_pad_function(
                    parent,
                    || Err(gst::FlowError::Error),
                    |this| this.chain(buffer),
                )
            })
            .event_function(|_, parent, event| {
                Payloader::catch_panic_pad_function(parent, || false, |this| this.sink_event(event))
            })
            .build();
        let src = pad(class.pad_template("src")).build();
        Payloader {
            sink,
            src,
            settings: Mutex::default(),
            counts: Mutex::default(),
            state: Mutex::default(),
        }
    }
}

impl ObjectImpl for Payloader {
    properties_with_stats!();

    fn constructed(&self) {
        self.parent_constructed();
        add_pads(&*self.obj(), [&self.sink, &self.src]);
    }
}

impl GstObjectImpl for Payloader {}

impl ElementImpl for Payloader {
    registry!(
        "nvsprior payloader",
        "Codec/Payloader/Network",
        "Spreads packets over shares for modem frames or datagrams, of which some may be lost",
        sink: caps::any(caps::PACKET),
        src: caps::any(caps::SHARE)
    );

    fn change_state(
        &self,
        transition: gst::StateChange,
    ) -> Result<gst::StateChangeSuccess, gst::StateChangeError> {
        if transition == gst::StateChange::ReadyToPaused {
            let authenticator = self.open_keys().map_err(|error| {
                gst::element_imp_error!(self, gst::ResourceError::OpenRead, ("{error}"));
                gst::StateChangeError
            })?;
            *lock(&self.state) = State { authenticator, ..State::default() };
            *lock(&self.counts) = Counts::default();
        }
        self.parent_change_state(transition)
    }
}
