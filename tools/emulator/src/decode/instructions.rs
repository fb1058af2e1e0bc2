//! Instructions of the function.

use crate::error::Error;
use crate::layout::Id;
use crate::ops;
use crate::program::{Atomic, Barrier, Collective, Instruction, Part, Reg};
use crate::values::{One, Two};

use super::decoder::{Decoder, Phi, Raw, Value};

/// Scopes.
const WORKGROUP: u32 = 2;
const SUBGROUP: u32 = 3;

/// Bits of memory semantics.
const ACQUIRES_AND_RELEASES: u32 = 0x8;
const MAKES_AVAILABLE: u32 = 0x2000;
const MAKES_VISIBLE: u32 = 0x4000;
const OF_STORAGE: u32 = 0x40;
const OF_WORKGROUP: u32 = 0x100;

fn one_of(op: u16) -> Option<One> {
    Some(match op {
        ops::Bitcast => One::Same,
        ops::FNegate => One::FNegate,
        ops::SNegate => One::SNegate,
        ops::Not => One::Not,
        ops::LogicalNot => One::LogicalNot,
        ops::BitCount => One::BitCount,
        ops::ConvertFToU => One::FToU,
        ops::ConvertFToS => One::FToS,
        ops::ConvertUToF => One::UToF,
        ops::ConvertSToF => One::SToF,
        _ => return None,
    })
}

/// An operation on two words, and whether its operands change places.
fn two_of(op: u16) -> Option<(Two, bool)> {
    let two = match op {
        ops::IAdd => Two::IAdd,
        ops::ISub => Two::ISub,
        ops::IMul => Two::IMul,
        ops::UDiv => Two::UDiv,
        ops::UMod => Two::UMod,
        ops::BitwiseAnd | ops::LogicalAnd => Two::And,
        ops::BitwiseOr | ops::LogicalOr => Two::Or,
        ops::BitwiseXor => Two::Xor,
        ops::ShiftLeftLogical => Two::ShiftLeft,
        ops::ShiftRightLogical => Two::ShiftRight,
        ops::ShiftRightArithmetic => Two::ShiftRightSigned,
        ops::IEqual | ops::LogicalEqual => Two::IEqual,
        ops::INotEqual | ops::LogicalNotEqual => Two::INotEqual,
        ops::ULessThan | ops::UGreaterThan => Two::ULess,
        ops::ULessThanEqual | ops::UGreaterThanEqual => Two::ULessEqual,
        ops::SLessThan | ops::SGreaterThan => Two::SLess,
        ops::SLessThanEqual | ops::SGreaterThanEqual => Two::SLessEqual,
        ops::FAdd => Two::FAdd,
        ops::FSub => Two::FSub,
        ops::FMul => Two::FMul,
        ops::FDiv => Two::FDiv,
        ops::FOrdEqual => Two::FEqual,
        ops::FOrdNotEqual => Two::FNotEqual,
        ops::FUnordEqual => Two::UnorderedEqual,
        ops::FUnordNotEqual => Two::UnorderedNotEqual,
        ops::FOrdLessThan | ops::FOrdGreaterThan => Two::FLess,
        ops::FOrdLessThanEqual | ops::FOrdGreaterThanEqual => Two::FLessEqual,
        ops::FUnordLessThan | ops::FUnordGreaterThan => Two::UnorderedLess,
        ops::FUnordLessThanEqual | ops::FUnordGreaterThanEqual => Two::UnorderedLessEqual,
        _ => return None,
    };
    let swapped = matches!(
        op,
        ops::UGreaterThan
            | ops::UGreaterThanEqual
            | ops::SGreaterThan
            | ops::SGreaterThanEqual
            | ops::FOrdGreaterThan
            | ops::FOrdGreaterThanEqual
            | ops::FUnordGreaterThan
            | ops::FUnordGreaterThanEqual
    );
    Some((two, swapped))
}

fn one_of_glsl(number: u32) -> Option<One> {
    Some(match number {
        4 => One::FAbs,
        8 => One::Floor,
        9 => One::Ceil,
        13 => One::Sin,
        14 => One::Cos,
        27 => One::Exp,
        28 => One::Log,
        29 => One::Exp2,
        31 => One::Sqrt,
        75 => One::FindUMsb,
        _ => return None,
    })
}

impl Decoder {
    pub(super) fn instruction(&mut self, raw: &Raw) -> Result<(), Error> {
        if let Some(op) = one_of(raw.op) {
            return self.each(raw, [2], |to, [a]| Instruction::One { op, to, a });
        }
        if let Some((op, swapped)) = two_of(raw.op) {
            let operands = if swapped { [3, 2] } else { [2, 3] };
            return self.each(raw, operands, |to, [a, b]| Instruction::Two { op, to, a, b });
        }
        match raw.op {
            // Names and lines.
            _ if raw.op < ops::ExtInst && raw.op != ops::Undef => Ok(()),
            ops::LoopMerge | ops::SelectionMerge => Ok(()),
            ops::Undef => self.constant(raw),
            ops::Variable => self.variable(raw),
            ops::ExtInst => self.extended(raw),
            ops::Load => self.load(raw),
            ops::Store => self.store(raw),
            ops::CopyMemory => self.copy_memory(raw),
            ops::AccessChain | ops::InBoundsAccessChain => self.access_chain(raw),
            ops::ArrayLength => self.array_length(raw),
            ops::AtomicIAdd => self.atomic(raw, Atomic::Add),
            ops::AtomicUMax => self.atomic(raw, Atomic::Max),
            ops::CompositeConstruct | ops::CompositeExtract | ops::CompositeInsert => {
                self.composite(raw)
            }
            ops::Select => self.select(raw),
            ops::ControlBarrier => self.barrier(raw),
            ops::Label => self.label(raw),
            ops::Phi => self.phi(raw),
            ops::Branch | ops::BranchConditional | ops::Switch => self.branch(raw),
            ops::Return => {
                self.push(raw, Instruction::Return);
                Ok(())
            }
            ops::Unreachable => {
                self.push(raw, Instruction::Unreachable);
                Ok(())
            }
            ops::GroupNonUniformAll..=ops::GroupNonUniformFAdd => self.collective(raw),
            _ => Err(self.unknown_instruction(raw)),
        }
    }

    /// An instruction for each word of the result, from the same words of these operands.
    fn each<const N: usize>(
        &mut self,
        raw: &Raw,
        operands: [usize; N],
        make: impl Fn(Reg, [Reg; N]) -> Instruction,
    ) -> Result<(), Error> {
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        let words = self.types.words(ty)?;
        let mut from = [0; N];
        for (from, operand) in from.iter_mut().zip(operands) {
            *from = self.value_of(raw.operand(operand)?, words)?;
        }
        let to = self.define(id, ty)?;
        for k in 0..words {
            self.push(raw, make(to + k, from.map(|from| from + k)));
        }
        Ok(())
    }

    fn extended(&mut self, raw: &Raw) -> Result<(), Error> {
        let (set, number) = (raw.operand(2)?, raw.operand(3)?);
        match (number, one_of_glsl(number)) {
            _ if Some(set) != self.glsl => Err(self.unknown_instruction(raw)),
            (_, Some(op)) => self.each(raw, [4], |to, [a]| Instruction::One { op, to, a }),
            (37 | 40, _) => {
                let op = if number == 37 { Two::FMin } else { Two::FMax };
                self.each(raw, [4, 5], |to, [a, b]| Instruction::Two { op, to, a, b })
            }
            (50, _) => self.each(raw, [4, 5, 6], |to, [a, b, c]| Instruction::Fma { to, a, b, c }),
            _ => Err(self.unknown(format!("GLSL.std.450 instruction {number}"))),
        }
    }

    fn copy(&mut self, raw: &Raw, to: Reg, from: Value) -> Result<u32, Error> {
        let words = self.types.words(from.ty)?;
        self.push(raw, Instruction::Copy { to, from: from.reg, words });
        Ok(words)
    }

    /// Part of a value.
    fn part(&self, of: Value, indices: &[u32]) -> Result<Value, Error> {
        indices.iter().try_fold(of, |of, index| {
            let part = self.types.register_part(of.ty, *index)?;
            Ok(Value { reg: of.reg + part.at, ty: part.ty })
        })
    }

    fn composite(&mut self, raw: &Raw) -> Result<(), Error> {
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        match raw.op {
            ops::CompositeExtract => {
                // Its registers are part of the whole's: no use of it comes after the whole is computed again.
                let part = self.part(self.value(raw.operand(2)?)?, raw.rest(3))?;
                self.values.insert(id, part);
            }
            ops::CompositeInsert => {
                let (part, whole) = (self.value(raw.operand(2)?)?, self.value(raw.operand(3)?)?);
                self.value_of(raw.operand(3)?, self.types.words(ty)?)?;
                let reg = self.define(id, ty)?;
                self.copy(raw, reg, whole)?;
                let to = self.part(Value { reg, ty }, raw.rest(4))?;
                self.value_of(raw.operand(2)?, self.types.words(to.ty)?)?;
                self.copy(raw, to.reg, part)?;
            }
            _ => {
                let parts = self.parts(raw)?;
                let mut to = self.define(id, ty)?;
                for part in parts {
                    to += self.copy(raw, to, part)?;
                }
            }
        }
        Ok(())
    }

    fn select(&mut self, raw: &Raw) -> Result<(), Error> {
        let condition = self.value(raw.operand(2)?)?;
        let step = match self.types.words(condition.ty)? {
            1 => 0,
            words => {
                self.value_of(raw.operand(3)?, words)?;
                1
            }
        };
        let first = self.module.registers.len() as Reg;
        self.each(raw, [3, 4], |to, [a, b]| {
            let condition = condition.reg + step * (to - first);
            Instruction::Select { to, condition, a, b }
        })
    }

    /// A constant operand.
    fn constant_of(&self, id: Id) -> Result<u32, Error> {
        self.constants.get(&id).copied().ok_or_else(|| self.unknown("operand that is no constant"))
    }

    fn barrier(&mut self, raw: &Raw) -> Result<(), Error> {
        let [execution, memory, semantics] = [0, 1, 2].map(|at| raw.operand(at));
        let execution = self.constant_of(execution?)?;
        let (memory, semantics) = (self.constant_of(memory?)?, self.constant_of(semantics?)?);
        if !matches!(execution, WORKGROUP | SUBGROUP) || memory > execution {
            return Err(self.unknown(format!("barrier of scopes {execution}, {memory}")));
        }
        let needed = ACQUIRES_AND_RELEASES | MAKES_AVAILABLE | MAKES_VISIBLE;
        let orders = semantics & needed == needed;
        self.push(
            raw,
            Instruction::Barrier(Barrier {
                of_subgroup: execution == SUBGROUP,
                shared: orders && semantics & OF_WORKGROUP != 0,
                storage: orders && semantics & OF_STORAGE != 0,
            }),
        );
        Ok(())
    }

    fn collective(&mut self, raw: &Raw) -> Result<(), Error> {
        if self.constant_of(raw.operand(2)?)? != SUBGROUP {
            return Err(self.unknown("scope of a subgroup operation"));
        }
        let part = |at: usize| match raw.operand(at)? {
            0 => Ok(Part::All),
            1 => Ok(Part::UpToThis),
            2 => Ok(Part::BeforeThis),
            other => Err(self.unknown(format!("group operation {other}"))),
        };
        let (op, a) = match raw.op {
            ops::GroupNonUniformAll => (Collective::All, 3),
            ops::GroupNonUniformAny => (Collective::Any, 3),
            ops::GroupNonUniformBallot => (Collective::Ballot, 3),
            ops::GroupNonUniformShuffle | ops::GroupNonUniformBroadcast => (Collective::Shuffle, 3),
            ops::GroupNonUniformIAdd => (Collective::IntegerSum(part(3)?), 4),
            ops::GroupNonUniformFAdd => (Collective::FloatSum(part(3)?), 4),
            _ => return Err(self.unknown_instruction(raw)),
        };
        let a = self.value_of(raw.operand(a)?, 1)?;
        let b = if op == Collective::Shuffle { self.value_of(raw.operand(4)?, 1)? } else { 0 };
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        let words = self.types.words(ty)?;
        if words != op.words() {
            return Err(self.unknown(format!("{} of {words} words", ops::name(raw.op))));
        }
        let to = self.define(id, ty)?;
        self.push(raw, Instruction::Collective { op, to, a, b });
        Ok(())
    }

    fn label(&mut self, raw: &Raw) -> Result<(), Error> {
        self.block = raw.operand(0)?;
        self.blocks.insert(self.block, self.module.code.len() as u32);
        Ok(())
    }

    fn phi(&mut self, raw: &Raw) -> Result<(), Error> {
        let ty = raw.operand(0)?;
        let reg = self.define(raw.operand(1)?, ty)?;
        let from = raw.rest(2).as_chunks::<2>().0.iter().map(|[id, block]| (*id, *block));
        let phi = Phi { to: Value { reg, ty }, from: from.collect() };
        self.phis.entry(self.block).or_default().push(phi);
        Ok(())
    }

    fn branch(&mut self, raw: &Raw) -> Result<(), Error> {
        let instruction = match raw.op {
            ops::Branch => Instruction::Jump(self.edge(raw.operand(0)?)),
            ops::BranchConditional => {
                let condition = self.value_of(raw.operand(0)?, 1)?;
                let [yes, no] = [raw.operand(1)?, raw.operand(2)?].map(|target| self.edge(target));
                Instruction::Fork { condition, yes, no }
            }
            _ => {
                let selector = self.value_of(raw.operand(0)?, 1)?;
                let default = self.edge(raw.operand(1)?);
                let first = self.module.cases.len() as u32;
                for [literal, target] in raw.rest(2).as_chunks::<2>().0 {
                    let edge = self.edge(*target);
                    self.module.cases.push((*literal, edge));
                }
                let end = self.module.cases.len() as u32;
                Instruction::Switch { selector, first, end, default }
            }
        };
        self.push(raw, instruction);
        Ok(())
    }
}
