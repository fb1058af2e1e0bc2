//! Finds accesses to a word that nothing orders, one of which writes.
//!
//! Between two invocations of a workgroup a barrier of it orders, and between two of a subgroup also one of that; but
//! only the memories that it names. Between workgroups of a dispatch nothing orders. Atomics do not race with each
//! other.

use crate::program::Barrier;

/// Memories that barriers order.
pub const SHARED: usize = 0;
pub const STORAGE: usize = 1;

/// The time of the last barriers, for each of the memories. It only grows, over all workgroups of a run.
#[derive(Default)]
pub struct Clock {
    now: u32,
    of_group: [u32; 2],
    of_subgroups: Vec<[u32; 2]>,
}

/// Who accesses, and which barriers lie behind it.
#[derive(Clone, Copy, Default)]
pub struct Who {
    pub invocation: u32,
    pub subgroup: u32,
    /// The number of its workgroup in the dispatch, from 1.
    pub group: u32,
    group_time: u32,
    subgroup_time: u32,
}

impl Clock {
    /// Begins a workgroup.
    pub fn start(&mut self, subgroups: usize) {
        self.now += 1;
        self.of_group = [self.now; 2];
        self.of_subgroups = vec![[self.now; 2]; subgroups];
    }

    /// All invocations of the workgroup, or of this subgroup, are at a barrier.
    pub fn pass(&mut self, barrier: Barrier, subgroup: usize) {
        self.now += 1;
        for (memory, ordered) in [(SHARED, barrier.shared), (STORAGE, barrier.storage)] {
            if ordered && barrier.of_subgroup {
                self.of_subgroups[subgroup][memory] = self.now;
            } else if ordered {
                self.of_group[memory] = self.now;
                self.of_subgroups.iter_mut().for_each(|times| times[memory] = self.now);
            }
        }
    }

    pub fn who(&self, memory: usize, invocation: u32, subgroup: u32, group: u32) -> Who {
        let subgroup_time = self.of_subgroups[subgroup as usize][memory];
        Who { invocation, subgroup, group, group_time: self.of_group[memory], subgroup_time }
    }
}

impl Who {
    /// Whether what it did comes before what `later` does.
    fn is_before(&self, later: &Who) -> bool {
        self.group_time < later.group_time
            || self.invocation == later.invocation
            || (self.subgroup == later.subgroup && self.subgroup_time < later.subgroup_time)
    }
}

/// How many accessed a word since the last barrier that all have behind them. Only the latest accesses are kept: what
/// races with an earlier one races with them, too.
#[derive(Clone, Copy, Default, PartialEq)]
enum Several {
    #[default]
    One,
    OfSubgroup,
    OfGroup,
}

/// Accesses that do not race with each other.
#[derive(Clone, Copy, Default)]
struct Accesses {
    last: Who,
    several: Several,
}

impl Accesses {
    /// An invocation whose access does not come before this.
    fn beside(&self, now: &Who) -> Option<u32> {
        let last = &self.last;
        let before = match self.several {
            Several::One => last.is_before(now),
            Several::OfSubgroup => {
                last.group_time < now.group_time
                    || (last.subgroup == now.subgroup && last.subgroup_time < now.subgroup_time)
            }
            Several::OfGroup => last.group_time < now.group_time,
        };
        (!before).then_some(last.invocation)
    }

    fn add(&mut self, now: Who) {
        let last = &self.last;
        let several = if last.group_time < now.group_time {
            Several::One
        } else if self.several == Several::OfGroup || last.subgroup != now.subgroup {
            Several::OfGroup
        } else {
            let again = self.several == Several::One && last.invocation == now.invocation;
            let latest = again || last.subgroup_time < now.subgroup_time;
            if latest { Several::One } else { Several::OfSubgroup }
        };
        *self = Accesses { last: now, several };
    }
}

/// Workgroups that accessed a word: none, one, or several.
#[derive(Clone, Copy, Default)]
struct Groups(u32);

impl Groups {
    const SEVERAL: u32 = u32::MAX;

    fn add(&mut self, group: u32) {
        self.0 = if self.0 == 0 || self.0 == group { group } else { Groups::SEVERAL };
    }

    fn has_other(self, group: u32) -> bool {
        self.0 != 0 && self.0 != group
    }
}

/// What was done with a word.
#[derive(Clone, Copy, Default)]
struct Word {
    write: Who,
    reads: Accesses,
    atomics: Accesses,
    groups_writing: Groups,
    groups_reading: Groups,
    groups_with_atomics: Groups,
}

/// A fault of an access.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// Beyond the end.
    Bounds { index: u32 },
    /// Nothing orders it and an access of this invocation.
    Race { word: u32, access: &'static str, other: u32 },
    /// The same, but both write the same.
    Equal { word: u32, other: u32 },
    /// Another workgroup accessed the word.
    Groups { word: u32, access: &'static str },
    /// Nobody wrote the word.
    Unwritten { word: u32 },
}

/// What was done with the words of a memory.
#[derive(Default)]
pub struct History {
    words: Vec<Word>,
}

impl History {
    pub fn new(words: usize) -> History {
        History { words: vec![Word::default(); words] }
    }

    /// A read of a word that exists. Of shared memory the workgroup must have written it.
    pub fn read(&mut self, at: u32, who: &Who, shared: bool) -> Result<(), Fault> {
        const ACCESS: &str = "read";
        let word = &mut self.words[at as usize];
        if shared && word.groups_writing.0 != who.group {
            return Err(Fault::Unwritten { word: at });
        }
        if !word.write.is_before(who) {
            return Err(race(at, ACCESS, word.write.invocation));
        }
        if let Some(other) = word.atomics.beside(who) {
            return Err(race(at, ACCESS, other));
        }
        if word.groups_writing.has_other(who.group) || word.groups_with_atomics.has_other(who.group)
        {
            return Err(Fault::Groups { word: at, access: ACCESS });
        }
        word.reads.add(*who);
        word.groups_reading.add(who.group);
        Ok(())
    }

    /// A write of a word that exists. `equal`: of the value that is there.
    pub fn write(&mut self, at: u32, who: &Who, equal: bool, shared: bool) -> Result<(), Fault> {
        const ACCESS: &str = "write";
        let word = &mut self.words[at as usize];
        if !word.write.is_before(who) {
            let other = word.write.invocation;
            return Err(if equal {
                Fault::Equal { word: at, other }
            } else {
                race(at, ACCESS, other)
            });
        }
        if let Some(other) = word.atomics.beside(who).or_else(|| word.reads.beside(who)) {
            return Err(race(at, ACCESS, other));
        }
        let groups = [word.groups_writing, word.groups_reading, word.groups_with_atomics];
        if !shared && groups.iter().any(|groups| groups.has_other(who.group)) {
            return Err(Fault::Groups { word: at, access: ACCESS });
        }
        word.write = *who;
        word.groups_writing = Groups(who.group);
        Ok(())
    }

    /// An atomic on a word that exists.
    pub fn atomic(&mut self, at: u32, who: &Who, shared: bool) -> Result<(), Fault> {
        const ACCESS: &str = "atomic";
        let word = &mut self.words[at as usize];
        if shared && word.groups_writing.0 != who.group {
            return Err(Fault::Unwritten { word: at });
        }
        if !word.write.is_before(who) {
            return Err(race(at, ACCESS, word.write.invocation));
        }
        if let Some(other) = word.reads.beside(who) {
            return Err(race(at, ACCESS, other));
        }
        let groups = [word.groups_writing, word.groups_reading];
        if groups.iter().any(|groups| groups.has_other(who.group)) {
            return Err(Fault::Groups { word: at, access: ACCESS });
        }
        word.atomics.add(*who);
        word.groups_with_atomics.add(who.group);
        Ok(())
    }

    /// Forgets which workgroups did anything: shared memory is a workgroup's own.
    pub fn forget_groups(&mut self) {
        for word in &mut self.words {
            (word.groups_writing, word.groups_reading) = (Groups(0), Groups(0));
            word.groups_with_atomics = Groups(0);
        }
    }
}

fn race(word: u32, access: &'static str, other: u32) -> Fault {
    Fault::Race { word, access, other }
}
