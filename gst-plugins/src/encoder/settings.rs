//! The properties of `nvspenc`.

use std::time::Duration;

use gst::glib;
use nvsprior::modem::{Loss, RateControlOptions};
use nvsprior::residual::Tune;
use nvsprior::tracking::{FrameInfo, RefineOptions};
use nvsprior::{EncoderOptions, Mode, Rate, RenderChecks, Structure};

/// What decides how fine difference pictures are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorRate")]
pub enum RateKind {
    #[enum_value(name = "Quality of the difference picture: property quality", nick = "quality")]
    #[default]
    Quality,
    #[enum_value(name = "Bytes of the whole packet: property bytes", nick = "bytes")]
    Bytes,
    #[enum_value(name = "PSNR with as few bytes as possible: property psnr", nick = "psnr")]
    Psnr,
    #[enum_value(name = "No difference pictures: poses alone", nick = "none")]
    None,
    #[enum_value(name = "What the link carries: property bit-rate", nick = "link")]
    Link,
}

/// Whether difference pictures are predicted from earlier ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorMode")]
pub enum ModeKind {
    #[enum_value(name = "Every frame is intra", nick = "intra")]
    #[default]
    Intra,
    #[enum_value(
        name = "Frames are predicted from earlier ones: property structure",
        nick = "stream"
    )]
    Stream,
}

/// What counts when bits are given to one part of the picture and taken from another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorTune")]
pub enum TuneKind {
    #[enum_value(name = "All squared errors alike", nick = "psnr")]
    #[default]
    Psnr,
    #[enum_value(name = "Errors count less where texture hides them", nick = "ssim")]
    Ssim,
    #[enum_value(
        name = "Errors count more where the prior is far from the picture",
        nick = "detection"
    )]
    Detection,
}

/// Which frame a frame of a stream is predicted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorStructure")]
pub enum StructureKind {
    #[enum_value(name = "The frame before", nick = "chain")]
    #[default]
    Chain,
    #[enum_value(name = "In layers of four frames", nick = "layers")]
    Layers,
    #[enum_value(name = "The last key frame", nick = "keys")]
    Keys,
}

/// The values of the properties, beside those that name the prior and the device.
#[derive(Clone, Debug)]
pub struct Settings {
    pub camera: Option<String>,
    pub width: u32,
    pub lens: Option<String>,
    pub mask: Option<String>,
    pub region: Option<String>,
    pub region_weight: u32,
    pub start: Option<String>,
    /// What `start` says, until a frame has taken it.
    pub info: Option<FrameInfo>,
    pub threshold: f64,
    pub mode: ModeKind,
    pub tune: TuneKind,
    pub structure: StructureKind,
    pub key_every: u32,
    pub camera_interval: u32,
    pub render_check: u32,
    pub lost_renders: u32,
    /// Milliseconds; 0: no bound.
    pub frame_time: f64,
    pub frames_treated: bool,
    pub truth: bool,
    pub rate: RateKind,
    pub quality: f32,
    pub bytes: u32,
    pub psnr: f32,
    pub bit_rate: u32,
    pub mtu: u32,
    pub overhead: u32,
    /// Of nvsppay, if it has keys; 0: it has none.
    pub tag_bytes: u32,
    /// Milliseconds.
    pub latency: u32,
    /// Milliseconds.
    pub delay: u32,
    /// Milliseconds; -1: by the loss.
    pub spread: i32,
    /// 0: the camera's.
    pub frame_rate: f64,
    pub least: u32,
    pub shares: u32,
    pub loss: f64,
    pub burst: f64,
    pub post_messages: bool,
}

/// Bytes of a modem frame's number, in front of its tag.
const NUMBER_BYTES: u32 = 2;
/// Pictures per second at most, if neither the properties nor the caps say it.
const FRAME_RATE: f64 = 30.0;

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            camera: None,
            width: 320,
            lens: None,
            mask: None,
            region: None,
            region_weight: 8,
            start: None,
            info: None,
            threshold: 1e-3,
            mode: ModeKind::default(),
            tune: TuneKind::default(),
            structure: StructureKind::default(),
            key_every: 16,
            camera_interval: 64,
            render_check: 0,
            lost_renders: 96,
            frame_time: 0.0,
            frames_treated: false,
            truth: true,
            rate: RateKind::default(),
            quality: 10.0,
            bytes: 500,
            psnr: 30.0,
            bit_rate: 5000,
            mtu: 64,
            overhead: 0,
            tag_bytes: 0,
            latency: 1500,
            delay: 100,
            spread: -1,
            frame_rate: 0.0,
            least: 40,
            shares: 16,
            loss: 0.1,
            burst: 1.0,
            post_messages: false,
        }
    }
}

impl Settings {
    pub fn encoder_options(&self) -> EncoderOptions {
        let key_every = self.key_every;
        let structure = match self.structure {
            StructureKind::Chain => Structure::Chain { key_every },
            StructureKind::Layers => Structure::Layers { key_every },
            StructureKind::Keys => Structure::Keys { key_every },
        };
        let refine = RefineOptions { lost_renders: self.lost_renders, ..RefineOptions::default() };
        let frame_time = Duration::from_secs_f64(self.frame_time / 1e3);
        EncoderOptions {
            refine,
            threshold: self.threshold,
            frame_time: (self.frame_time > 0.0).then_some(frame_time),
            rate: self.fixed_rate(),
            tune: match self.tune {
                TuneKind::Psnr => Tune::Psnr,
                TuneKind::Ssim => Tune::Ssim,
                TuneKind::Detection => Tune::Detection,
            },
            mode: match self.mode {
                ModeKind::Intra => Mode::Intra,
                ModeKind::Stream => Mode::Stream(structure),
            },
            camera_interval: self.camera_interval,
            render_checks: RenderChecks::every(self.render_check),
            frames_treated: self.frames_treated,
            truth: self.truth,
            ..EncoderOptions::default()
        }
    }

    /// The rate, unless the link decides it.
    pub fn fixed_rate(&self) -> Option<Rate> {
        match self.rate {
            RateKind::Quality => Some(Rate::Quality(self.quality)),
            RateKind::Bytes => Some(Rate::Bytes(self.bytes as usize)),
            RateKind::Psnr => Some(Rate::Psnr(f64::from(self.psnr))),
            RateKind::None | RateKind::Link => None,
        }
    }

    pub fn loss(&self) -> Loss {
        Loss { chance: self.loss, burst: self.burst }
    }

    /// Seconds from a packet's first share to its last one.
    fn spread(&self) -> f64 {
        match self.spread {
            // As `nvsprior link` has it.
            -1 if self.loss > 0.0 => f64::from(self.latency.saturating_sub(self.delay)) / 2e3,
            -1 => 0.0,
            spread => f64::from(spread) / 1e3,
        }
    }

    /// Bytes of each modem frame for number and tag.
    pub fn tag(&self) -> u32 {
        if self.tag_bytes == 0 { 0 } else { self.tag_bytes + NUMBER_BYTES }
    }

    /// How the rate control is made, for a camera's frames per second.
    pub fn rate_control(&self, camera: Option<f64>) -> RateControlOptions {
        let camera = camera.unwrap_or(FRAME_RATE);
        RateControlOptions {
            bit_rate: f64::from(self.bit_rate),
            // An MTU without room for tags has none for shares: the rate control says so.
            mtu: self.mtu.saturating_sub(self.tag()) as usize,
            overhead: (self.overhead + self.tag()) as usize,
            latency: f64::from(self.latency) / 1e3,
            delay: f64::from(self.delay) / 1e3,
            spread: self.spread(),
            frame_rate: if self.frame_rate > 0.0 { self.frame_rate } else { camera },
            min_bytes: self.least as usize,
            max_shares: self.shares as usize,
            loss: self.loss(),
            user: None,
        }
    }
}
