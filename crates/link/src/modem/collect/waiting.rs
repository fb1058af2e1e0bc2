//! Continuations of no packet at hand: its first share may be yet to come.

use crate::modem::error::ModemError;
use crate::modem::memory::filled;
use crate::modem::wire::layout::Layout;
use crate::modem::wire::plain::Continuation;

/// Unchecked continuations of one tag, one an index.
pub struct Waiting {
    layout: Layout,
    tag: usize,
    /// Data. Each share's data lies at its place in the packet without the first share.
    data: Vec<u8>,
    /// By index less one.
    shares: Vec<Option<Continued>>,
    count: usize,
}

/// What is kept of a continuation besides its data.
#[derive(Clone, Copy)]
struct Continued {
    check: u16,
    len: u16,
    last: bool,
}

/// What became of a continuation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Insertion {
    /// It is kept.
    New,
    /// It is kept, another of its index is not any more.
    InsteadOf,
    /// It was there.
    Duplicate,
}

impl Waiting {
    /// Bytes of memory for `shares` shares of a packet, the first one counted.
    pub fn memory(layout: Layout, shares: usize) -> usize {
        (shares - 1) * (layout.full() + size_of::<Option<Continued>>())
    }

    pub fn new(layout: Layout, tag: usize, shares: usize) -> Result<Waiting, ModemError> {
        let data = filled((shares - 1) * layout.full(), 0)?;
        Ok(Waiting { layout, tag, data, shares: filled(shares - 1, None)?, count: 0 })
    }

    /// Continuations that wait.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Keeps a continuation whose index there is room for.
    pub fn keep(&mut self, later: &Continuation) -> Insertion {
        let kept = match self.get(later.index) {
            None => Insertion::New,
            Some(held) if held.check == later.check && held.data == later.data => {
                return Insertion::Duplicate;
            }
            Some(_) => Insertion::InsteadOf,
        };
        let at = (later.index - 1) * self.layout.full();
        self.data[at..at + later.data.len()].copy_from_slice(later.data);
        let len = later.data.len() as u16;
        self.shares[later.index - 1] =
            Some(Continued { check: later.check, len, last: later.last });
        self.count += usize::from(kept == Insertion::New);
        kept
    }

    pub fn get(&self, index: usize) -> Option<Continuation<'_>> {
        let Continued { check, len, last } = (*self.shares.get(index - 1)?)?;
        let at = (index - 1) * self.layout.full();
        let data = &self.data[at..at + usize::from(len)];
        Some(Continuation { tag: self.tag, index, last, check, data })
    }

    pub fn remove(&mut self, index: usize) {
        self.count -= usize::from(self.shares[index - 1].take().is_some());
    }

    /// Forgets all, and tells how many they were.
    pub fn clear(&mut self) -> u64 {
        self.shares.fill(None);
        std::mem::take(&mut self.count) as u64
    }

    /// Index of the first continuation that waits at `index` or after it.
    pub fn next(&self, index: usize) -> Option<usize> {
        (index..=self.shares.len()).find(|index| self.shares[index - 1].is_some())
    }

    #[cfg(test)]
    pub fn capacity(&self) -> usize {
        self.data.capacity() + self.shares.capacity() * size_of::<Option<Continued>>()
    }
}
