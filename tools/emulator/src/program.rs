//! A module as the emulator runs it: one list of instructions on registers of 32 bits. Values of several words lie in
//! registers one after the other; so do variables of an invocation, whose addresses are registers.

use crate::values::{One, Two};

/// A register, or an address that is known before the run.
pub type Reg = u32;

/// No register.
pub const NONE: Reg = u32::MAX;

/// What an address is in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Space {
    /// The storage buffer of a binding.
    Storage(u32),
    Shared,
    Push,
    /// The invocation's own registers: variables, and inputs.
    Own,
}

/// An address: a register's content, if there is one, and a fixed number of words.
#[derive(Clone, Copy, Debug)]
pub struct Address {
    pub space: Space,
    pub reg: Reg,
    pub fixed: u32,
}

/// An index of an access chain.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    pub index: Reg,
    pub stride: u32,
    /// Elements; `None` for an array that ends with its buffer.
    pub count: Option<u32>,
}

/// What a subgroup does together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Collective {
    All,
    Any,
    Ballot,
    /// The value of the lane that operand `b` names.
    Shuffle,
    IntegerSum(Part),
    FloatSum(Part),
}

impl Collective {
    /// Words of the result.
    pub fn words(self) -> u32 {
        if self == Collective::Ballot { 4 } else { 1 }
    }
}

/// Of which lanes a sum is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part {
    All,
    UpToThis,
    BeforeThis,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Atomic {
    Add,
    Max,
}

/// A control barrier, and the memories that it orders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barrier {
    pub of_subgroup: bool,
    pub shared: bool,
    pub storage: bool,
}

#[derive(Clone, Copy, Debug)]
pub enum Instruction {
    One {
        op: One,
        to: Reg,
        a: Reg,
    },
    Two {
        op: Two,
        to: Reg,
        a: Reg,
        b: Reg,
    },
    Fma {
        to: Reg,
        a: Reg,
        b: Reg,
        c: Reg,
    },
    Select {
        to: Reg,
        condition: Reg,
        a: Reg,
        b: Reg,
    },
    Copy {
        to: Reg,
        from: Reg,
        words: u32,
    },
    /// Leaves an address in `to`. If an index is out of bounds, [`NONE`], and the index in the register after it.
    Locate {
        to: Reg,
        from: Address,
        first: u32,
        end: u32,
    },
    /// Number of elements of the array at an address, which ends with its buffer.
    Length {
        to: Reg,
        binding: u32,
        at: u32,
        stride: u32,
    },
    Load {
        to: Reg,
        from: Address,
        words: u32,
    },
    Store {
        to: Address,
        from: Reg,
        words: u32,
    },
    Atomic {
        op: Atomic,
        to: Reg,
        at: Address,
        value: Reg,
    },
    Collective {
        op: Collective,
        to: Reg,
        a: Reg,
        b: Reg,
    },
    Barrier(Barrier),
    Jump(Edge),
    Fork {
        condition: Reg,
        yes: Edge,
        no: Edge,
    },
    /// Cases `[first, end)`, then the default.
    Switch {
        selector: Reg,
        first: u32,
        end: u32,
        default: Edge,
    },
    Return,
    Unreachable,
}

/// The number of an [`EdgeMoves`].
pub type Edge = u32;

/// A jump from one block to another: its target, and the values that it hands to the target's phis.
#[derive(Clone, Copy, Debug)]
pub struct EdgeMoves {
    pub target: u32,
    /// Part of [`Module::moves`].
    pub first: u32,
    pub end: u32,
}

/// Inputs of an invocation that a module may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input {
    GroupCount,
    Group,
    Local,
    Global,
    Index,
    Subgroup,
    Lane,
    SubgroupSize,
    SubgroupCount,
}

impl Input {
    pub fn words(self) -> u32 {
        match self {
            Input::GroupCount | Input::Group | Input::Local | Input::Global => 3,
            _ => 1,
        }
    }
}

/// A compute module, ready to run.
#[derive(Clone, Debug, Default)]
pub struct Module {
    /// The entry point.
    pub(crate) entry: String,
    /// Invocations of a workgroup along each axis.
    pub(crate) size: [u32; 3],
    pub(crate) code: Vec<Instruction>,
    /// Of each instruction, the SPIR-V instruction that it is from: its number and first word.
    pub(crate) origins: Vec<(u16, u32)>,
    pub(crate) terms: Vec<Term>,
    pub(crate) edges: Vec<EdgeMoves>,
    pub(crate) moves: Vec<(Reg, Reg)>,
    pub(crate) cases: Vec<(u32, Edge)>,
    /// What an invocation's registers hold at the start.
    pub(crate) registers: Vec<u32>,
    /// Registers whose content is not defined at the start.
    pub(crate) undefined: Vec<Reg>,
    /// Registers of variables that an invocation begins with, and those that they are copied from.
    pub(crate) first_values: Vec<(Reg, Reg)>,
    /// Registers of specialisation constants, by their number.
    pub(crate) constants: Vec<(u32, Reg)>,
    pub(crate) inputs: Vec<(Input, Reg)>,
    pub(crate) shared_words: u32,
    /// Storage buffers: the highest binding and one.
    pub(crate) bindings: u32,
}

impl Module {
    /// Invocations of a workgroup.
    pub fn invocations(&self) -> u32 {
        self.size.iter().product()
    }
}
