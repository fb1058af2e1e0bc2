//! From SPIR-V words to the emulator's instructions. Declarations come first, then the one function.

mod declarations;
mod decoder;
mod instructions;
mod pointers;

use std::collections::HashMap;

use crate::error::Error;
use crate::ops;
use crate::program::{EdgeMoves, Instruction, Module, Reg};
use decoder::{Decoder, Raw};

const MAGIC: u32 = 0x0723_0203;

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

impl Module {
    /// Reads a module with one entry point.
    pub fn new(spirv: &[u8]) -> Result<Module, Error> {
        let words = words_of(spirv);
        if words.first() != Some(&MAGIC) || words.len() < 5 || !spirv.len().is_multiple_of(4) {
            return Err(Error::Malformed("it does not begin as one".into()));
        }
        let mut decoder =
            Decoder { module: Module { size: [1; 3], ..Module::default() }, ..Decoder::default() };
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
}

impl Decoder {
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
