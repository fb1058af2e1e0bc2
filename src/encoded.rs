//! An encoded frame, and what it took.

use crate::packet::KnownPose;
use crate::residual::packet_bound;
use crate::tracking::{Covariance, Observability, StartKind, Stop, deviations};
use crate::{Picture, Pose};

/// What encoding a frame took and gave.
#[derive(Clone, Debug, Default)]
pub struct FrameStats {
    /// Number of the frame.
    pub frame: u32,
    /// Bytes of the packet.
    pub bytes: usize,
    /// Bytes of its latent part.
    pub latent_bytes: usize,
    /// Bytes of its truth map; 0: it has none, or one that takes none.
    pub truth_bytes: usize,
    /// PSNR of the render at the quantised pose against the treated frame, over the pixels that count, dB.
    ///
    /// The frame is treated as the prior's [`preprocessing`](crate::Prior::preprocessing) says, if it has one. Do not
    /// compare this figure with that of a prior of another preprocessing: both the picture and its contrast differ.
    pub render_psnr: f64,
    /// PSNR of what the topside will show against the treated frame, over the pixels that count, dB.
    pub psnr: f64,
    /// The same over the pixels of the greatest weight, if parts of the picture count more:
    /// [`Encoder::set_interest`](crate::Encoder::set_interest).
    pub interest_psnr: Option<f64>,
    /// Renders at full resolution, all of them: judging the start, refining, the final picture.
    pub full_renders: u32,
    /// Renders by level, finest first.
    pub renders: Vec<u32>,
    /// Time from the frame to its pose, its render and the difference, milliseconds. Its treatment is part of it.
    pub refine_milliseconds: f64,
    /// Time of coding the difference and writing the packet, milliseconds.
    pub code_milliseconds: f64,
    /// Both times together. In a [`Pipeline`](crate::Pipeline) they overlap with those of other frames.
    pub milliseconds: f64,
    /// Submissions that the search on the device took, its final picture included; 0 if the host
    /// led the search.
    pub submissions: u32,
    /// Where the refinement started.
    pub start: StartKind,
    /// Why it stopped.
    pub stop: Stop,
    /// Which directions of the pose the picture determines.
    pub observability: Observability,
    /// How far the pose may be off: the camera stands at `Exp(τ) ∘ pose`, `τ = (ρ, θ)` along and about the camera's
    /// axes, and `τ` has this covariance, in the prior's unit and radians. An axis that is open has an infinite
    /// variance; so have all while the frame is not certain. [`Hint::with_covariance`](crate::Hint::with_covariance)
    /// takes it.
    pub covariance: Covariance,
    /// Within how much the position is known; `None`: nothing should navigate by it.
    pub known: Option<KnownPose>,
    /// Number of the frame whose residual this one's is predicted from; `None`: it is intra.
    pub reference: Option<u32>,
    /// Whether the residual's rate was kept; true if no residual was asked for.
    pub rate_kept: bool,
    /// Whether the picture confirms the pose. While it does not, the pose is looked for again at every
    /// frame.
    pub certain: bool,
    /// Whether the frame's time ended its search, which then goes on in the next frames:
    /// [`EncoderOptions::frame_time`](crate::EncoderOptions::frame_time).
    pub out_of_time: bool,
    /// Whether the frame fits the render much better with red and blue exchanged: its order may be BGR. Looked for in
    /// the first frames, told once; nothing else changes.
    pub colours_exchanged: bool,
    /// Whether the device draws what every portable device draws: see [`crate::vulkan::DeviceInfo::portable`].
    pub portable: bool,
    /// Frames since the last certain one, or since the encoder was made or reset. This frame counts; 0 if it is
    /// certain.
    pub frames_since_certain: u32,
}

impl FrameStats {
    /// Standard deviations of the pose: the root of the covariance's diagonal.
    pub fn pose_deviation(&self) -> [f64; 6] {
        deviations(&self.covariance)
    }
}

/// An encoded frame.
#[derive(Clone, Debug, Default)]
pub struct Encoded {
    /// The bytes to send.
    pub packet: Vec<u8>,
    /// What the topside will show, byte for byte on the same device.
    pub picture: Picture,
    /// The prior's render at the quantised pose.
    pub render: Picture,
    /// The pose as the packet holds it.
    pub pose: Pose,
    /// What it took.
    pub stats: FrameStats,
}

impl Encoded {
    /// Makes one that has room for every frame of a size.
    pub fn with_room(width: u32, height: u32) -> Encoded {
        Encoded {
            packet: Vec::with_capacity(packet_bound(width, height)),
            picture: Picture::new(width, height),
            render: Picture::new(width, height),
            ..Encoded::default()
        }
    }
}
