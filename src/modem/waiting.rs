//! Fragment frames that belong to no packet at hand: their first frame may be yet to come.

use super::ModemError;
use super::error::filled;
use super::fragment::Fragment;
use super::layout::Layout;

/// Unchecked later frames of one tag, one an index.
pub(super) struct Waiting {
    layout: Layout,
    tag: usize,
    /// Data. Each frame's data lies at its place in the packet without the first frame.
    data: Vec<u8>,
    /// By index less one.
    frames: Vec<Option<Held>>,
    count: usize,
}

/// What is kept of a frame besides its data.
#[derive(Clone, Copy)]
struct Held {
    check: u16,
    len: u16,
}

/// What became of a frame.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kept {
    /// It is kept.
    New,
    /// It is kept, another of its index is not any more.
    InsteadOf,
    /// It was there.
    Duplicate,
}

impl Waiting {
    /// Bytes of memory for `frames` frames of a packet, the first one counted.
    pub(super) fn memory(layout: Layout, frames: usize) -> usize {
        (frames - 1) * (layout.full() + size_of::<Option<Held>>())
    }

    pub(super) fn new(layout: Layout, tag: usize, frames: usize) -> Result<Waiting, ModemError> {
        let data = filled((frames - 1) * layout.full(), 0)?;
        Ok(Waiting { layout, tag, data, frames: filled(frames - 1, None)?, count: 0 })
    }

    /// Frames that wait.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Keeps a frame whose index there is room for.
    pub(super) fn keep(&mut self, later: &Fragment) -> Kept {
        let kept = match self.get(later.index) {
            None => Kept::New,
            Some(held) if held.check == later.check && held.data == later.data => {
                return Kept::Duplicate;
            }
            Some(_) => Kept::InsteadOf,
        };
        let at = (later.index - 1) * self.layout.full();
        self.data[at..at + later.data.len()].copy_from_slice(later.data);
        let len = later.data.len() as u16;
        self.frames[later.index - 1] = Some(Held { check: later.check, len });
        self.count += usize::from(kept == Kept::New);
        kept
    }

    pub(super) fn get(&self, index: usize) -> Option<Fragment<'_>> {
        let Held { check, len } = (*self.frames.get(index - 1)?)?;
        let at = (index - 1) * self.layout.full();
        let data = &self.data[at..at + usize::from(len)];
        Some(Fragment { tag: self.tag, index, check, data })
    }

    pub(super) fn remove(&mut self, index: usize) {
        self.count -= usize::from(self.frames[index - 1].take().is_some());
    }

    /// Index of the first frame that waits at `index` or after it.
    pub(super) fn next(&self, index: usize) -> Option<usize> {
        (index..=self.frames.len()).find(|index| self.frames[index - 1].is_some())
    }

    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        self.data.capacity() + self.frames.capacity() * size_of::<Option<Held>>()
    }
}
