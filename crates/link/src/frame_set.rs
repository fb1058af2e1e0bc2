//! Frame numbers, in memory that is taken once.

/// Frame numbers as they came. If there is no room, the one that has been there longest goes: a vehicle that begins
/// anew may begin with small numbers.
#[derive(Debug)]
pub(super) struct FrameSet {
    numbers: Vec<u32>,
    room: usize,
}

impl FrameSet {
    /// Room for so many numbers.
    pub fn with_room(room: usize) -> FrameSet {
        FrameSet { numbers: Vec::with_capacity(room + 1), room }
    }

    pub fn insert(&mut self, frame: u32) {
        if !self.contains(frame) {
            self.numbers.push(frame);
            if self.numbers.len() > self.room {
                self.numbers.remove(0);
            }
        }
    }

    pub fn contains(&self, frame: u32) -> bool {
        self.numbers.contains(&frame)
    }

    /// Takes the least number out.
    pub fn pop_least(&mut self) -> Option<u32> {
        let least = self.numbers.iter().copied().min()?;
        self.remove(least);
        Some(least)
    }

    pub fn remove(&mut self, frame: u32) {
        self.numbers.retain(|number| *number != frame);
    }

    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.numbers.iter().copied()
    }

    pub fn clear(&mut self) {
        self.numbers.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_ones_stay_and_no_memory_is_taken() {
        let mut set = FrameSet::with_room(3);
        let room = set.numbers.capacity();
        for frame in [5, 2, 9, 5, 7, 1] {
            set.insert(frame);
        }
        assert_eq!(set.iter().collect::<Vec<_>>(), [9, 7, 1]);
        assert!(set.contains(7) && !set.contains(2));
        set.remove(7);
        assert_eq!((set.pop_least(), set.pop_least(), set.pop_least()), (Some(1), Some(9), None));
        assert!(set.is_empty() && set.numbers.capacity() == room);
    }
}
