//! What a report tells of updates: which ones the topside holds, and what has come of the last one.

use crate::prior::StateId;

use super::wire::piece::UpdateName;

/// Most states that a report tells of: after a restart the vehicle may stand on an earlier one.
pub const MAX_STATES: usize = 4;
/// Bit of the first byte: the last update follows.
const LAST: u8 = 1 << 7;
/// Its other bits: states.
const COUNT: u8 = 7;
/// Bytes of a state and of the last update.
const STATE_LEN: usize = 3;
const LAST_LEN: usize = 4;
/// In place of the number of pieces: the update is whole.
const WHOLE: u8 = u8::MAX;

/// What a report tells of updates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReportedUpdates {
    /// Numbers modulo 256 and states modulo 2¹⁶, newest first.
    states: [(u8, u16); MAX_STATES],
    count: usize,
    /// The update whose piece came last.
    pub last: Option<LastUpdate>,
}

/// The update whose piece came last, and how many pieces of it are there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastUpdate {
    pub name: UpdateName,
    /// Different pieces that came, at most 254; 255: the update is whole.
    pub came: u8,
}

impl LastUpdate {
    pub fn new(name: UpdateName, came: Option<usize>) -> LastUpdate {
        let came = came.map_or(WHOLE, |came| came.min(usize::from(WHOLE - 1)) as u8);
        LastUpdate { name, came }
    }

    pub fn is_whole(&self) -> bool {
        self.came == WHOLE
    }
}

impl ReportedUpdates {
    /// Tells of the states that the topside holds, newest first, in place of those before.
    pub fn set_states(&mut self, states: impl Iterator<Item = (u16, StateId)>) {
        (self.states, self.count) = Default::default();
        for ((number, state), told) in states.zip(&mut self.states) {
            *told = (number as u8, state.0 as u16);
            self.count += 1;
        }
    }

    /// Whether the topside holds the state after an update.
    pub fn holds(&self, number: u16, state: StateId) -> bool {
        self.states[..self.count].contains(&(number as u8, state.0 as u16))
    }

    /// States that are told in so many bytes; `None`: not even the newest one fits. All others would be taken for a
    /// topside that holds none.
    fn fitting(&self, room: usize) -> Option<usize> {
        let last = if self.last.is_some() { LAST_LEN } else { 0 };
        let count = room.checked_sub(1 + last)? / STATE_LEN;
        (count.min(self.count) > 0 || self.count == 0).then_some(count.min(self.count))
    }

    /// The bytes, at most `room`, and how many they are; `None`: they do not fit.
    pub fn written(&self, room: usize) -> Option<([u8; MAX_LEN], usize)> {
        let count = self.fitting(room)?;
        let (mut bytes, mut len) = ([0; MAX_LEN], 1);
        bytes[0] = count as u8 | if self.last.is_some() { LAST } else { 0 };
        for (number, state) in &self.states[..count] {
            let [low, high] = state.to_le_bytes();
            bytes[len..len + STATE_LEN].copy_from_slice(&[*number, low, high]);
            len += STATE_LEN;
        }
        if let Some(LastUpdate { name, came }) = self.last {
            let [low, high] = name.tag.to_le_bytes();
            bytes[len..len + LAST_LEN].copy_from_slice(&[name.number, low, high, came]);
            len += LAST_LEN;
        }
        Some((bytes, len))
    }

    /// How many bytes follow the first one; `None`: it is no such byte.
    pub fn rest_len(first: u8) -> Option<usize> {
        let count = usize::from(first & COUNT);
        let last = if first & LAST != 0 { LAST_LEN } else { 0 };
        (first & !(LAST | COUNT) == 0 && count <= MAX_STATES).then_some(STATE_LEN * count + last)
    }

    /// Reads what follows the first byte, [`ReportedUpdates::rest_len`] bytes.
    pub fn read(first: u8, rest: &[u8]) -> ReportedUpdates {
        let count = usize::from(first & COUNT).min(MAX_STATES);
        let (states, last) = rest.split_at(STATE_LEN * count);
        let mut read = ReportedUpdates { count, ..Default::default() };
        for (state, told) in states.as_chunks::<STATE_LEN>().0.iter().zip(&mut read.states) {
            *told = (state[0], u16::from_le_bytes([state[1], state[2]]));
        }
        if let [number, low, high, came] = *last {
            let name = UpdateName { number, tag: u16::from_le_bytes([low, high]) };
            read.last = Some(LastUpdate { name, came });
        }
        read
    }
}

/// Most bytes.
pub const MAX_LEN: usize = 1 + MAX_STATES * STATE_LEN + LAST_LEN;

#[cfg(test)]
mod tests {
    use super::*;

    fn updates() -> ReportedUpdates {
        let name = UpdateName { number: 9, tag: 0x1234 };
        let last = Some(LastUpdate::new(name, Some(12)));
        let mut updates = ReportedUpdates { last, ..Default::default() };
        updates.set_states((0..9).map(|k| (300 - k, StateId(0xABCD_0000 + u32::from(k)))));
        updates
    }

    #[test]
    fn what_is_written_is_read_as_far_as_it_fits() {
        let updates = updates();
        assert!(updates.holds(300, StateId(0xABCD_0000)) && updates.holds(297, StateId(3)));
        assert!(!updates.holds(296, StateId(4)), "four are told");
        assert!(!updates.holds(300, StateId(1)));
        for room in 0..30 {
            let Some((bytes, len)) = updates.written(room) else {
                assert!(room < 8, "the newest state and the last update take eight bytes");
                continue;
            };
            assert!(len <= room && ReportedUpdates::rest_len(bytes[0]) == Some(len - 1));
            let read = ReportedUpdates::read(bytes[0], &bytes[1..len]);
            assert_eq!(read.last, updates.last);
            assert_eq!(read.count, ((room - 5) / 3).min(4));
            assert_eq!(read.states[..read.count], updates.states[..read.count]);
        }
        let none = ReportedUpdates::default();
        assert_eq!(none.written(1).map(|(bytes, len)| (bytes[0], len)), Some((0, 1)));
        assert_eq!(ReportedUpdates::rest_len(5), None);
        assert_eq!(ReportedUpdates::rest_len(0x40), None);
    }

    #[test]
    fn pieces_are_counted_up_to_what_a_byte_holds() {
        let of = |came| LastUpdate::new(UpdateName::default(), came);
        assert_eq!((of(Some(3)).came, of(Some(300)).came), (3, 254));
        assert!(of(None).is_whole() && !of(Some(300)).is_whole());
    }
}
