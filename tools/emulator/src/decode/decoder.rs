//! What is known of a module while it is decoded.

use std::collections::HashMap;

use crate::error::Error;
use crate::layout::{Id, Types};
use crate::ops;
use crate::program::{Address, Edge, Instruction, Module, Reg};

/// An instruction of the module.
#[derive(Clone, Copy)]
pub struct Raw<'a> {
    pub op: u16,
    /// Its first word in the module.
    pub word: u32,
    pub operands: &'a [u32],
}

impl Raw<'_> {
    pub fn operand(&self, at: usize) -> Result<u32, Error> {
        self.operands.get(at).copied().ok_or_else(|| {
            Error::Malformed(format!("{} at word {} is cut", ops::name(self.op), self.word))
        })
    }

    /// Operands from a place on.
    pub fn rest(&self, from: usize) -> &[u32] {
        self.operands.get(from..).unwrap_or(&[])
    }
}

/// Where a value is: its first register, and its type.
#[derive(Clone, Copy)]
pub struct Value {
    pub reg: Reg,
    pub ty: Id,
}

/// What a pointer points to, as far as the module tells.
#[derive(Clone, Copy)]
pub struct Pointer {
    pub address: Address,
    pub to: Id,
}

/// A phi: its registers, and the value that comes from each block.
pub struct Phi {
    pub to: Value,
    pub from: Vec<(Id, Id)>,
}

#[derive(Default)]
pub struct Decoder {
    pub module: Module,
    pub types: Types,
    pub values: HashMap<Id, Value>,
    pub pointers: HashMap<Id, Pointer>,
    /// Constants of one word, but not those of specialisation.
    pub constants: HashMap<Id, u32>,
    /// Bindings, specialisation constants and inputs, by the numbers of their decorations.
    pub decorations: HashMap<(Id, u32), u32>,
    pub glsl: Option<Id>,
    /// The block that is decoded, and where each begins.
    pub block: Id,
    pub blocks: HashMap<Id, u32>,
    pub phis: HashMap<Id, Vec<Phi>>,
    /// Edges by the blocks that they connect.
    pub ways: Vec<(Id, Id)>,
    pub in_function: bool,
}

impl Decoder {
    pub fn unknown(&self, what: impl Into<String>) -> Error {
        Error::Unknown { what: what.into(), entry: self.module.entry.clone() }
    }

    pub fn unknown_instruction(&self, raw: &Raw) -> Error {
        self.unknown(ops::name(raw.op))
    }

    /// Registers for a new value.
    pub fn registers(&mut self, words: u32) -> Reg {
        let first = self.module.registers.len() as Reg;
        self.module.registers.resize((first + words) as usize, 0);
        first
    }

    /// Registers for the value `id`.
    pub fn define(&mut self, id: Id, ty: Id) -> Result<Reg, Error> {
        let words = self.types.words(ty)?;
        let reg = self.registers(words);
        self.values.insert(id, Value { reg, ty });
        Ok(reg)
    }

    pub fn value(&self, id: Id) -> Result<Value, Error> {
        let value = self.values.get(&id).copied();
        value.ok_or_else(|| self.unknown(format!("use of %{id} before its definition")))
    }

    /// A value that must have so many words.
    pub fn value_of(&self, id: Id, words: u32) -> Result<Reg, Error> {
        let value = self.value(id)?;
        if self.types.words(value.ty)? != words {
            return Err(self.unknown(format!("use of %{id} as {words} words")));
        }
        Ok(value.reg)
    }

    /// A register for the result of an instruction that has one word.
    pub fn define_word(&mut self, raw: &Raw) -> Result<Reg, Error> {
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        match self.types.words(ty)? {
            1 => self.define(id, ty),
            words => Err(self.unknown(format!("{} of {words} words", ops::name(raw.op)))),
        }
    }

    pub fn push(&mut self, raw: &Raw, instruction: Instruction) {
        self.module.code.push(instruction);
        self.module.origins.push((raw.op, raw.word));
    }

    /// The way from this block to another.
    pub fn edge(&mut self, target: Id) -> Edge {
        self.ways.push((self.block, target));
        self.ways.len() as Edge - 1
    }

    /// The parts that a value is made of.
    pub fn parts(&self, raw: &Raw) -> Result<Vec<Value>, Error> {
        let parts: Vec<Value> =
            raw.rest(2).iter().map(|part| self.value(*part)).collect::<Result<_, _>>()?;
        let mut words = 0;
        for part in &parts {
            words += self.types.words(part.ty)?;
        }
        if words != self.types.words(raw.operand(0)?)? {
            return Err(self.unknown(format!("{} of {words} words", ops::name(raw.op))));
        }
        Ok(parts)
    }
}
