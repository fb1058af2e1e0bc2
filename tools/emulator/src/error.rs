//! What may be wrong with a module, or with what it does.

use std::fmt;

/// An instruction that an invocation is at.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// The entry point.
    pub entry: String,
    /// The instruction's name.
    pub instruction: String,
    /// Its first word in the module.
    pub word: u32,
    /// The workgroup.
    pub group: [u32; 3],
    /// The invocation's number in it.
    pub invocation: u32,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Place { entry, instruction, word, group, invocation } = self;
        write!(f, "{entry}, {instruction} at word {word}, ")?;
        write!(f, "invocation {invocation} of workgroup {group:?}")
    }
}

/// A fault of a module, or of a run of it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Words that are no module.
    #[error("not a SPIR-V module: {0}")]
    Malformed(String),
    /// What the emulator has no meaning for.
    #[error("unknown {what} in module {entry}")]
    Unknown {
        /// The thing.
        what: String,
        /// The module's entry point, if it is known by then.
        entry: String,
    },
    /// A dispatch that the module cannot have.
    #[error("{entry}: {what}")]
    Dispatch {
        /// The module's entry point.
        entry: String,
        /// What is wrong.
        what: String,
    },
    /// An access to memory that invocations share, which no barrier orders.
    #[error("{entry}: the access at word {word} is private")]
    Private {
        /// The module's entry point.
        entry: String,
        /// The instruction's first word in the module.
        word: u32,
    },
    /// An access beyond the end.
    #[error("{place}: index {index} of {memory} is out of bounds")]
    OutOfBounds {
        /// Who accesses.
        place: Box<Place>,
        /// What is accessed.
        memory: String,
        /// The index; the word if the index is within a type's bounds.
        index: u32,
    },
    /// Shared memory that is read before it is written.
    #[error("{place}: word {word} of shared memory is read, but was never written")]
    Unwritten {
        /// Who reads.
        place: Box<Place>,
        /// The word.
        word: u32,
    },
    /// Two accesses to a word that nothing orders, one of which writes.
    #[error("{place}: {access} of word {word} of {memory} races with invocation {other}")]
    Race {
        /// Who comes second.
        place: Box<Place>,
        /// What it does.
        access: &'static str,
        /// What is accessed.
        memory: String,
        /// The word.
        word: u32,
        /// An invocation of the same workgroup that came first.
        other: u32,
    },
    /// Two writes of the same value to a word that nothing orders.
    #[error("{place}: writes what invocation {other} wrote to word {word} of {memory}")]
    EqualWrites {
        /// Who comes second.
        place: Box<Place>,
        /// What is written.
        memory: String,
        /// The word.
        word: u32,
        /// An invocation of the same workgroup that came first.
        other: u32,
    },
    /// Two workgroups that access a word, one of which writes.
    #[error("{place}: {access} of word {word} of {memory} races with another workgroup")]
    GroupRace {
        /// Who comes second.
        place: Box<Place>,
        /// What it does.
        access: &'static str,
        /// What is accessed.
        memory: String,
        /// The word.
        word: u32,
    },
    /// Invocations that must meet and do not.
    #[error("{place} waits, but {other}")]
    Divergent {
        /// Who waits.
        place: Box<Place>,
        /// What another does.
        other: String,
    },
    /// Subgroups of a workgroup that pass barriers of their own unequally often. Vulkan allows it. But some drivers
    /// (llvmpipe, panfrost, v3d) make each such barrier one of the workgroup. None of them has subgroups of more than
    /// 16, so larger ones are not checked.
    #[error("{entry}: between two barriers of workgroup {group:?}, subgroup 0 passes {} of its own, and subgroup \
             {other} {}", barriers[0], barriers[1])]
    Uneven {
        /// The module's entry point.
        entry: String,
        /// The workgroup.
        group: [u32; 3],
        /// How many barriers subgroup 0 passes, and how many the other one.
        barriers: [u32; 2],
        /// The other subgroup.
        other: u32,
    },
    /// A value of a lane that takes no part.
    #[error("{place}: lane {lane} is not active")]
    InactiveLane {
        /// Who asks for it.
        place: Box<Place>,
        /// The lane.
        lane: u32,
    },
    /// A division of integers by zero.
    #[error("{0}: divides by zero")]
    DividesByZero(Box<Place>),
    /// An instruction that must not be reached.
    #[error("{0}: must not be reached")]
    Unreachable(Box<Place>),
    /// A workgroup that does not end.
    #[error("{0}: still runs after {1} instructions")]
    Endless(Box<Place>, u64),
}
