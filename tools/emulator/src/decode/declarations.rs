//! Declarations: types, constants, variables, the entry point.

use crate::error::Error;
use crate::layout::{Id, Type};
use crate::ops;
use crate::program::{Address, Input, NONE, Space};

use super::decoder::{Decoder, Pointer, Raw};

/// Decorations that matter.
const SPEC_ID: u32 = 1;
const ARRAY_STRIDE: u32 = 6;
const BUILT_IN: u32 = 11;
const BINDING: u32 = 33;
const DESCRIPTOR_SET: u32 = 34;
const OFFSET: u32 = 35;

/// Execution mode.
const LOCAL_SIZE: u32 = 17;

/// Storage classes.
const INPUT: u32 = 1;
const WORKGROUP: u32 = 4;
const PRIVATE: u32 = 6;
const FUNCTION: u32 = 7;
const PUSH_CONSTANT: u32 = 9;
const STORAGE_BUFFER: u32 = 12;

/// A text of a module: bytes up to the first zero.
fn text(words: &[u32]) -> String {
    let bytes = words.iter().flat_map(|word| word.to_le_bytes());
    String::from_utf8_lossy(&bytes.take_while(|byte| *byte != 0).collect::<Vec<u8>>()).into()
}

impl Decoder {
    pub(super) fn declaration(&mut self, raw: &Raw) -> Result<(), Error> {
        let operand = |at: usize| raw.operand(at);
        match raw.op {
            ops::EntryPoint if !self.module.entry.is_empty() => {
                return Err(self.unknown("second entry point"));
            }
            ops::EntryPoint => self.module.entry = text(raw.rest(2)),
            ops::ExecutionMode if operand(1)? == LOCAL_SIZE => {
                self.module.size = [operand(2)?, operand(3)?, operand(4)?];
            }
            ops::ExecutionMode => {}
            ops::ExtInstImport if text(raw.rest(1)) == "GLSL.std.450" => {
                self.glsl = Some(operand(0)?);
            }
            ops::Decorate => self.decorate(raw)?,
            ops::MemberDecorate if operand(2)? == OFFSET => {
                self.types.offsets.insert((operand(0)?, operand(1)?), operand(3)?);
            }
            ops::MemberDecorate => {}
            ops::TypeVoid..=ops::TypeFunction => self.declare_type(raw)?,
            ops::ConstantTrue..=ops::SpecConstant | ops::Undef => self.constant(raw)?,
            ops::Variable => self.variable(raw)?,
            // Names, lines, capabilities, extensions and the memory model tell nothing that is needed.
            op if op < ops::ExtInst || op == 14 || op == 17 => {}
            _ => return Err(self.unknown_instruction(raw)),
        }
        Ok(())
    }

    fn decorate(&mut self, raw: &Raw) -> Result<(), Error> {
        let (id, decoration) = (raw.operand(0)?, raw.operand(1)?);
        match decoration {
            ARRAY_STRIDE => {
                self.types.strides.insert(id, raw.operand(2)?);
            }
            SPEC_ID | BUILT_IN | BINDING | DESCRIPTOR_SET => {
                self.decorations.insert((id, decoration), raw.operand(2)?);
            }
            _ => {}
        }
        Ok(())
    }

    fn declare_type(&mut self, raw: &Raw) -> Result<(), Error> {
        let operand = |at: usize| raw.operand(at);
        let ty = match raw.op {
            ops::TypeVoid | ops::TypeFunction => Type::Void,
            ops::TypeBool => Type::Bool,
            ops::TypeInt | ops::TypeFloat if operand(1)? == 32 => Type::Word,
            ops::TypeVector => Type::Vector { of: operand(1)?, count: operand(2)? },
            ops::TypeArray => {
                let count = self.constants.get(&operand(2)?).copied();
                let count = count.ok_or_else(|| self.unknown("length of an array"))?;
                Type::Array { of: operand(1)?, count }
            }
            ops::TypeRuntimeArray => Type::RuntimeArray { of: operand(1)? },
            ops::TypeStruct => Type::Struct { members: raw.rest(1).to_vec() },
            ops::TypePointer => Type::Pointer { to: operand(2)? },
            ops::TypeInt | ops::TypeFloat => {
                return Err(self.unknown(format!("number of {} bits", operand(1)?)));
            }
            _ => return Err(self.unknown_instruction(raw)),
        };
        self.types.declare(operand(0)?, ty)
    }

    /// A constant, or an undefined value.
    pub(super) fn constant(&mut self, raw: &Raw) -> Result<(), Error> {
        let (ty, id) = (raw.operand(0)?, raw.operand(1)?);
        let words = self.types.words(ty)?;
        let is_word = matches!(raw.op, ops::ConstantTrue..=ops::Constant | ops::SpecConstant);
        if is_word && words != 1 {
            return Err(self.unknown(format!("constant of {words} words")));
        }
        let reg = self.define(id, ty)?;
        let mut set = |k: u32, word| self.module.registers[(reg + k) as usize] = word;
        match raw.op {
            ops::ConstantTrue => set(0, 1),
            ops::Constant | ops::SpecConstant => set(0, raw.operand(2)?),
            ops::ConstantFalse | ops::ConstantNull => {}
            ops::Undef => self.module.undefined.extend(reg..reg + words),
            ops::ConstantComposite => {
                let mut to = reg as usize;
                for part in self.parts(raw)? {
                    let (from, count) = (part.reg as usize, self.types.words(part.ty)? as usize);
                    self.module.registers.copy_within(from..from + count, to);
                    to += count;
                }
            }
            _ => return Err(self.unknown_instruction(raw)),
        }
        if raw.op == ops::SpecConstant {
            let number = self.decorations.get(&(id, SPEC_ID)).copied();
            self.module.constants.push((number.unwrap_or(u32::MAX), reg));
        } else if words == 1 && raw.op != ops::Undef {
            self.constants.insert(id, self.module.registers[reg as usize]);
        }
        Ok(())
    }

    /// A variable, of the module or of the function.
    pub(super) fn variable(&mut self, raw: &Raw) -> Result<(), Error> {
        let (ty, id, class) = (raw.operand(0)?, raw.operand(1)?, raw.operand(2)?);
        let Type::Pointer { to } = *self.types.get(ty)? else {
            return Err(Error::Malformed(format!("variable %{id} is no pointer")));
        };
        let first = raw.operands.get(3).copied();
        if first.is_some() && !matches!(class, FUNCTION | PRIVATE) {
            return Err(self.unknown("variable with a value of its own"));
        }
        let (space, fixed) = match class {
            INPUT => (Space::Own, self.input(id, to)?),
            FUNCTION | PRIVATE => {
                let words = self.types.extent(to)?;
                let reg = self.registers(words);
                self.module.undefined.extend(reg..reg + words);
                (Space::Own, reg)
            }
            WORKGROUP => {
                let fixed = self.module.shared_words;
                self.module.shared_words += self.types.extent(to)?;
                (Space::Shared, fixed)
            }
            PUSH_CONSTANT => (Space::Push, 0),
            STORAGE_BUFFER => {
                if self.decorations.get(&(id, DESCRIPTOR_SET)) != Some(&0) {
                    return Err(self.unknown("descriptor set"));
                }
                let binding = self.decorations.get(&(id, BINDING)).copied().unwrap_or(0);
                self.module.bindings = self.module.bindings.max(binding + 1);
                (Space::Storage(binding), 0)
            }
            _ => return Err(self.unknown(format!("storage class {class}"))),
        };
        let address = Address { space, reg: NONE, fixed };
        self.pointers.insert(id, Pointer { address, to });
        if let Some(first) = first {
            let from = self.value_of(first, self.types.words(to)?)?;
            let places = self.types.places(to)?;
            self.module.first_values.extend((from..).zip(places).map(|(k, to)| (fixed + to, k)));
        }
        Ok(())
    }

    /// Registers of an input.
    fn input(&mut self, id: Id, ty: Id) -> Result<u32, Error> {
        let input = match self.decorations.get(&(id, BUILT_IN)) {
            Some(24) => Input::GroupCount,
            Some(26) => Input::Group,
            Some(27) => Input::Local,
            Some(28) => Input::Global,
            Some(29) => Input::Index,
            Some(36) => Input::SubgroupSize,
            Some(38) => Input::SubgroupCount,
            Some(40) => Input::Subgroup,
            Some(41) => Input::Lane,
            other => return Err(self.unknown(format!("input {other:?}"))),
        };
        let words = self.types.words(ty)?;
        if words != input.words() {
            return Err(self.unknown(format!("{input:?} of {words} words")));
        }
        let reg = self.registers(words);
        self.module.inputs.push((input, reg));
        Ok(reg)
    }
}
