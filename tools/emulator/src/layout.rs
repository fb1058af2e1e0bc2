//! Types: how many words their values take in registers, and where their parts lie in memory.

use std::collections::HashMap;

use crate::error::Error;

/// The number of a type in its module.
pub type Id = u32;

#[derive(Clone, Debug)]
pub enum Type {
    Void,
    Bool,
    /// An integer or a float of 32 bits.
    Word,
    Vector {
        of: Id,
        count: u32,
    },
    Array {
        of: Id,
        count: u32,
    },
    /// An array that ends with its buffer.
    RuntimeArray {
        of: Id,
    },
    Struct {
        members: Vec<Id>,
    },
    Pointer {
        to: Id,
    },
}

/// The types of a module, with the decorations that say how they lie in memory.
#[derive(Default)]
pub struct Types {
    pub all: HashMap<Id, Type>,
    /// Bytes.
    pub strides: HashMap<Id, u32>,
    /// Bytes, by structure and member.
    pub offsets: HashMap<(Id, u32), u32>,
}

/// A member of a type: its own type, and its first word.
pub struct Part {
    pub ty: Id,
    pub at: u32,
}

/// Most words of a type, and of the distance between its parts.
const MOST_WORDS: u32 = 1 << 20;

impl Types {
    /// A new type, made of types that are known.
    pub fn declare(&mut self, id: Id, ty: Type) -> Result<(), Error> {
        let parts = match &ty {
            Type::Vector { of, .. } | Type::Array { of, .. } | Type::RuntimeArray { of } => {
                vec![*of]
            }
            Type::Struct { members } => members.clone(),
            Type::Pointer { to } => vec![*to],
            _ => Vec::new(),
        };
        parts.into_iter().try_for_each(|part| self.get(part).map(|_| ()))?;
        if self.all.insert(id, ty).is_some() {
            return Err(Error::Malformed(format!("%{id} is declared twice")));
        }
        self.words(id).map(|_| ())
    }

    pub fn get(&self, id: Id) -> Result<&Type, Error> {
        self.all.get(&id).ok_or_else(|| Error::Malformed(format!("%{id} is no known type")))
    }

    /// Words of a value in registers.
    pub fn words(&self, id: Id) -> Result<u32, Error> {
        Ok(match self.get(id)? {
            Type::Void | Type::RuntimeArray { .. } => 0,
            Type::Bool | Type::Word => 1,
            // An address, and the index that is out of bounds.
            Type::Pointer { .. } => 2,
            Type::Vector { of, count } | Type::Array { of, count } => {
                bounded(u64::from(*count) * u64::from(self.words(*of)?))?
            }
            Type::Struct { members } => {
                let words = members.iter().map(|member| self.words(*member).map(u64::from));
                bounded(words.sum::<Result<_, _>>()?)?
            }
        })
    }

    /// Words of a value in memory.
    pub fn extent(&self, id: Id) -> Result<u32, Error> {
        Ok(match self.get(id)? {
            Type::Array { count, .. } => bounded(u64::from(*count) * u64::from(self.stride(id)?))?,
            Type::RuntimeArray { .. } => {
                return Err(Error::Malformed(format!("%{id} has no size")));
            }
            Type::Struct { members } => match members.len() as u32 {
                0 => 0,
                count => {
                    let last = self.memory_part(id, count - 1)?;
                    last.at + self.extent(last.ty)?
                }
            },
            _ => self.words(id)?,
        })
    }

    /// Words from one element to the next.
    pub fn stride(&self, id: Id) -> Result<u32, Error> {
        match (self.strides.get(&id), self.get(id)?) {
            (Some(bytes), _) => words_of(*bytes),
            (None, Type::Vector { .. }) => Ok(1),
            (None, Type::Array { of, .. } | Type::RuntimeArray { of }) => self.extent(*of),
            _ => Err(Error::Malformed(format!("%{id} has no elements"))),
        }
    }

    /// Part `index` of a type in memory.
    pub fn memory_part(&self, id: Id, index: u32) -> Result<Part, Error> {
        match self.get(id)? {
            Type::Vector { of, .. } | Type::Array { of, .. } | Type::RuntimeArray { of } => {
                Ok(Part { ty: *of, at: index * self.stride(id)? })
            }
            Type::Struct { members } => {
                let ty = *members.get(index as usize).ok_or_else(|| no_part(id, index))?;
                let at = match (self.offsets.get(&(id, index)), index) {
                    (Some(bytes), _) => words_of(*bytes)?,
                    (None, 0) => 0,
                    (None, _) => {
                        let before = self.memory_part(id, index - 1)?;
                        before.at + self.extent(before.ty)?
                    }
                };
                Ok(Part { ty, at })
            }
            _ => Err(no_part(id, index)),
        }
    }

    /// Part `index` of a value in registers.
    pub fn register_part(&self, id: Id, index: u32) -> Result<Part, Error> {
        match self.get(id)? {
            Type::Vector { of, count } | Type::Array { of, count } if index < *count => {
                Ok(Part { ty: *of, at: index * self.words(*of)? })
            }
            Type::Struct { members } if (index as usize) < members.len() => {
                let before = members[..index as usize].iter().map(|member| self.words(*member));
                Ok(Part { ty: members[index as usize], at: before.sum::<Result<_, _>>()? })
            }
            _ => Err(no_part(id, index)),
        }
    }

    /// Where in memory the words of a value lie, from its first, in the order of registers.
    pub fn places(&self, id: Id) -> Result<Vec<u32>, Error> {
        let parts = match self.get(id)? {
            Type::Bool | Type::Word => return Ok(vec![0]),
            Type::Vector { count, .. } | Type::Array { count, .. } => *count,
            Type::Struct { members } => members.len() as u32,
            _ => return Err(Error::Malformed(format!("%{id} is no type of values in memory"))),
        };
        let mut places = Vec::new();
        for index in 0..parts {
            let part = self.memory_part(id, index)?;
            places.extend(self.places(part.ty)?.iter().map(|place| part.at + place));
        }
        Ok(places)
    }
}

fn no_part(id: Id, index: u32) -> Error {
    Error::Malformed(format!("%{id} has no part {index}"))
}

fn bounded(words: u64) -> Result<u32, Error> {
    if words <= u64::from(MOST_WORDS) {
        Ok(words as u32)
    } else {
        Err(Error::Malformed(format!("{words} words are too many for a type")))
    }
}

fn words_of(bytes: u32) -> Result<u32, Error> {
    if bytes.is_multiple_of(4) {
        bounded(u64::from(bytes / 4))
    } else {
        Err(Error::Malformed(format!("{bytes} bytes are no whole words")))
    }
}
