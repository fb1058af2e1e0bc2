//! An invocation, and how it runs until it must wait, ends, or has had its turn.

use crate::memory::{Accessor, Memory};
use crate::program::{Address, Instruction, Module, NONE, Reg, Space};
use crate::races::Fault;
use crate::values::{fma, one, two};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    Ready,
    Waiting,
    Ended,
}

/// An invocation.
pub struct Invocation {
    pub registers: Vec<u32>,
    /// The next instruction; while it waits, the one that it waits at.
    pub at: u32,
    pub state: State,
    pub subgroup: u32,
    pub lane: u32,
}

/// Why an invocation stops.
pub enum Stop {
    Waits,
    Ends,
    Yields,
}

/// A fault at an instruction.
pub enum Trouble {
    Memory(Space, Fault),
    DividesByZero,
    Unreachable,
    Endless,
}

/// An invocation's turn.
pub struct Turn<'t, 'a> {
    pub module: &'a Module,
    pub memory: &'t mut Memory<'a>,
    pub who: Accessor,
    /// Accesses to memory until others go on; 0 for no limit.
    pub accesses: u32,
    pub instructions: &'t mut u64,
    /// Most instructions.
    pub limit: u64,
}

/// Where an address is.
fn resolve(registers: &[u32], address: Address) -> Result<u32, Trouble> {
    let Address { space, reg, fixed } = address;
    if reg == NONE {
        return Ok(fixed);
    }
    match registers[reg as usize] {
        NONE => {
            let index = registers[reg as usize + 1];
            Err(Trouble::Memory(space, Fault::Bounds { index }))
        }
        at => Ok(at.wrapping_add(fixed)),
    }
}

impl Turn<'_, '_> {
    /// Runs until the invocation stops.
    pub fn run(&mut self, invocation: &mut Invocation) -> Result<Stop, Trouble> {
        let (module, registers) = (self.module, &mut invocation.registers);
        let mut count = 0;
        let most = self.limit - *self.instructions;
        let stopped = loop {
            let instruction = &module.code[invocation.at as usize];
            count += 1;
            match *instruction {
                Instruction::One { op, to, a } => {
                    registers[to as usize] = one(op, registers[a as usize]);
                }
                Instruction::Two { op, to, a, b } => {
                    let (a, b) = (registers[a as usize], registers[b as usize]);
                    match two(op, a, b) {
                        Some(result) => registers[to as usize] = result,
                        None => break Err(Trouble::DividesByZero),
                    }
                }
                Instruction::Fma { to, a, b, c } => {
                    let [a, b, c] = [a, b, c].map(|reg| registers[reg as usize]);
                    registers[to as usize] = fma(a, b, c);
                }
                Instruction::Select { to, condition, a, b } => {
                    let from = if registers[condition as usize] != 0 { a } else { b };
                    registers[to as usize] = registers[from as usize];
                }
                Instruction::Copy { to, from, words } => {
                    registers.copy_within(from as usize..(from + words) as usize, to as usize);
                }
                Instruction::Jump(_) | Instruction::Fork { .. } | Instruction::Switch { .. } => {
                    invocation.at = next_block(module, instruction, registers);
                    if count >= most {
                        break Err(Trouble::Endless);
                    }
                    continue;
                }
                Instruction::Collective { .. } | Instruction::Barrier(_) => break Ok(Stop::Waits),
                Instruction::Return => break Ok(Stop::Ends),
                Instruction::Unreachable => break Err(Trouble::Unreachable),
                _ => {
                    if let Err(trouble) = self.access(instruction, registers) {
                        break Err(trouble);
                    }
                    invocation.at += 1;
                    if self.is_over(instruction) {
                        break Ok(Stop::Yields);
                    }
                    continue;
                }
            }
            invocation.at += 1;
        };
        *self.instructions += count;
        stopped
    }

    /// Whether others go on after an access to memory.
    fn is_over(&mut self, instruction: &Instruction) -> bool {
        let space = match instruction {
            Instruction::Load { from, .. } => from.space,
            Instruction::Store { to, .. } => to.space,
            Instruction::Atomic { at, .. } => at.space,
            _ => return false,
        };
        if self.accesses == 0 || matches!(space, Space::Own | Space::Push) {
            return false;
        }
        self.accesses -= 1;
        self.accesses == 0
    }

    /// An instruction on addresses.
    fn access(&mut self, instruction: &Instruction, registers: &mut [u32]) -> Result<(), Trouble> {
        let trouble = |space| move |fault| Trouble::Memory(space, fault);
        match *instruction {
            Instruction::Locate { to, from, first, end } => {
                self.locate(to, from, first as usize..end as usize, registers);
            }
            Instruction::Length { to, binding, at, stride } => {
                let length = self.memory.length(Space::Storage(binding));
                registers[to as usize] = length.saturating_sub(at) / stride.max(1);
            }
            Instruction::Load { to, from, words } => {
                let (at, space) = (resolve(registers, from)?, from.space);
                if space == Space::Own {
                    registers.copy_within(at as usize..(at + words) as usize, to as usize);
                    return Ok(());
                }
                let to = &mut registers[to as usize..(to + words) as usize];
                self.memory.load(&self.who, space, at, to).map_err(trouble(space))?;
            }
            Instruction::Store { to, from, words } => {
                let (at, space) = (resolve(registers, to)?, to.space);
                let from = from as usize..(from + words) as usize;
                if space == Space::Own {
                    registers.copy_within(from, at as usize);
                    return Ok(());
                }
                let from = &registers[from];
                self.memory.store(&self.who, space, at, from).map_err(trouble(space))?;
            }
            Instruction::Atomic { op, to, at, value } => {
                let (space, value) = (at.space, registers[value as usize]);
                let at = resolve(registers, at)?;
                let before = self.memory.atomic(&self.who, space, at, op, value);
                registers[to as usize] = before.map_err(trouble(space))?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Evaluates an access chain.
    fn locate(&self, to: Reg, from: Address, terms: std::ops::Range<usize>, registers: &mut [u32]) {
        let found = match resolve(registers, from) {
            Ok(first) => terms.clone().try_fold(first, |at, term| {
                let term = &self.module.terms[term];
                let index = registers[term.index as usize];
                let rest =
                    || self.memory.length(from.space).saturating_sub(at) / term.stride.max(1);
                let inside = index < term.count.unwrap_or_else(rest);
                if inside { Ok(at + index * term.stride) } else { Err(index) }
            }),
            Err(_) => Err(registers[from.reg as usize + 1]),
        };
        match found {
            Ok(at) => registers[to as usize] = at,
            Err(index) => {
                registers[to as usize] = NONE;
                registers[to as usize + 1] = index;
            }
        }
    }
}

/// Where a branch leads. Sets the phis there.
fn next_block(module: &Module, branch: &Instruction, registers: &mut [u32]) -> u32 {
    let edge = match *branch {
        Instruction::Jump(edge) => edge,
        Instruction::Fork { condition, yes, .. } if registers[condition as usize] != 0 => yes,
        Instruction::Fork { no, .. } => no,
        Instruction::Switch { selector, first, end, default } => {
            let cases = &module.cases[first as usize..end as usize];
            let selector = registers[selector as usize];
            let case = cases.iter().find(|(literal, _)| *literal == selector);
            case.map_or(default, |(_, edge)| *edge)
        }
        _ => unreachable!("only branches lead to blocks"),
    };
    let edge = &module.edges[edge as usize];
    for (to, from) in &module.moves[edge.first as usize..edge.end as usize] {
        registers[*to as usize] = registers[*from as usize];
    }
    edge.target
}
