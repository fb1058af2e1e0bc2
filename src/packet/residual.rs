//! The residual part: a check, a reference, a truth map and a payload, as far as the head announces them.

use std::ops::Range;

use super::bytes::crc16;
use super::error::{PacketError, Part};
use super::head::{Head, Kind};
use super::truth;

/// Bytes of the check, with which the part begins.
pub(super) const CHECK: usize = 2;

/// The reference frame of a residual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reference {
    /// How many frames before this one, 1 to 255.
    pub distance: u8,
    /// Check of what that frame's residual was decoded to, of its camera and its pose. It tells a frame of the same
    /// number from another stream.
    pub tag: u16,
}

impl Reference {
    /// Bytes that it takes.
    pub const LEN: usize = 3;

    fn bytes(self) -> [u8; Self::LEN] {
        let [low, high] = self.tag.to_le_bytes();
        [self.distance, low, high]
    }

    fn read(bytes: &[u8]) -> Option<Reference> {
        let &[distance, low, high] = bytes.get(..Self::LEN)? else { return None };
        (distance > 0).then_some(Reference { distance, tag: u16::from_le_bytes([low, high]) })
    }
}

/// The difference picture of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual<'a> {
    /// None was asked for, or the render alone was good enough.
    None,
    /// One was asked for, but the byte budget could not hold any.
    Omitted,
    /// A difference picture of no stream, coded by the wavelet coder.
    Coded {
        /// The payload has [small blocks](crate::residual::wavelet).
        small_blocks: bool,
        /// Its bytes, without zeros at the end.
        payload: &'a [u8],
    },
    /// A difference picture of a stream, coded by the wavelet coder. Later frames may be predicted from it.
    Stream {
        /// Its reference frame; `None`: it is intra.
        reference: Option<Reference>,
        /// As above.
        small_blocks: bool,
        /// As above.
        payload: &'a [u8],
    },
}

impl<'a> Residual<'a> {
    /// The payload; empty if there is none.
    pub fn payload(&self) -> &'a [u8] {
        match *self {
            Residual::None | Residual::Omitted => &[],
            Residual::Coded { payload, .. } | Residual::Stream { payload, .. } => payload,
        }
    }

    fn reference(&self) -> Option<Reference> {
        match *self {
            Residual::Stream { reference, .. } => reference,
            _ => None,
        }
    }

    fn kind(&self) -> Kind {
        match *self {
            Residual::None => Kind::None,
            Residual::Omitted => Kind::Omitted,
            Residual::Coded { .. } => Kind::Coded,
            Residual::Stream { reference: None, .. } => Kind::Stream,
            Residual::Stream { reference: Some(_), .. } => Kind::Inter,
        }
    }

    fn has_small_blocks(&self) -> bool {
        match *self {
            Residual::Coded { small_blocks, .. } | Residual::Stream { small_blocks, .. } => {
                small_blocks
            }
            _ => false,
        }
    }
}

/// The start of a coded difference picture whose end may be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResidualStart<'a> {
    /// The payload has small blocks.
    pub small_blocks: bool,
    /// Its reference frame, if it has one.
    pub reference: Option<Reference>,
    /// Its first bytes. No check covers them.
    pub payload: &'a [u8],
}

/// Length of the residual part of a payload of no stream without a truth map, bytes.
pub fn residual_part_len(payload: usize) -> usize {
    CHECK + payload
}

/// What a packet holds behind its fixed parts.
#[derive(Clone, Copy)]
pub(super) struct Content<'a> {
    pub residual: &'a Residual<'a>,
    pub truth: Option<&'a [u8]>,
}

impl Content<'_> {
    /// Says in a head what follows.
    pub fn announce(&self, head: &mut Head) {
        let all_seen = self.is_all_seen();
        head.kind = if all_seen { Kind::AllSeen } else { self.residual.kind() };
        head.small_blocks = self.residual.has_small_blocks();
        head.truth = self.truth.is_some() && !all_seen;
    }

    /// The head alone tells it.
    fn is_all_seen(&self) -> bool {
        *self.residual == Residual::None && self.truth == Some(truth::ALL_SEEN)
    }

    /// Bytes in front of the payload, and those of the payload; `None`: there is no part.
    fn lens(&self) -> Option<(usize, usize)> {
        let mut head = Head::new(super::head::PoseKind::Predicted, Kind::None);
        self.announce(&mut head);
        let reference = self.residual.reference().map_or(0, |_| Reference::LEN);
        let map = self.truth.map_or(0, <[u8]>::len);
        head.has_content().then(|| (CHECK + reference + map, self.payload().len()))
    }

    /// The payload without zeros at its end, as a reader takes those for padding.
    fn payload(&self) -> &[u8] {
        without_zeros(self.residual.payload())
    }

    /// Length of the part, bytes.
    pub fn len(&self) -> usize {
        self.lens().map_or(0, |(front, payload)| front + payload)
    }

    /// Length of the longest truth map with which the part has at most `budget` bytes.
    pub fn truth_room(&self, budget: usize) -> usize {
        let reference = self.residual.reference().map_or(0, |_| Reference::LEN);
        let others = CHECK + reference + self.payload().len();
        // Without a residual, a map by which all is as seen takes no byte.
        let free = usize::from(*self.residual == Residual::None);
        budget.saturating_sub(others).max(free)
    }

    /// Appends the part, if there is one, to a packet that begins with this latent part.
    pub fn write(&self, latent_len: usize, packet: &mut Vec<u8>) -> Result<(), PacketError> {
        if self.lens().is_none() {
            return Ok(());
        }
        let at = packet.len();
        packet.extend_from_slice(&[0; CHECK]);
        packet.extend(self.residual.reference().iter().flat_map(|reference| reference.bytes()));
        if let Some(map) = self.truth {
            if truth::split(map).is_none_or(|(_, rest)| !rest.is_empty()) {
                return Err(PacketError::Truth);
            }
            packet.extend_from_slice(map);
        }
        packet.extend_from_slice(self.payload());
        let check = check_of(&packet[..latent_len], &packet[at + CHECK..]);
        packet[at..at + CHECK].copy_from_slice(&check.to_le_bytes());
        Ok(())
    }
}

/// The part's check. The latent part ends with a CRC-16 of its own; a CRC-16 over all of it would depend on sixteen of
/// its bits only.
fn check_of(latent: &[u8], content: &[u8]) -> u16 {
    crc16(&[&crc32fast::hash(latent).to_le_bytes(), content])
}

/// Where the content of a residual part lies in its packet.
#[derive(Clone, Debug)]
pub(super) struct Contents {
    pub reference: Option<Reference>,
    /// The truth map; `None`: there is none, or not all of it is there.
    pub truth: Option<Range<usize>>,
    /// The payload without zeros at its end; `None`: what lies in front of it is not all there.
    pub payload: Option<Range<usize>>,
    /// Whether the check matches.
    pub checked: Result<(), PacketError>,
}

impl Contents {
    fn none(checked: Result<(), PacketError>) -> Contents {
        Contents { reference: None, truth: None, payload: None, checked }
    }

    /// Reads the part that begins at `at`, behind a latent part of `latent_len` bytes.
    pub fn read(head: &Head, bytes: &[u8], latent_len: usize, at: usize) -> Contents {
        if !head.is_known() {
            return Contents::none(Err(PacketError::Coder(head.kind as u8)));
        }
        if !head.has_content() {
            return Contents::none(Ok(()));
        }
        let (found, needed) = (bytes.len(), at + CHECK);
        let short = |needed| PacketError::TooShort { part: Part::Residual, needed, found };
        let Some(check) = bytes.get(at..needed) else { return Contents::none(Err(short(needed))) };
        let mut next = needed;
        let mut all = Contents::none(Ok(()));
        if head.kind == Kind::Inter {
            next += Reference::LEN;
            if found < next {
                return Contents::none(Err(short(next)));
            }
            all.reference = Reference::read(&bytes[next - Reference::LEN..]);
            if all.reference.is_none() {
                return Contents::none(Err(PacketError::Reference));
            }
        }
        if head.truth {
            let Some((map, _)) = truth::split(&bytes[next..]) else {
                // Its end is missing, or it is none.
                all.checked = Err(PacketError::Truth);
                return all;
            };
            all.truth = Some(next..next + map.len());
            next += map.len();
        }
        let end = next + without_zeros(&bytes[next..]).len();
        all.payload = Some(next..end);
        if check_of(&bytes[..latent_len], &bytes[needed..end]).to_le_bytes() != *check {
            all.checked = Err(PacketError::Check(Part::Residual));
        }
        all
    }

    /// Where the packet ends. `at`: where the part begins.
    pub fn end(&self, at: usize) -> usize {
        self.payload.as_ref().map_or(at, |payload| payload.end)
    }

    /// The residual in the packet's bytes.
    pub fn residual<'a>(&self, head: &Head, bytes: &'a [u8]) -> Result<Residual<'a>, PacketError> {
        self.checked.clone()?;
        let payload = self.payload.clone().and_then(|payload| bytes.get(payload)).unwrap_or(&[]);
        let (reference, small_blocks) = (self.reference, head.small_blocks);
        Ok(match head.kind {
            Kind::None | Kind::AllSeen => Residual::None,
            Kind::Omitted => Residual::Omitted,
            Kind::Coded => Residual::Coded { small_blocks, payload },
            Kind::Stream | Kind::Inter => Residual::Stream { reference, small_blocks, payload },
            Kind::Later6 | Kind::Later7 => return Err(PacketError::Coder(head.kind as u8)),
        })
    }

    /// What there is of the residual if its check does not match: perhaps its end is missing.
    pub fn start<'a>(&self, head: &Head, bytes: &'a [u8]) -> Option<ResidualStart<'a>> {
        let is_cut = self.checked == Err(PacketError::Check(Part::Residual));
        let payload = bytes.get(self.payload.clone()?)?;
        let (reference, small_blocks) = (self.reference, head.small_blocks);
        (is_cut && head.kind.is_wavelet()).then_some(ResidualStart {
            small_blocks,
            reference,
            payload,
        })
    }

    /// The truth map in the packet's bytes.
    pub fn truth<'a>(&self, head: &Head, bytes: &'a [u8]) -> Option<&'a [u8]> {
        if head.kind == Kind::AllSeen && head.is_known() {
            return Some(truth::ALL_SEEN);
        }
        bytes.get(self.truth.clone()?)
    }
}

/// Bytes without the zeros at their end: modems fill up their frames with zeros.
pub fn without_zeros(bytes: &[u8]) -> &[u8] {
    let zeros = bytes.iter().rev().take_while(|byte| **byte == 0).count();
    &bytes[..bytes.len() - zeros]
}
