//! Instructions on addresses: access chains, loads, stores, atomics.

use crate::error::Error;
use crate::layout::{Id, Type};
use crate::program::{Address, Atomic, Instruction, NONE, Reg, Space, Term};

use super::decoder::{Decoder, Pointer, Raw};

/// The address `words` further on.
fn beyond(address: Address, words: u32) -> Address {
    Address { fixed: address.fixed + words, ..address }
}

/// The words of a value that follow each other in memory: their first, from the value's first in memory and in
/// registers, and their number.
fn runs(places: &[u32]) -> Vec<(u32, u32, u32)> {
    let mut runs: Vec<(u32, u32, u32)> = Vec::new();
    for (k, place) in (0..).zip(places) {
        match runs.last_mut() {
            Some((first, _, count)) if *first + *count == *place => *count += 1,
            _ => runs.push((*place, k, 1)),
        }
    }
    runs
}

impl Decoder {
    fn pointer(&self, id: Id) -> Result<Pointer, Error> {
        let pointer = self.pointers.get(&id).copied();
        pointer.ok_or_else(|| self.unknown(format!("pointer %{id}")))
    }

    pub(super) fn access_chain(&mut self, raw: &Raw) -> Result<(), Error> {
        let (id, base) = (raw.operand(1)?, raw.operand(2)?);
        let Pointer { mut address, mut to } = self.pointer(base)?;
        let (mut from, first) = (address, self.module.terms.len() as u32);
        for index in raw.rest(3) {
            let known = self.constants.get(index).copied();
            let (of, count) = match self.types.get(to)? {
                Type::Struct { .. } => {
                    let index = known.ok_or_else(|| self.unknown("index of a structure"))?;
                    let part = self.types.memory_part(to, index)?;
                    address = beyond(address, part.at);
                    to = part.ty;
                    continue;
                }
                Type::Vector { of, count } | Type::Array { of, count } => (*of, Some(*count)),
                Type::RuntimeArray { of } => (*of, None),
                _ => return Err(Error::Malformed(format!("%{to} has no parts"))),
            };
            let stride = self.types.stride(to)?;
            match (known, count) {
                (Some(index), Some(count)) if index < count => {
                    address = beyond(address, index * stride);
                }
                // An array at the end of a buffer: the access is checked against the buffer.
                (Some(index), None) if index < 1 << 10 => address = beyond(address, index * stride),
                _ => {
                    // An array that ends with its buffer comes first; its elements are counted from here.
                    if self.module.terms.len() as u32 == first {
                        from = address;
                    }
                    let index = self.value(*index)?.reg;
                    self.module.terms.push(Term { index, stride, count });
                }
            }
            to = of;
        }
        let end = self.module.terms.len() as u32;
        if end > first {
            let reg = self.registers(2);
            self.push(raw, Instruction::Locate { to: reg, from, first, end });
            address = Address { reg, fixed: address.fixed - from.fixed, ..address };
        }
        self.pointers.insert(id, Pointer { address, to });
        Ok(())
    }

    pub(super) fn array_length(&mut self, raw: &Raw) -> Result<(), Error> {
        let Pointer { address, to } = self.pointer(raw.operand(2)?)?;
        let part = self.types.memory_part(to, raw.operand(3)?)?;
        let stride = self.types.stride(part.ty)?;
        let (Space::Storage(binding), NONE) = (address.space, address.reg) else {
            return Err(self.unknown("array's length"));
        };
        let to = self.define_word(raw)?;
        let at = address.fixed + part.at;
        self.push(raw, Instruction::Length { to, binding, at, stride });
        Ok(())
    }

    fn load_to(&mut self, raw: &Raw, to: Reg, from: &Pointer) -> Result<(), Error> {
        for (place, k, words) in runs(&self.types.places(from.to)?) {
            let from = beyond(from.address, place);
            self.push(raw, Instruction::Load { to: to + k, from, words });
        }
        Ok(())
    }

    fn store_from(&mut self, raw: &Raw, to: &Pointer, from: Reg) -> Result<(), Error> {
        for (place, k, words) in runs(&self.types.places(to.to)?) {
            let to = beyond(to.address, place);
            self.push(raw, Instruction::Store { to, from: from + k, words });
        }
        Ok(())
    }

    /// Refuses an access to memory that invocations share, if it is marked as private: no barrier would order it.
    /// `operand`: the place of the instruction's memory operands.
    fn seen_by_others(&self, raw: &Raw, pointer: &Pointer, operand: usize) -> Result<(), Error> {
        const NON_PRIVATE: u32 = 0x20;
        let is_shared = matches!(pointer.address.space, Space::Shared | Space::Storage(_));
        if is_shared && raw.operand(operand).unwrap_or(0) & NON_PRIVATE == 0 {
            let (entry, word) = (self.module.entry.clone(), raw.word);
            return Err(Error::Private { entry, word });
        }
        Ok(())
    }

    pub(super) fn load(&mut self, raw: &Raw) -> Result<(), Error> {
        let from = self.pointer(raw.operand(2)?)?;
        self.seen_by_others(raw, &from, 3)?;
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        if self.types.words(ty)? != self.types.words(from.to)? {
            return Err(self.unknown(format!("load of another type as %{id}")));
        }
        let to = self.define(id, ty)?;
        self.load_to(raw, to, &from)
    }

    pub(super) fn store(&mut self, raw: &Raw) -> Result<(), Error> {
        let to = self.pointer(raw.operand(0)?)?;
        self.seen_by_others(raw, &to, 2)?;
        let from = self.value_of(raw.operand(1)?, self.types.words(to.to)?)?;
        self.store_from(raw, &to, from)
    }

    /// Copies what a pointer points to.
    pub(super) fn copy_memory(&mut self, raw: &Raw) -> Result<(), Error> {
        let (to, from) = (self.pointer(raw.operand(0)?)?, self.pointer(raw.operand(1)?)?);
        self.seen_by_others(raw, &to, 2)?;
        self.seen_by_others(raw, &from, if raw.operand(3).is_ok() { 3 } else { 2 })?;
        let words = self.types.words(from.to)?;
        if words != self.types.words(to.to)? {
            return Err(self.unknown_instruction(raw));
        }
        let between = self.registers(words);
        self.load_to(raw, between, &from)?;
        self.store_from(raw, &to, between)
    }

    pub(super) fn atomic(&mut self, raw: &Raw, op: Atomic) -> Result<(), Error> {
        let at = self.pointer(raw.operand(2)?)?.address;
        let value = self.value_of(raw.operand(5)?, 1)?;
        let to = self.define_word(raw)?;
        self.push(raw, Instruction::Atomic { op, to, at, value });
        Ok(())
    }
}
