//! A channel and its use.

use nvsprior::residual::Tune;
use nvsprior::{EncoderOptions, Mode};
use nvsprior_link::keys::Keys;
use nvsprior_link::modem::{Loss, MIN_CHECKED_MTU, Protection};
use nvsprior_link::{Pacing, Playout, TopsideOptions, VehicleOptions};

use crate::channel::ChannelOptions;

/// A channel and its use, all defaults filled in.
#[derive(Clone, Debug)]
pub struct Setting {
    pub mode: Mode,
    pub tune: Tune,
    pub bit_rate: f64,
    pub mtu: usize,
    pub overhead: usize,
    pub propagation: f64,
    pub loss: Loss,
    pub reorder: f64,
    pub blackout: f64,
    pub assumed: Loss,
    pub spread: f64,
    pub return_delay: Option<f64>,
    /// Seconds between two reports.
    pub report_every: f64,
    /// Poses are predicted from those that the topside holds.
    pub predict_poses: bool,
    pub half_duplex: bool,
    /// Those that both sides hold.
    pub keys: Option<Keys>,
    pub latency: f64,
    pub coding: f64,
    pub fps: f64,
    pub frame_rate: f64,
    pub min_bytes: usize,
    pub shares: Option<usize>,
    /// Part of the link's modem frames that are asked of the vehicle; `None`: it goes by the bit rate.
    pub pull: Option<f64>,
    pub seed: u64,
}

/// Packets that the topside holds.
pub const PACKETS: usize = 64;
/// Seconds on either side of a frame that did not come, between which its pose is looked for: at least so many, and as
/// many as lie between two pictures of a slow link.
const REACH: f64 = 1.0;
/// A packet may take longer than its fewest bytes do, by so much.
const SLOWER: f64 = 1.5;
/// Camera frames after which a packet is stale at the latest: shares name frames modulo 256.
const STALE: f64 = 120.0;

impl Setting {
    pub fn vehicle(&self) -> VehicleOptions {
        VehicleOptions {
            pacing: match self.pull {
                Some(_) => Pacing::Pull,
                None => Pacing::Rate(self.bit_rate),
            },
            overhead: self.overhead,
            latency: self.latency,
            delay: self.coding + self.propagation,
            spread: Some(self.spread),
            picture_rate: Some(self.frame_rate),
            min_bytes: self.min_bytes,
            max_shares: self.shares,
            loss: self.assumed,
            protection: match self.mtu {
                ..MIN_CHECKED_MTU => Protection::None,
                MIN_CHECKED_MTU.. => Protection::Layers,
            },
            expect_reports: self.return_delay.is_some(),
            state_poses: !self.predict_poses,
            has_stamps: false,
            keys: self.keys.clone(),
            ..VehicleOptions::new(self.mtu, self.bit_rate, self.fps)
        }
    }

    /// [`Footage`](super::footage::Footage) has its frames treated.
    pub fn encoder(&self, threshold: f64) -> EncoderOptions {
        let (mode, tune) = (self.mode, self.tune);
        EncoderOptions { threshold, frames_treated: true, mode, tune, ..Default::default() }
    }

    /// Seconds on either side of a frame that did not come, between which its pose is looked for.
    pub fn reach(&self) -> f64 {
        REACH.max(SLOWER * 8.0 * self.min_bytes as f64 / (self.bit_rate * self.pull.unwrap_or(1.0)))
    }

    /// The same in camera frames.
    pub fn reach_frames(&self) -> u32 {
        ((self.reach() * self.fps) as u32).clamp(1, PACKETS as u32 / 2 - 1)
    }

    pub fn topside(&self) -> TopsideOptions {
        TopsideOptions {
            playout: Playout::OnDemand,
            max_shares: self.shares,
            packets: PACKETS,
            age: Some((self.latency + 2.0 * self.reach()).min(STALE / self.fps)),
            // The simulation asks when it wants one.
            report_every: Some(0.0),
            keys: self.keys.clone(),
            ..TopsideOptions::new(self.mtu)
        }
    }

    /// The channel, for a run of so many seconds.
    pub fn channel(&self, seconds: f64) -> ChannelOptions {
        let middle = seconds / 2.0;
        ChannelOptions {
            bit_rate: self.bit_rate,
            overhead: self.overhead,
            propagation: self.propagation,
            loss: self.loss,
            reorder: self.reorder,
            blackout: [middle, middle + self.blackout],
            seed: self.seed,
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// 4 kbit/s over 0.25 s, without losses.
    pub fn setting() -> Setting {
        Setting {
            mode: Mode::Intra,
            tune: Tune::Psnr,
            bit_rate: 4_000.0,
            mtu: 64,
            overhead: 0,
            propagation: 0.25,
            loss: Loss::NONE,
            reorder: 0.0,
            blackout: 0.0,
            assumed: Loss::NONE,
            spread: 0.0,
            return_delay: None,
            report_every: 1.0,
            predict_poses: true,
            half_duplex: false,
            keys: None,
            latency: 1.5,
            coding: 0.1,
            fps: 10.0,
            frame_rate: 5.0,
            min_bytes: 40,
            shares: Some(16),
            pull: None,
            seed: 1,
        }
    }
}
