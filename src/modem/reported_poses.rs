//! What a report tells of poses: those of which frames the topside holds.

use crate::packet::bytes::crc16;

/// Frames that it tells of.
const FRAMES: u32 = 32;
/// Bytes behind a report.
pub const LEN: usize = 6;
const CHECK: usize = 2;

/// A bit for the report's newest frame number and for each before it, lowest first: its pose is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportedPoses(u32);

impl ReportedPoses {
    /// Of the frames before and at `newest`.
    pub fn new(newest: u32, holds: impl Fn(u32) -> bool) -> ReportedPoses {
        let bit = |behind: u32| u32::from(holds(newest.wrapping_sub(behind))) << behind;
        ReportedPoses((0..FRAMES).map(bit).sum())
    }

    /// Each frame number, modulo 2¹⁶, newest first, and whether its pose is held.
    pub fn each(self, newest: u32) -> impl Iterator<Item = (u32, bool)> {
        let number = move |behind: u32| u32::from(newest.wrapping_sub(behind) as u16);
        (0..FRAMES).map(move |behind| (number(behind), self.0 >> behind & 1 == 1))
    }

    /// The bytes behind a report.
    pub fn bytes(self, report: &[u8]) -> [u8; LEN] {
        let [a, b, c, d] = self.0.to_le_bytes();
        let [e, f] = crc16(&[report, &[a, b, c, d]]).to_le_bytes();
        [a, b, c, d, e, f]
    }

    /// Reads what follows a report; `None`: it is padding.
    pub fn read(report: &[u8], after: &[u8]) -> Option<ReportedPoses> {
        let (bits, check) = after.get(..LEN)?.split_at(LEN - CHECK);
        let found = crc16(&[report, bits]).to_le_bytes() == *check;
        found.then(|| ReportedPoses(u32::from_le_bytes([bits[0], bits[1], bits[2], bits[3]])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_read_and_padding_is_none() {
        let newest = 5;
        let poses = ReportedPoses::new(newest, |frame| frame as u16 % 3 == 2);
        let told: Vec<_> = poses.each(newest).take(8).collect();
        let held = [true, false, false, true, false, false, false, true];
        let numbers = [5, 4, 3, 2, 1, 0, 0xFFFF, 0xFFFE];
        assert_eq!(told, numbers.into_iter().zip(held).collect::<Vec<_>>());
        let bytes = poses.bytes(b"report");
        assert_eq!(ReportedPoses::read(b"report", &bytes), Some(poses));
        assert_eq!(ReportedPoses::read(b"repork", &bytes), None);
        assert_eq!(ReportedPoses::read(b"report", &bytes[..5]), None);
        assert_eq!(ReportedPoses::read(b"report", &[0; 12]), None);
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(ReportedPoses::read(b"report", &damaged), None);
        }
    }
}
