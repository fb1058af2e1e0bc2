//! What travels of a packet: all but the bytes of its frame number that modem frames state, or that a predicted pose
//! makes superfluous. Its poses lie at most 64 frames before it, so 8 bits tell its number.

use std::ops::Range;

use nvsprior::packet::{HEAD_LEN, is_predicted, nearest_frame};

/// How much of the frame number modem frames state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Travelling {
    /// Its low 8 bits.
    Wide,
    /// Nothing.
    Small,
}

impl Travelling {
    /// Bytes that every packet leaves out.
    pub fn least(self) -> usize {
        self.left_out(0).len()
    }

    /// Bytes of a packet that begins with this byte that are left out.
    pub fn left_out(self, first: u8) -> Range<usize> {
        let at = HEAD_LEN;
        match (self, is_predicted(first)) {
            (Travelling::Wide, false) => at..at + 1,
            (Travelling::Wide, true) => at..at + 2,
            (Travelling::Small, false) => at..at,
            (Travelling::Small, true) => at + 1..at + 2,
        }
    }

    /// What travels of a packet, which is not empty.
    pub fn of(self, packet: &[u8]) -> impl Iterator<Item = &u8> {
        let Range { start, end } = self.left_out(packet[0]);
        packet[..start].iter().chain(&packet[end..])
    }

    /// Puts the frame number into a packet of which `len` bytes, in `bytes`, have travelled. `number`: its low bits, if
    /// modem frames state them. `last`: the frame number of a packet before. Returns the packet's length; `None`: too
    /// few bytes have come.
    pub fn restore(
        self,
        bytes: &mut [u8],
        len: usize,
        number: u32,
        last: Option<u32>,
    ) -> Option<usize> {
        let first = *bytes.first().filter(|_| len > 0)?;
        let out = self.left_out(first);
        let low = match self {
            Travelling::Wide => number,
            Travelling::Small => (*bytes[..len].get(HEAD_LEN)?).into(),
        };
        if len < out.start {
            return None;
        }
        let number = match is_predicted(first) {
            true => nearest_frame(low & 0xFF, 256, last),
            false => low,
        };
        bytes.copy_within(out.start..len, out.end);
        let stated = (number as u16).to_le_bytes();
        let from = out.start - HEAD_LEN;
        bytes[out.clone()].copy_from_slice(&stated[from..from + out.len()]);
        Some(len + out.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_comes_back() {
        // Absolute and predicted.
        for first in [0x00, 0x19] {
            let packet = [first, 1, 0x2A, 0x07, 4, 5, 6];
            for travelling in [Travelling::Wide, Travelling::Small] {
                let mut bytes: Vec<u8> = travelling.of(&packet).copied().collect();
                let len = bytes.len();
                assert_eq!(len + travelling.left_out(first).len(), packet.len());
                bytes.resize(packet.len(), 0xEE);
                let restored = travelling.restore(&mut bytes, len, 0x2A, Some(0x740));
                assert_eq!((restored, bytes), (Some(packet.len()), packet.to_vec()));
            }
        }
    }

    #[test]
    fn a_predicted_pose_takes_the_number_nearest_to_the_last_one() {
        let mut bytes = [0x19, 9, 8, 7, 0, 0];
        assert_eq!(Travelling::Wide.restore(&mut bytes, 4, 0x05, Some(0x1FE)), Some(6));
        assert_eq!(bytes, [0x19, 9, 0x05, 0x02, 8, 7]);
        assert_eq!(Travelling::Wide.restore(&mut [0x19], 0, 5, None), None);
    }
}
