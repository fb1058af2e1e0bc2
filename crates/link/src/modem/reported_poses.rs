//! What a report tells of poses: those of which frames the topside holds.

/// Most bytes, of eight frames each.
pub const MAX_LEN: usize = 4;

/// A bit for the report's newest frame number and for each before it, lowest first: its pose is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportedPoses {
    bits: u32,
    /// Bytes of them that count.
    len: usize,
}

impl ReportedPoses {
    /// Of the frames before and at `newest`.
    pub fn new(newest: u32, holds: impl Fn(u32) -> bool) -> ReportedPoses {
        let bit = |behind: u32| u32::from(holds(newest.wrapping_sub(behind))) << behind;
        ReportedPoses { bits: (0..8 * MAX_LEN as u32).map(bit).sum(), len: MAX_LEN }
    }

    /// Each frame number, modulo 2¹⁶, newest first, and whether its pose is held.
    pub fn each(self, newest: u32) -> impl Iterator<Item = (u32, bool)> {
        let number = move |behind: u32| u32::from(newest.wrapping_sub(behind) as u16);
        (0..8 * self.len as u32).map(move |behind| (number(behind), self.bits >> behind & 1 == 1))
    }

    /// Those of the newest frames that take half of so many bytes, but one byte at least; `None`: there is no room.
    pub fn within(self, room: usize) -> Option<ReportedPoses> {
        let len = (room / 2).clamp(1, self.len);
        (room > 0).then_some(ReportedPoses { bits: self.bits & u32::MAX >> (32 - 8 * len), len })
    }

    /// Its bytes.
    pub fn bytes(&self) -> impl Iterator<Item = u8> {
        self.bits.to_le_bytes().into_iter().take(self.len)
    }

    /// How many they are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Reads one to four bytes.
    pub fn read(bytes: &[u8]) -> ReportedPoses {
        let word = bytes.iter().rev().fold(0, |bits, byte| bits << 8 | u32::from(*byte));
        ReportedPoses { bits: word, len: bytes.len() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_read() {
        let newest = 5;
        let poses = ReportedPoses::new(newest, |frame| frame as u16 % 3 == 2);
        let told: Vec<_> = poses.each(newest).take(8).collect();
        let held = [true, false, false, true, false, false, false, true];
        let numbers = [5, 4, 3, 2, 1, 0, 0xFFFF, 0xFFFE];
        assert_eq!(told, numbers.into_iter().zip(held).collect::<Vec<_>>());
        for (room, len) in [(1, 1), (2, 1), (5, 2), (8, 4), (90, 4)] {
            let some = poses.within(room).unwrap();
            let bytes: Vec<u8> = some.bytes().collect();
            assert_eq!((bytes.len(), ReportedPoses::read(&bytes)), (len, some));
            assert!(some.each(newest).eq(poses.each(newest).take(8 * len)));
        }
        assert_eq!(poses.within(0), None);
    }
}
