//! What invocations share: storage buffers, shared memory, push constants. Every access is checked.

use crate::program::{Atomic, Barrier, NONE, Space};
use crate::races::{Clock, Fault, History, SHARED, STORAGE, Who};

pub struct Memory<'a> {
    pub buffers: &'a mut [Vec<u32>],
    push: &'a [u32],
    shared: Vec<u32>,
    histories: Vec<History>,
    shared_history: History,
    clock: Clock,
}

/// The invocation that accesses memory.
#[derive(Clone, Copy)]
pub struct Accessor {
    shared: Who,
    storage: Who,
}

impl<'a> Memory<'a> {
    pub fn new(buffers: &'a mut [Vec<u32>], shared_words: u32, push: &'a [u32]) -> Memory<'a> {
        let histories = buffers.iter().map(|buffer| History::new(buffer.len())).collect();
        let words = shared_words as usize;
        Memory {
            buffers,
            push,
            shared: vec![0; words],
            histories,
            shared_history: History::new(words),
            clock: Clock::default(),
        }
    }

    /// Begins a workgroup. Its shared memory holds anything.
    pub fn start(&mut self, subgroups: usize, garbage: u32) {
        self.clock.start(subgroups);
        self.shared.fill(garbage);
        self.shared_history.forget_groups();
    }

    pub fn pass(&mut self, barrier: Barrier, subgroup: u32) {
        self.clock.pass(barrier, subgroup as usize);
    }

    pub fn accessor(&self, invocation: u32, subgroup: u32, group: u32) -> Accessor {
        let who = |memory| self.clock.who(memory, invocation, subgroup, group);
        Accessor { shared: who(SHARED), storage: who(STORAGE) }
    }

    /// Words of a memory.
    pub fn length(&self, space: Space) -> u32 {
        let words = match space {
            Space::Storage(binding) => self.buffers[binding as usize].len(),
            Space::Shared => self.shared.len(),
            Space::Push => self.push.len(),
            Space::Own => 0,
        };
        words as u32
    }

    /// The words of an access, which must be there.
    fn inside(&self, space: Space, at: u32, words: u32) -> Result<(), Fault> {
        let end = u64::from(at) + u64::from(words);
        let is_inside = at != NONE && end <= u64::from(self.length(space));
        if is_inside { Ok(()) } else { Err(Fault::Bounds { index: at }) }
    }

    pub fn load(
        &mut self,
        who: &Accessor,
        space: Space,
        at: u32,
        to: &mut [u32],
    ) -> Result<(), Fault> {
        self.inside(space, at, to.len() as u32)?;
        let (memory, history, who, shared) = match space {
            Space::Storage(binding) => {
                let binding = binding as usize;
                (&self.buffers[binding], &mut self.histories[binding], &who.storage, false)
            }
            Space::Shared => (&self.shared, &mut self.shared_history, &who.shared, true),
            _ => {
                to.copy_from_slice(&self.push[at as usize..][..to.len()]);
                return Ok(());
            }
        };
        for (word, to) in (at..).zip(to) {
            history.read(word, who, shared)?;
            *to = memory[word as usize];
        }
        Ok(())
    }

    pub fn store(
        &mut self,
        who: &Accessor,
        space: Space,
        at: u32,
        from: &[u32],
    ) -> Result<(), Fault> {
        self.inside(space, at, from.len() as u32)?;
        let (memory, history, who, shared) = self.writable(who, space, at)?;
        for (word, from) in (at..).zip(from) {
            let equal = memory[word as usize] == *from;
            history.write(word, who, equal, shared)?;
            memory[word as usize] = *from;
        }
        Ok(())
    }

    /// Returns the value before.
    pub fn atomic(
        &mut self,
        who: &Accessor,
        space: Space,
        at: u32,
        op: Atomic,
        value: u32,
    ) -> Result<u32, Fault> {
        self.inside(space, at, 1)?;
        let (memory, history, who, shared) = self.writable(who, space, at)?;
        history.atomic(at, who, shared)?;
        let word = &mut memory[at as usize];
        let before = *word;
        *word = match op {
            Atomic::Add => before.wrapping_add(value),
            Atomic::Max => before.max(value),
        };
        Ok(before)
    }

    fn writable<'m>(
        &'m mut self,
        who: &'m Accessor,
        space: Space,
        at: u32,
    ) -> Result<(&'m mut [u32], &'m mut History, &'m Who, bool), Fault> {
        match space {
            Space::Storage(binding) => {
                let binding = binding as usize;
                let history = &mut self.histories[binding];
                Ok((&mut self.buffers[binding], history, &who.storage, false))
            }
            Space::Shared => Ok((&mut self.shared, &mut self.shared_history, &who.shared, true)),
            _ => Err(Fault::Bounds { index: at }),
        }
    }
}
