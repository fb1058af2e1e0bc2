//! From SPIR-V words to the emulator's instructions. Declarations come first, then the one function.

mod declarations;
mod instructions;
mod pointers;

use std::collections::HashMap;

use crate::error::Error;
use crate::layout::{Id, Types};
use crate::ops;
use crate::program::{Address, Edge, EdgeMoves, Instruction, Module, Reg};

const MAGIC: u32 = 0x0723_0203;

/// An instruction of the module.
#[derive(Clone, Copy)]
struct Raw<'a> {
    op: u16,
    /// Its first word in the module.
    word: u32,
    operands: &'a [u32],
}

impl Raw<'_> {
    fn operand(&self, at: usize) -> Result<u32, Error> {
        self.operands.get(at).copied().ok_or_else(|| {
            Error::Malformed(format!("{} at word {} is cut", ops::name(self.op), self.word))
        })
    }

    /// Operands from a place on.
    fn rest(&self, from: usize) -> &[u32] {
        self.operands.get(from..).unwrap_or(&[])
    }
}

/// Where a value is: its first register, and its type.
#[derive(Clone, Copy)]
struct Value {
    reg: Reg,
    ty: Id,
}

/// What a pointer points to, as far as the module tells.
#[derive(Clone, Copy)]
struct Pointer {
    address: Address,
    to: Id,
}

/// A phi: its registers, and the value that comes from each block.
struct Phi {
    to: Value,
    from: Vec<(Id, Id)>,
}

struct Decoder {
    module: Module,
    types: Types,
    values: HashMap<Id, Value>,
    pointers: HashMap<Id, Pointer>,
    /// Constants of one word, but not those of specialisation.
    constants: HashMap<Id, u32>,
    /// Bindings, specialisation constants and inputs, by the numbers of their decorations.
    decorations: HashMap<(Id, u32), u32>,
    glsl: Option<Id>,
    /// The block that is decoded, and where each begins.
    block: Id,
    blocks: HashMap<Id, u32>,
    phis: HashMap<Id, Vec<Phi>>,
    /// Edges by the blocks that they connect.
    ways: Vec<(Id, Id)>,
    in_function: bool,
}

fn words_of(spirv: &[u8]) -> Vec<u32> {
    spirv.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect()
}

/// A module without its control barrier number `nth`, if it has so many: tests hold that a barrier is missed.
pub fn without_barrier(spirv: &[u8], nth: usize) -> Option<Vec<u8>> {
    let words = words_of(spirv);
    let (mut at, mut seen) = (5, 0);
    while at < words.len() {
        let end = at + (words[at] >> 16).max(1) as usize;
        if words[at] as u16 == ops::ControlBarrier {
            if seen == nth {
                return Some([&spirv[..4 * at], spirv.get(4 * end..)?].concat());
            }
            seen += 1;
        }
        at = end;
    }
    None
}

/// Reads a module.
pub fn module(spirv: &[u8]) -> Result<Module, Error> {
    let words = words_of(spirv);
    if words.first() != Some(&MAGIC) || words.len() < 5 || !spirv.len().is_multiple_of(4) {
        return Err(Error::Malformed("it does not begin as one".into()));
    }
    let mut decoder = Decoder::new();
    let mut at = 5;
    while at < words.len() {
        let (op, count) = (words[at] as u16, (words[at] >> 16) as usize);
        let operands = words.get(at + 1..at + count.max(1));
        let (Some(operands), true) = (operands, count > 0) else {
            return Err(Error::Malformed(format!("word {at} begins no instruction")));
        };
        decoder.decode(&Raw { op, word: at as u32, operands })?;
        at += count;
    }
    decoder.finish()
}

impl Decoder {
    fn new() -> Decoder {
        let module = Module {
            entry: String::new(),
            size: [1; 3],
            code: Vec::new(),
            origins: Vec::new(),
            terms: Vec::new(),
            edges: Vec::new(),
            moves: Vec::new(),
            cases: Vec::new(),
            registers: Vec::new(),
            undefined: Vec::new(),
            first_values: Vec::new(),
            constants: Vec::new(),
            inputs: Vec::new(),
            shared_words: 0,
            bindings: 0,
        };
        Decoder {
            module,
            types: Types::default(),
            values: HashMap::new(),
            pointers: HashMap::new(),
            constants: HashMap::new(),
            decorations: HashMap::new(),
            glsl: None,
            block: 0,
            blocks: HashMap::new(),
            phis: HashMap::new(),
            ways: Vec::new(),
            in_function: false,
        }
    }

    fn decode(&mut self, raw: &Raw) -> Result<(), Error> {
        match raw.op {
            // What has no other end ends here.
            ops::FunctionEnd => {
                self.push(raw, Instruction::Unreachable);
                Ok(())
            }
            ops::Function if self.in_function => Err(self.unknown("second function")),
            ops::Function => {
                self.in_function = true;
                Ok(())
            }
            _ if self.in_function => self.instruction(raw),
            _ => self.declaration(raw),
        }
    }

    fn unknown(&self, what: impl Into<String>) -> Error {
        Error::Unknown { what: what.into(), entry: self.module.entry.clone() }
    }

    fn unknown_instruction(&self, raw: &Raw) -> Error {
        self.unknown(ops::name(raw.op))
    }

    /// Registers for a new value.
    fn registers(&mut self, words: u32) -> Reg {
        let first = self.module.registers.len() as Reg;
        self.module.registers.resize((first + words) as usize, 0);
        first
    }

    /// Registers for the value `id`.
    fn define(&mut self, id: Id, ty: Id) -> Result<Reg, Error> {
        let words = self.types.words(ty)?;
        let reg = self.registers(words);
        self.values.insert(id, Value { reg, ty });
        Ok(reg)
    }

    fn value(&self, id: Id) -> Result<Value, Error> {
        let value = self.values.get(&id).copied();
        value.ok_or_else(|| self.unknown(format!("use of %{id} before its definition")))
    }

    /// A value that must have so many words.
    fn value_of(&self, id: Id, words: u32) -> Result<Reg, Error> {
        let value = self.value(id)?;
        if self.types.words(value.ty)? != words {
            return Err(self.unknown(format!("use of %{id} as {words} words")));
        }
        Ok(value.reg)
    }

    /// A register for the result of an instruction that has one word.
    fn define_word(&mut self, raw: &Raw) -> Result<Reg, Error> {
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        match self.types.words(ty)? {
            1 => self.define(id, ty),
            words => Err(self.unknown(format!("{} of {words} words", ops::name(raw.op)))),
        }
    }

    fn push(&mut self, raw: &Raw, instruction: Instruction) {
        self.module.code.push(instruction);
        self.module.origins.push((raw.op, raw.word));
    }

    /// The way from this block to another.
    fn edge(&mut self, target: Id) -> Edge {
        self.ways.push((self.block, target));
        self.ways.len() as Edge - 1
    }

    /// Resolves the edges: all blocks and phis are known now.
    fn finish(mut self) -> Result<Module, Error> {
        for (from, to) in std::mem::take(&mut self.ways) {
            let target =
                *self.blocks.get(&to).ok_or_else(|| self.unknown(format!("block %{to}")))?;
            let first = self.module.moves.len() as u32;
            let mut moves = Vec::new();
            for phi in self.phis.get(&to).into_iter().flatten() {
                let source = phi.from.iter().find(|(_, block)| *block == from);
                let (id, _) = source.ok_or_else(|| self.unknown(format!("way to block %{to}")))?;
                let words = self.types.words(phi.to.ty)?;
                let reg = self.value_of(*id, words)?;
                moves.extend((0..words).map(|k| (phi.to.reg + k, reg + k)));
            }
            self.sequence(moves);
            let end = self.module.moves.len() as u32;
            self.module.edges.push(EdgeMoves { target, first, end });
        }
        if self.module.code.is_empty() {
            return Err(Error::Malformed("it has no function".into()));
        }
        Ok(self.module)
    }

    /// Appends moves that happen at once, as moves one after the other. Those whose source would be overwritten go by
    /// registers of their own.
    fn sequence(&mut self, moves: Vec<(Reg, Reg)>) {
        let written = |reg: Reg| moves.iter().any(|(to, from)| *to == reg && to != from);
        let kept: Vec<Reg> = moves.iter().map(|m| m.1).filter(|from| written(*from)).collect();
        let mut copies = HashMap::new();
        for from in kept {
            let copy = self.registers(1);
            copies.insert(from, copy);
            self.module.moves.push((copy, from));
        }
        for (to, from) in moves {
            self.module.moves.push((to, *copies.get(&from).unwrap_or(&from)));
        }
    }
}
