//! The rate of a residual: by quality, by a byte budget, or by PSNR.

use crate::packet::Residual;

/// What decides how finely the difference picture is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// 0 to 100: the logarithm of the quantiser in even steps, from 76 levels to 2.
    Quality(f32),
    /// As fine as fits the packet's bytes. The budget is hard.
    Bytes(usize),
    /// As coarse as yields this PSNR, dB.
    Psnr(f64),
}

impl Rate {
    /// Whether the number can be one.
    pub(super) fn is_valid(self) -> bool {
        match self {
            Rate::Quality(quality) => (0.0..=100.0).contains(&quality),
            Rate::Psnr(target) => !target.is_nan(),
            Rate::Bytes(_) => true,
        }
    }
}

/// What a search for a rate came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RateResult {
    pub content: Content,
    /// Whether the rate was kept.
    pub reached: bool,
    /// How often the difference picture was coded.
    pub probes: u32,
}

/// Whether a difference picture was coded, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// It was coded.
    Payload,
    /// None would improve the render, or the render is good enough.
    NotNeeded,
    /// The budget holds none.
    NoRoom,
}

impl Content {
    /// A payload if it improves the render.
    pub fn payload_if(improves: bool) -> Content {
        if improves { Content::Payload } else { Content::NotNeeded }
    }

    /// What a packet says if it has no payload; `None`: it has one.
    pub fn without_payload(self) -> Option<Residual<'static>> {
        match self {
            Content::Payload => None,
            Content::NotNeeded => Some(Residual::None),
            Content::NoRoom => Some(Residual::Omitted),
        }
    }
}
