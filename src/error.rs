//! The library's error.

use crate::geometry::{CameraError, LensError};
use crate::image::PixelError;
use crate::packet::PacketError;
use crate::prior::PriorError;
use crate::queue::QueueError;
use crate::residual::ResidualError;

/// Anything that can fail, by the layer that failed.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum Error {
    #[error(transparent)]
    Vulkan(#[from] crate::vulkan::Error),
    #[error(transparent)]
    Prior(#[from] PriorError),
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Packet(#[from] PacketError),
    #[error(transparent)]
    Residual(#[from] ResidualError),
    #[error(transparent)]
    Pixels(#[from] PixelError),
    #[error("picture of {width}×{height} pixels: at most {limit} pixels are allowed")]
    FrameTooLarge { width: u32, height: u32, limit: u32 },
    #[error("frame of {}×{} pixels for a camera of {}×{}", found.0, found.1, expected.0, expected.1)]
    FrameSize { expected: (u32, u32), found: (u32, u32) },
    #[error("mask of {}×{} pixels for a camera of {}×{}", found.0, found.1, expected.0, expected.1)]
    MaskSize { expected: (u32, u32), found: (u32, u32) },
    #[error("a mask by which no pixel counts; white (128 and more) counts, black does not")]
    MaskEmpty,
    #[error("a budget of {budget} bytes: pose and camera alone take {needed}")]
    Budget { budget: usize, needed: usize },
    #[error(
        "frame {frame}: no pose to start from: none from outside, none from a frame before, and the \
         prior has no key frames: give a pose, or make key frames with `nvsprior key-frames`"
    )]
    NoStart { frame: u32 },
    #[error("frame {frame}: the pose from outside is no rigid motion")]
    HintPose { frame: u32 },
    #[error(
        "frame {frame}: the pose from outside is {distance:e} from the prior, more than a million of its spreads"
    )]
    HintFar { frame: u32, distance: f64 },
    #[error(
        "frame {frame}: the covariance of the pose from outside is not symmetric, positive semidefinite, and finite \
         but for open axes"
    )]
    HintCovariance { frame: u32 },
    #[error("frame {frame}: the pose from outside is {age} s old: must be finite and not negative")]
    HintAge { frame: u32, age: f64 },
    #[error("frame {frame}: its time is {time} s: must be finite")]
    FrameTime { frame: u32, time: f64 },
    #[error("frame {frame}: its time, {time} s, lies before that of an earlier frame, {before} s")]
    FrameTimeBack { frame: u32, time: f64, before: f64 },
    #[error(
        "a most time of {most:.1} ms per frame: one render and one coding take {least:.1} ms on this device: allow \
         at least that"
    )]
    FrameTimeShort { most: f64, least: f64 },
    #[error("prior {found} in place of {expected}")]
    PriorChanged { expected: crate::PriorId, found: crate::PriorId },
    #[error("no thread for coding differences: {0}")]
    Thread(String),
    #[error(transparent)]
    Queue(#[from] QueueError),
    #[error(
        "frame {frame}: its tag {tag:#06x} is not that of prior {prior} with any of the {cameras} cameras known: the \
         packet that states them is missing, or another prior is held"
    )]
    SessionUnknown { frame: u32, tag: u16, prior: crate::PriorId, cameras: usize },
    #[error(
        "frame {frame}: a packet before was about another prior, or its render was another: wait for one that states \
         this prior"
    )]
    Estranged { frame: u32 },
}
