//! The library's error.

use crate::geometry::{CameraError, LensError};
use crate::image::PixelError;
use crate::packet::PacketError;
use crate::prior::PriorError;
use crate::queue::QueueError;
use crate::residual::ResidualError;

/// Anything that can fail, by the layer that failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The device.
    #[error(transparent)]
    Vulkan(#[from] crate::vulkan::Error),
    /// A prior's file or its splats.
    #[error(transparent)]
    Prior(#[from] PriorError),
    /// A camera that cannot be rendered with.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A lens that frames cannot be freed of.
    #[error(transparent)]
    Lens(#[from] LensError),
    /// A packet.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// A difference picture.
    #[error(transparent)]
    Residual(#[from] ResidualError),
    /// An image of a camera, or for a screen.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// A picture has more pixels than the decoder's limit allows.
    #[error("picture of {width}×{height} pixels: at most {limit} pixels are allowed")]
    FrameTooLarge {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Most pixels.
        limit: u32,
    },
    /// A frame's size is not the camera's.
    #[error("frame of {}×{} pixels for a camera of {}×{}", found.0, found.1, expected.0, expected.1)]
    FrameSize {
        /// The camera's width and height.
        expected: (u32, u32),
        /// The frame's.
        found: (u32, u32),
    },
    /// A mask's size is not the camera's.
    #[error("mask of {}×{} pixels for a camera of {}×{}", found.0, found.1, expected.0, expected.1)]
    MaskSize {
        /// The camera's width and height.
        expected: (u32, u32),
        /// The mask's.
        found: (u32, u32),
    },
    /// A mask leaves nothing of the frames.
    #[error("a mask by which no pixel counts; white (128 and more) counts, black does not")]
    MaskEmpty,
    /// A stream was asked for with a coder that knows none.
    #[error("streams take the wavelet coder: choose it, or code every frame by itself")]
    StreamCoder,
    /// A byte budget cannot hold a packet without any residual.
    #[error("a budget of {budget} bytes: pose and camera alone take {needed}")]
    Budget {
        /// The budget.
        budget: usize,
        /// Bytes of the packet without residual.
        needed: usize,
    },
    /// The first frame came without a pose, and the prior has no key frames to find it by.
    #[error(
        "frame {frame}: no pose to start from: none from outside, none from a frame before, and the \
         prior has no key frames: give a pose, or make key frames with `nvsprior key-frames`"
    )]
    NoStart {
        /// Number of the frame.
        frame: u32,
    },
    /// The pose from outside is not finite, or its rotation is no unit quaternion.
    #[error("frame {frame}: the pose from outside is no rigid motion")]
    HintPose {
        /// Number of the frame.
        frame: u32,
    },
    /// The pose from outside lies absurdly far from the prior.
    #[error(
        "frame {frame}: the pose from outside is {distance:e} from the prior, more than a million of its spreads"
    )]
    HintFar {
        /// Number of the frame.
        frame: u32,
        /// Distance of the camera from the prior's centre, the prior's unit.
        distance: f64,
    },
    /// The covariance of the pose from outside is not one.
    #[error(
        "frame {frame}: the covariance of the pose from outside is not finite, symmetric and \
         positive semidefinite"
    )]
    HintCovariance {
        /// Number of the frame.
        frame: u32,
    },
    /// The age of the pose from outside is negative or not finite.
    #[error("frame {frame}: the pose from outside is {age} s old: must be finite and not negative")]
    HintAge {
        /// Number of the frame.
        frame: u32,
        /// The age, seconds.
        age: f64,
    },
    /// The frame's time is not finite.
    #[error("frame {frame}: its time is {time} s: must be finite")]
    FrameTime {
        /// Number of the frame.
        frame: u32,
        /// The time, seconds.
        time: f64,
    },
    /// The frame's time lies before that of an earlier frame.
    #[error("frame {frame}: its time, {time} s, lies before that of an earlier frame, {before} s")]
    FrameTimeBack {
        /// Number of the frame.
        frame: u32,
        /// Its time, seconds.
        time: f64,
        /// The earlier frame's, seconds.
        before: f64,
    },
    /// An encoder or decoder was told to go on with a prior that is not its own.
    #[error("prior {found} in place of {expected}")]
    PriorChanged {
        /// Identity of its own prior.
        expected: crate::PriorId,
        /// Identity of the other prior.
        found: crate::PriorId,
    },
    /// The system gives no thread for coding differences.
    #[error("no thread for coding differences: {0}")]
    Thread(String),
    /// A pipeline refuses a frame.
    #[error(transparent)]
    Queue(#[from] QueueError),
    /// A packet's camera was sent in an earlier packet that did not arrive.
    #[error("frame {frame}: its camera (tag {tag:#04x}) was sent in a packet that is missing")]
    CameraUnknown {
        /// Number of the frame.
        frame: u32,
        /// Tag of the camera.
        tag: u8,
    },
    /// A short packet's session is not this prior with one of the known cameras.
    #[error(
        "frame {frame}: a short packet of session {tag:#04x}, which is not prior {prior} with any of \
         the {cameras} cameras known: the packet that told it is missing, or another prior is held"
    )]
    SessionUnknown {
        /// Number of the frame.
        frame: u32,
        /// Tag of the session.
        tag: u8,
        /// The prior at hand.
        prior: crate::PriorId,
        /// How many cameras are known.
        cameras: usize,
    },
}
