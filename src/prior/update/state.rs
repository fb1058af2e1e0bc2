//! The name of what a prior and its updates add up to.

use std::fmt;

use super::super::id::PriorId;

/// What a prior and the updates so far add up to: the first four bytes, little endian, of a BLAKE3 hash over the state
/// before and the content of the newest update. Without an update it is the prior's identity.
///
/// Like [`PriorId`] it protects against mistakes, not against forgery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct StateId(pub u32);

impl From<PriorId> for StateId {
    fn from(id: PriorId) -> StateId {
        StateId(id.0)
    }
}

/// A packet holds a state in place of a prior's identity.
impl From<StateId> for PriorId {
    fn from(state: StateId) -> PriorId {
        PriorId(state.0)
    }
}

impl fmt::Display for StateId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}
