//! The name of a prior: whether both sides of a link hold the same one.

use std::fmt;

/// Identity of a prior: the first four bytes, little endian, of a BLAKE3 hash. The hash covers all that shapes its
/// pictures: the render options, the degree, every parameter kept, the order of splats (it decides between equal
/// depths), and its scene coder tables, if it has any. File format, order of properties and dropped splats do not
/// change the identity.
///
/// It protects against mistakes, not against forgery: two different priors share an identity with a
/// chance of 1 in 2³².
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PriorId(pub u32);

impl PriorId {
    /// Bytes as in a packet.
    pub fn to_bytes(self) -> [u8; 4] {
        self.0.to_le_bytes()
    }

    /// Reads a packet's bytes.
    pub fn from_bytes(bytes: [u8; 4]) -> PriorId {
        PriorId(u32::from_le_bytes(bytes))
    }
}

impl fmt::Display for PriorId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}
