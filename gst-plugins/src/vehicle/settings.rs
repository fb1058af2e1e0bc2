//! The properties of `nvspvehicle` about the link.

use gst::glib;
use nvsprior_link::keys::Keys;
use nvsprior_link::modem::{Loss, Protection};
use nvsprior_link::{Pacing, VehicleOptions};

/// What is done against losses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorProtection")]
pub enum ProtectionKind {
    #[enum_value(name = "In layers: few modem frames yield a coarse picture", nick = "layers")]
    #[default]
    Layers,
    #[enum_value(name = "Nothing: for links that lose nothing, or repair it", nick = "none")]
    None,
}

/// Their values.
#[derive(Clone, Debug)]
pub struct LinkSettings {
    pub bit_rate: u32,
    pub mtu: u32,
    pub overhead: u32,
    /// Milliseconds.
    pub latency: u32,
    /// Milliseconds.
    pub delay: u32,
    /// Milliseconds; -1: by the loss.
    pub spread: i32,
    /// 0: the camera's.
    pub frame_rate: f64,
    pub least: u32,
    /// 0: by MTU and rate.
    pub shares: u32,
    pub loss: f64,
    pub burst: f64,
    pub stream: u32,
    pub protection: ProtectionKind,
    pub expect_reports: bool,
    pub state_poses: bool,
    pub stamps: bool,
}

/// Camera frames per second, if the caps do not say it.
const FRAME_RATE: f64 = 30.0;

impl Default for LinkSettings {
    fn default() -> LinkSettings {
        LinkSettings {
            bit_rate: 5000,
            mtu: 64,
            overhead: 0,
            latency: 1500,
            delay: 300,
            spread: -1,
            frame_rate: 0.0,
            least: 40,
            shares: 0,
            loss: 0.1,
            burst: 1.0,
            stream: 0,
            protection: ProtectionKind::default(),
            expect_reports: true,
            state_poses: false,
            stamps: true,
        }
    }
}

impl LinkSettings {
    pub fn loss(&self) -> Loss {
        Loss { chance: self.loss, burst: self.burst }
    }

    /// For a camera's frames per second, as the caps state them.
    pub fn options(
        &self,
        camera: Option<f64>,
        keys: Option<Keys>,
        state: Vec<u8>,
    ) -> VehicleOptions {
        let seconds = |milliseconds: u32| f64::from(milliseconds) / 1e3;
        let bit_rate = f64::from(self.bit_rate);
        VehicleOptions {
            pacing: Pacing::Rate(bit_rate),
            picture_rate: (self.frame_rate > 0.0).then_some(self.frame_rate),
            latency: seconds(self.latency),
            delay: seconds(self.delay),
            spread: u32::try_from(self.spread).ok().map(seconds),
            protection: match self.protection {
                ProtectionKind::Layers => Protection::Layers,
                ProtectionKind::None => Protection::None,
            },
            loss: self.loss(),
            overhead: self.overhead as usize,
            min_bytes: self.least as usize,
            max_shares: (self.shares > 0).then_some(self.shares as usize),
            stream: self.stream as u8,
            expect_reports: self.expect_reports,
            state_poses: self.state_poses,
            has_stamps: self.stamps,
            keys,
            state,
            ..VehicleOptions::new(self.mtu as usize, bit_rate, camera.unwrap_or(FRAME_RATE))
        }
    }
}
