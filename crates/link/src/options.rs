//! How the ends of a link are set up.

use crate::keys::Keys;
use crate::modem::{
    CollectorOptions, Loss, MAX_SHARES, MIN_CHECKED_MTU, ModemError, Protection,
    RateControlOptions, SenderOptions,
};

use super::error::LinkError;
use super::exposure::EXPOSURE_LEN;

/// How modem frames go out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pacing {
    /// At this bit rate, bit/s: the vehicle has the link, or a stated part of it.
    Rate(f64),
    /// When the modem asks for them: it shares the link with other traffic.
    Pull,
    /// As packets come, without protection.
    AsTheyCome,
}

/// How a vehicle's end sends.
#[derive(Clone, Debug)]
pub struct VehicleOptions {
    /// Most bytes of a modem frame, 8 to 65,535; with protection from 16. The topside must be told the same.
    pub mtu: usize,
    /// How modem frames go out.
    pub pacing: Pacing,
    /// Camera frames per second: numbers count them, also those that never come here. `None`: each that comes counts;
    /// only with [`Pacing::AsTheyCome`].
    pub frame_rate: Option<f64>,
    /// Most pictures per second. `None`: as many as frames.
    pub picture_rate: Option<f64>,
    /// Longest time from the exposure of a frame to the end of its packet's last modem frame, seconds.
    pub latency: f64,
    /// What of it is no transmission: search, coding, propagation; seconds.
    pub delay: f64,
    /// Seconds from a packet's first modem frame to its last one; those of other packets lie between them. `None`: a
    /// quarter of what the delay leaves, and 0 without loss or protection. What is pulled goes when the modem asks.
    pub spread: Option<f64>,
    /// What is done against losses.
    pub protection: Protection,
    /// What the link loses, at first: reports tell the loss.
    pub loss: Loss,
    /// What a modem frame takes beside its bytes, as bytes.
    pub overhead: usize,
    /// Fewest bytes for a picture, all counted: below it frames are left out.
    pub min_bytes: usize,
    /// Most modem frames of a packet. `None`: as many as MTU and rate take, 16 to 64; without protection as many as
    /// 65,536 bytes take.
    pub max_shares: Option<usize>,
    /// The stream, 0 to 3: up to four cameras share a link, each with an end of its own.
    pub stream: u8,
    /// The topside sends reports.
    pub expect_reports: bool,
    /// State all poses in full, even if the topside holds others that they could be predicted from.
    pub state_poses: bool,
    /// Packets tell when their frame was exposed, in two bytes. Without it, and without protection, no user bytes
    /// travel.
    pub has_stamps: bool,
    /// User bytes that travel with each packet, up to 253.
    pub user_bytes: usize,
    /// The times of calls are UTC in seconds. Without it the exposure is told once a report has come.
    pub is_utc: bool,
    /// Keys of both sides.
    pub keys: Option<Keys>,
    /// What this end had its owner store before it started again; empty: it begins anew.
    pub state: Vec<u8>,
}

/// Shares of a packet by default.
const SHARES: usize = 16;
/// Most of them: the time of a division grows with their cube.
const MOST_SHARES: usize = 64;
/// Bytes of an unprotected packet that there are shares for by default.
const UNPROTECTED: usize = 65_536;
/// Part of what the latency leaves that packets are spread over.
const SPREAD: f64 = 0.25;
/// Bit rate that a pulled link is taken for until something was pulled: an MTU per second.
const PULLED: f64 = 8.0;

impl VehicleOptions {
    /// A link of a bit rate, bit/s, for so many frames per second.
    pub fn new(mtu: usize, bit_rate: f64, frame_rate: f64) -> VehicleOptions {
        VehicleOptions {
            mtu,
            pacing: Pacing::Rate(bit_rate),
            frame_rate: Some(frame_rate),
            picture_rate: None,
            latency: 1.5,
            delay: 0.3,
            spread: None,
            protection: Protection::Layers,
            loss: Loss { chance: 0.1, burst: 1.0 },
            overhead: 0,
            min_bytes: 40,
            max_shares: None,
            stream: 0,
            expect_reports: true,
            state_poses: false,
            has_stamps: true,
            user_bytes: 0,
            is_utc: false,
            keys: None,
            state: Vec::new(),
        }
    }

    /// User bytes of packets, with the stamp.
    fn all_user_bytes(&self) -> Result<Option<usize>, LinkError> {
        let most = usize::from(u8::MAX) - EXPOSURE_LEN;
        let stamps = self.has_stamps && self.protection == Protection::Layers;
        match (stamps, self.user_bytes) {
            (true, bytes) if bytes <= most => Ok(Some(EXPOSURE_LEN + bytes)),
            (false, 0) => Ok(None),
            (true, bytes) => Err(LinkError::option("user_bytes", bytes, "0 to 253")),
            (false, bytes) => {
                Err(LinkError::option("user_bytes", bytes, "0 without protection and stamps"))
            }
        }
    }

    /// Pictures per second.
    fn picture_rate(&self) -> Result<f64, LinkError> {
        let allowed = "positive and finite, frames per second";
        let is_rate = |rate: &f64| *rate > 0.0 && rate.is_finite();
        match (self.frame_rate, self.pacing) {
            (Some(rate), _) if is_rate(&rate) => {}
            (None, Pacing::AsTheyCome) => return Ok(1.0),
            (rate, _) => {
                let found = rate.map_or("not given".into(), |rate| rate.to_string());
                return Err(LinkError::option("frame_rate", found, allowed));
            }
        }
        match self.picture_rate.or(self.frame_rate) {
            Some(rate) if is_rate(&rate) => Ok(rate),
            rate => Err(LinkError::option("picture_rate", rate.unwrap_or(0.0), allowed)),
        }
    }

    /// The link as the sender knows it.
    pub(super) fn sender(&self) -> Result<SenderOptions, LinkError> {
        let frame_rate = self.picture_rate()?;
        let is_layers = self.protection == Protection::Layers;
        if is_layers && self.pacing == Pacing::AsTheyCome {
            let allowed = "with protection a rate, or pull";
            return Err(LinkError::option("pacing", "as packets come", allowed));
        }
        let bit_rate = match self.pacing {
            Pacing::Rate(rate) if rate > 0.0 && rate.is_finite() => rate,
            Pacing::Rate(rate) => {
                return Err(LinkError::option("bit_rate", rate, "positive and finite, bit/s"));
            }
            Pacing::Pull => PULLED * self.mtu as f64,
            Pacing::AsTheyCome => 0.0,
        };
        let left = self.latency - self.delay;
        let positive = |time: f64| time >= 0.0 && time.is_finite();
        if !(positive(self.delay) && positive(self.latency) && left > 0.0) {
            let found = format!("{} and {} s", self.latency, self.delay);
            return Err(LinkError::option(
                "latency, delay",
                found,
                "0 or more, and the latency more",
            ));
        }
        let spread = match self.spread {
            Some(spread) if positive(spread) && spread < left => spread,
            Some(spread) => {
                return Err(LinkError::option(
                    "spread",
                    spread,
                    "0 s to less than the delay leaves",
                ));
            }
            // Without protection any loss spoils what follows it, wherever it lies.
            None if self.loss.chance == 0.0 || !is_layers => 0.0,
            None => SPREAD * left,
        };
        if self.max_shares == Some(0) {
            return Err(LinkError::option("max_shares", 0, "1 or more"));
        }
        let control = RateControlOptions {
            bit_rate,
            mtu: self.mtu,
            overhead: self.overhead,
            latency: self.latency,
            delay: self.delay,
            spread: if self.pacing == Pacing::Pull { 0.0 } else { spread },
            frame_rate,
            min_bytes: self.min_bytes,
            max_shares: self.max_shares.unwrap_or_else(|| self.usual_shares(bit_rate, frame_rate)),
            loss: self.loss,
            user: self.all_user_bytes()?,
        };
        let (stream, protection) = (self.stream, self.protection);
        let expect_reports = self.expect_reports;
        Ok(SenderOptions { control, stream, protection, expect_reports })
    }

    /// Twice as many as a frame's turn takes: a packet that states prior and camera is longer.
    fn usual_shares(&self, bit_rate: f64, frame_rate: f64) -> usize {
        let frame = self.mtu.saturating_add(self.overhead).max(1);
        match self.protection {
            Protection::None => UNPROTECTED.div_ceil(frame),
            Protection::Layers => {
                let turn = (bit_rate / 8.0 / frame_rate).max(self.min_bytes as f64);
                ((2.0 * turn / frame as f64).ceil() as usize).clamp(SHARES, MOST_SHARES)
            }
        }
    }
}

/// When pictures are handed out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Playout {
    /// The newest one, as it comes and as it gets better.
    Newest,
    /// Those that the caller asks for: [`Topside::show`](super::Topside::show).
    OnDemand,
    /// Each frame once, in order, as soon as its packet is whole, and so many seconds after its exposure at the latest.
    /// Between frames that came the prior is drawn at poses between.
    InOrder {
        /// Seconds from a frame's time to when it goes on at the latest.
        latency: f64,
        /// The camera's frames per second; `None`: not known, frames have the time at which they began to come.
        frame_rate: Option<f64>,
    },
}

/// Seconds after which a packet is stale.
const AGE: f64 = 4.0;
/// Seconds for which packets are kept beyond the latency, so that the loss is known.
const KEPT: f64 = 2.0;
/// Camera frames after which a packet is stale at the latest: no more packets are held.
const STALE: f64 = 60.0;

/// How a topside's end receives.
#[derive(Clone, Debug)]
pub struct TopsideOptions {
    /// Most bytes of a modem frame: the vehicle's.
    pub mtu: usize,
    /// The stream that is taken, 0 to 3.
    pub stream: u8,
    /// When pictures are handed out.
    pub playout: Playout,
    /// Modem frames of a packet that there is room for. `None`: 64; without protection as many as 65,536 bytes take.
    pub max_shares: Option<usize>,
    /// Packets that are held, 1 to 64.
    pub packets: usize,
    /// Seconds after which a packet is stale: less than 128 of the camera's frames take. `None`: 4; in order 2
    /// more than the latency, and no more than 60 frames take.
    pub age: Option<f64>,
    /// The modem hands over no damaged frames.
    pub modem_checks: bool,
    /// Seconds between two reports; `None`: there is no return channel.
    pub report_every: Option<f64>,
    /// The times of calls are UTC in seconds: a vehicle that tells the exposure by its own UTC is believed.
    pub is_utc: bool,
    /// Keys of both sides.
    pub keys: Option<Keys>,
    /// What this end had its owner store before it started again; empty: it begins anew.
    pub state: Vec<u8>,
}

impl TopsideOptions {
    /// The newest pictures of stream 0, and a report each second.
    pub fn new(mtu: usize) -> TopsideOptions {
        TopsideOptions {
            mtu,
            stream: 0,
            playout: Playout::Newest,
            max_shares: None,
            packets: 64,
            age: None,
            modem_checks: false,
            report_every: Some(1.0),
            is_utc: false,
            keys: None,
            state: Vec::new(),
        }
    }

    fn usual_age(&self) -> f64 {
        match self.playout {
            Playout::Newest | Playout::OnDemand => AGE,
            Playout::InOrder { latency, frame_rate } => {
                (latency + KEPT).min(frame_rate.map_or(f64::INFINITY, |rate| STALE / rate))
            }
        }
    }

    pub(super) fn collector(&self) -> Result<CollectorOptions, LinkError> {
        if let Some(every) = self.report_every
            && !(every >= 0.0 && every.is_finite())
        {
            return Err(LinkError::option("report_every", every, "0 s or more"));
        }
        if let Playout::InOrder { latency, frame_rate } = self.playout {
            if !(latency >= 0.0 && latency.is_finite()) {
                return Err(LinkError::option("playout.latency", latency, "0 s or more"));
            }
            if let Some(rate) = frame_rate
                && !(rate > 0.0 && rate.is_finite())
            {
                return Err(LinkError::option("playout.frame_rate", rate, "positive and finite"));
            }
        }
        if let Some(age) = self.age
            && !(age > 0.0 && age.is_finite())
        {
            return Err(LinkError::option("age", age, "positive and finite"));
        }
        if self.stream >= crate::modem::STREAMS {
            return Err(ModemError::Stream(self.stream).into());
        }
        let usual = match self.mtu {
            mtu if mtu < MIN_CHECKED_MTU => MAX_SHARES,
            mtu => UNPROTECTED.div_ceil(mtu).clamp(SHARES, MAX_SHARES),
        };
        Ok(CollectorOptions {
            mtu: self.mtu,
            shares: self.max_shares.unwrap_or(usual),
            packets: self.packets,
            streams: usize::from(self.stream) + 1,
            age: self.age.unwrap_or_else(|| self.usual_age()),
            modem_checks: self.modem_checks,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_follow_mtu_and_rate() {
        let shares = |mtu, bit_rate, frame_rate| {
            let options = VehicleOptions::new(mtu, bit_rate, frame_rate);
            options.sender().unwrap().control.max_shares
        };
        // 400 bytes a frame take 25 frames of 16 bytes, 833 take 26 of 32.
        assert_eq!((shares(16, 6400.0, 2.0), shares(32, 20_000.0, 3.0)), (50, 53));
        assert_eq!(
            (shares(64, 20_000.0, 15.0), shares(1024, 1e6, 5.0), shares(16, 1e6, 1.0)),
            (16, 49, 64)
        );
    }

    #[test]
    fn wrong_options_are_named() {
        let named = |change: &dyn Fn(&mut VehicleOptions)| {
            let mut options = VehicleOptions::new(64, 5000.0, 15.0);
            change(&mut options);
            options.sender().unwrap_err().to_string()
        };
        for (name, text) in [
            ("bit_rate", named(&|options| options.pacing = Pacing::Rate(0.0))),
            ("frame_rate", named(&|options| options.frame_rate = None)),
            ("latency, delay", named(&|options| options.delay = 2.0)),
            ("latency, delay", named(&|options| options.latency = f64::NAN)),
            ("spread", named(&|options| options.spread = Some(9.0))),
            ("user_bytes", named(&|options| options.user_bytes = 254)),
            ("max_shares", named(&|options| options.max_shares = Some(0))),
            ("pacing", named(&|options| options.pacing = Pacing::AsTheyCome)),
            (
                "user_bytes",
                named(&|options| {
                    (options.has_stamps, options.user_bytes) = (false, 3);
                }),
            ),
        ] {
            assert!(text.starts_with(name), "{name}: {text}");
        }
    }
}
