//! The properties of the elements that encode frames.

use std::time::Duration;

use gst::glib;
use nvsprior::residual::Tune;
use nvsprior::tracking::{FrameInfo, RefineOptions};
use nvsprior::{EncoderOptions, Mode, RenderChecks, Structure};

use crate::property;

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
    #[enum_value(
        name = "The newest one that the topside has reported: nvspvehicle alone",
        nick = "acknowledged"
    )]
    Acknowledged,
}

/// The values of the properties, beside those that name the prior and the device.
#[derive(Clone, Debug)]
pub struct Coding {
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
    pub post_messages: bool,
}

impl Default for Coding {
    fn default() -> Coding {
        Coding {
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
            post_messages: false,
        }
    }
}

impl Coding {
    /// Options of an encoder. The rate is the element's own.
    pub fn encoder_options(&self) -> EncoderOptions {
        let key_every = self.key_every;
        let structure = match self.structure {
            StructureKind::Chain => Structure::Chain { key_every },
            StructureKind::Layers => Structure::Layers { key_every },
            StructureKind::Keys => Structure::Keys { key_every },
            StructureKind::Acknowledged => Structure::Acknowledged,
        };
        let refine = RefineOptions { lost_renders: self.lost_renders, ..RefineOptions::default() };
        let frame_time = Duration::from_secs_f64(self.frame_time / 1e3);
        EncoderOptions {
            refine,
            threshold: self.threshold,
            frame_time: (self.frame_time > 0.0).then_some(frame_time),
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

    /// The next frame starts at the pose in the property, as the first frame does.
    pub fn start_again(&mut self) {
        if let Some(Ok(pose)) = self.start.as_deref().map(property::pose) {
            self.info = Some(pose.into());
        }
    }
}
