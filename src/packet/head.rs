//! The first two bytes of a packet: which fields follow, and how they are stated.

use super::known::Confidence;
use super::pose::PoseProfile;

/// Bytes of the head.
pub const LEN: usize = 2;

/// The low bits of the first byte tell the pose's kind, and so how long the latent part is. Any two of these words
/// differ in three bits or more: one or two flipped bits make no other length.
const POSE_BITS: u8 = 0b1_1111;
const SHORT: u8 = 0b0_0000;
const COMPACT: u8 = 0b0_0111;
const PREDICTED: u8 = 0b1_1001;
/// Not used by this version.
const LATER: u8 = 0b1_1110;
const KIND_SHIFT: u8 = 5;

const SMALL_BLOCKS: u8 = 1;
const TRUTH: u8 = 1 << 1;
const SESSION: u8 = 1 << 2;
const RENDER: u8 = 1 << 3;
const NOT_PORTABLE: u8 = 1 << 4;
/// The upper three bits of the second byte.
const CONFIDENCE_SHIFT: u8 = 5;

/// How the pose is stated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PoseKind {
    /// In the steps of this profile.
    Absolute(PoseProfile),
    /// As what it differs by from one that both sides compute.
    Predicted,
}

impl PoseKind {
    fn word(self) -> u8 {
        match self {
            PoseKind::Absolute(PoseProfile::Short) => SHORT,
            PoseKind::Absolute(PoseProfile::Compact) => COMPACT,
            PoseKind::Predicted => PREDICTED,
            // Latent::write refuses it.
            PoseKind::Absolute(PoseProfile::Free) => LATER,
        }
    }

    fn of(word: u8) -> Option<PoseKind> {
        match word {
            SHORT => Some(PoseKind::Absolute(PoseProfile::Short)),
            COMPACT => Some(PoseKind::Absolute(PoseProfile::Compact)),
            PREDICTED => Some(PoseKind::Predicted),
            _ => None,
        }
    }
}

/// What the residual part holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    /// Nothing: no residual was asked for, or none was needed.
    None = 0,
    /// Nothing: one was asked for, but the budget holds none.
    Omitted = 1,
    /// Nothing, and all of the picture is as seen.
    AllSeen = 2,
    /// A payload of no stream.
    Coded = 3,
    /// One of a stream, predicted from no other frame.
    Stream = 4,
    /// One of a stream, predicted from a reference.
    Inter = 5,
    /// Not used by this version.
    Later6 = 6,
    /// Not used by this version.
    Later7 = 7,
}

impl Kind {
    fn of(number: u8) -> Kind {
        match number {
            0 => Kind::None,
            1 => Kind::Omitted,
            2 => Kind::AllSeen,
            3 => Kind::Coded,
            4 => Kind::Stream,
            5 => Kind::Inter,
            6 => Kind::Later6,
            _ => Kind::Later7,
        }
    }

    /// Whether a payload of the wavelet coder follows.
    pub fn is_wavelet(self) -> bool {
        matches!(self, Kind::Coded | Kind::Stream | Kind::Inter)
    }
}

/// What the first two bytes say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Head {
    pub pose: PoseKind,
    pub kind: Kind,
    pub small_blocks: bool,
    /// A truth map lies in front of the payload.
    pub truth: bool,
    /// The session part follows.
    pub session: bool,
    /// The render part follows.
    pub render: bool,
    pub confidence: Confidence,
    pub portable: bool,
}

impl Head {
    pub fn new(pose: PoseKind, kind: Kind) -> Head {
        Head {
            pose,
            kind,
            small_blocks: false,
            truth: false,
            session: false,
            render: false,
            confidence: Confidence::of(false, None),
            portable: true,
        }
    }

    pub fn bytes(&self) -> [u8; LEN] {
        let bit = |set: bool, bit: u8| if set { bit } else { 0 };
        let second = bit(self.small_blocks, SMALL_BLOCKS)
            | bit(self.truth, TRUTH)
            | bit(self.session, SESSION)
            | bit(self.render, RENDER)
            | bit(!self.portable, NOT_PORTABLE)
            | self.confidence.code() << CONFIDENCE_SHIFT;
        [self.pose.word() | (self.kind as u8) << KIND_SHIFT, second]
    }

    /// Reads it. `None`: no packet of this version begins so.
    pub fn read([first, second]: [u8; LEN]) -> Option<Head> {
        Some(Head {
            pose: PoseKind::of(first & POSE_BITS)?,
            kind: Kind::of(first >> KIND_SHIFT),
            small_blocks: second & SMALL_BLOCKS != 0,
            truth: second & TRUTH != 0,
            session: second & SESSION != 0,
            render: second & RENDER != 0,
            confidence: Confidence::of_code(second >> CONFIDENCE_SHIFT),
            portable: second & NOT_PORTABLE == 0,
        })
    }

    /// Whether the frame is one of a stream: others may be predicted from it.
    pub fn is_in_stream(&self) -> bool {
        matches!(self.kind, Kind::Stream | Kind::Inter)
    }

    /// Whether a residual part follows.
    pub fn has_content(&self) -> bool {
        self.truth || self.kind.is_wavelet()
    }

    /// Whether the fields of the residual part fit each other; those of later versions do not.
    pub fn is_known(&self) -> bool {
        match self.kind {
            Kind::None | Kind::Omitted => !self.small_blocks,
            Kind::AllSeen => !self.small_blocks && !self.truth,
            Kind::Coded | Kind::Stream | Kind::Inter => true,
            Kind::Later6 | Kind::Later7 => false,
        }
    }
}

/// Whether a packet that begins with this byte may be one of a later version.
pub(super) fn is_later(first: u8) -> bool {
    first & POSE_BITS == LATER
}

/// Whether a packet that begins with this byte states a predicted pose.
pub fn is_predicted(first: u8) -> bool {
    first & POSE_BITS == PREDICTED
}
