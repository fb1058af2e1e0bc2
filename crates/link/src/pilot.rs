//! What the topside tells the vehicle beside its report of packets: user bytes of the report.
//!
//! | byte | content |
//! |---|---|
//! | 0 | bit 0: a region of interest follows; bit 1: announce prior and camera; the others are 0 |
//! | 1–2 | the topside's time as the report was sent: [`exposure::stamp`](super::exposure::stamp), little endian |
//! | 3–6 | left, top, right and bottom of the region, in 1/255 of the picture's sides; if it follows |
//! | 7 | its weight; if it follows |
//! | … | user bytes of the topside's owner |
//!
//! Each report tells all of it. So a lost one costs little, and a region ends with the first report without it.

use nvsprior::residual::{Interest, ResidualError};

const REGION: u8 = 1;
const ANNOUNCE: u8 = 2;

/// A rectangle of the picture that gets more of the bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Region {
    /// Left, top, right and bottom, in 1/255 of the picture's sides.
    pub edges: [u8; 4],
    /// How much more an error in it counts.
    pub weight: u8,
}

impl Region {
    /// Left, top, right and bottom as parts of the picture, 0 to 1. `None`: it is empty, or no rectangle.
    pub fn new(parts: [f64; 4], weight: u8) -> Option<Region> {
        if !parts.iter().all(|part| (0.0..=1.0).contains(part)) {
            return None;
        }
        Region::of(parts.map(|part| (part * 255.0).round() as u8), weight)
    }

    fn of(edges: [u8; 4], weight: u8) -> Option<Region> {
        let [left, top, right, bottom] = edges;
        (left < right && top < bottom && weight > 0).then_some(Region { edges, weight })
    }

    /// As the encoder takes it, for pictures of a size.
    ///
    /// # Errors
    /// If the picture is too small to have a pixel in it.
    pub fn interest(&self, (width, height): (u32, u32)) -> Result<Interest, ResidualError> {
        let [left, top, right, bottom] = self.edges.map(u32::from);
        let from = |edge: u32, side: u32| edge * side / 255;
        let to = |edge: u32, side: u32| (edge * side).div_ceil(255);
        let (x, y) = (from(left, width)..to(right, width), from(top, height)..to(bottom, height));
        Interest::rectangle((width, height), x, y, self.weight)
    }
}

/// What a report tells besides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PilotMessage {
    /// When it was sent.
    pub sent: u16,
    /// The topside does not know prior or camera of the packets that come.
    pub announce: bool,
    pub region: Option<Region>,
}

impl PilotMessage {
    /// Most bytes that it takes, without user bytes.
    pub const MOST: usize = 8;

    /// Replaces what `into` held by the message and user bytes behind it.
    pub fn write(&self, user: &[u8], into: &mut Vec<u8>) {
        let mark = if self.region.is_some() { REGION } else { 0 };
        into.clear();
        into.push(mark | if self.announce { ANNOUNCE } else { 0 });
        into.extend(self.sent.to_le_bytes());
        if let Some(region) = &self.region {
            into.extend(region.edges);
            into.push(region.weight);
        }
        into.extend(user);
    }

    /// The message, and the user bytes behind it. `None`: the bytes are none of a topside.
    pub fn read(bytes: &[u8]) -> Option<(PilotMessage, &[u8])> {
        let [mark, low, high, rest @ ..] = bytes else { return None };
        if mark & !(REGION | ANNOUNCE) != 0 {
            return None;
        }
        let (region, user) = match (mark & REGION, rest) {
            (0, user) => (None, user),
            (_, &[left, top, right, bottom, weight, ref user @ ..]) => {
                (Some(Region::of([left, top, right, bottom], weight)?), user)
            }
            _ => return None,
        };
        let sent = u16::from_le_bytes([*low, *high]);
        Some((PilotMessage { sent, announce: mark & ANNOUNCE != 0, region }, user))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_back_and_others_are_refused() {
        let region = Region::new([0.25, 0.5, 0.5, 1.0], 8).unwrap();
        for (announce, region) in [(false, None), (true, None), (true, Some(region))] {
            let (message, mut bytes) = (PilotMessage { sent: 0x1234, announce, region }, vec![7]);
            for user in [&b""[..], b"of mine"] {
                message.write(user, &mut bytes);
                assert_eq!(PilotMessage::read(&bytes), Some((message, user)));
            }
            bytes.truncate(if region.is_some() { PilotMessage::MOST - 1 } else { 2 });
            assert_eq!(PilotMessage::read(&bytes), None);
        }
        assert_eq!(PilotMessage::read(&[4, 0, 0]), None);
        assert_eq!(PilotMessage::read(&[1, 0, 0, 9, 0, 9, 5, 1]), None, "an empty region");
    }

    #[test]
    fn regions_are_rectangles_within_the_picture() {
        for parts in [
            [0.5, 0.0, 0.5, 1.0],
            [0.6, 0.0, 0.5, 1.0],
            [f64::NAN, 0.0, 1.0, 1.0],
            [0.0, 0.0, 1.1, 1.0],
        ] {
            assert_eq!(Region::new(parts, 8), None, "{parts:?}");
        }
        let right = Region::new([0.5, 0.0, 1.0, 1.0], 8).unwrap().interest((320, 180)).unwrap();
        let map = Interest::rectangle((320, 180), 160..320, 0..180, 8).unwrap();
        assert_eq!(right, map);
        let tiny = Region { edges: [0, 0, 1, 1], weight: 3 };
        assert!(tiny.interest((1, 1)).is_ok(), "a region has a pixel at least");
    }
}
