//! What a compact prior begins with, and how its parts are refused.

use super::super::PriorError;

/// How a compact prior starts.
pub const MAGIC: &[u8] = b"nvsg";

/// What errors call it.
pub const FORMAT: &str = "compact prior";

/// A field at byte `offset` that no writer leaves so.
pub fn refusal(offset: usize, reason: String) -> PriorError {
    PriorError::Field { format: FORMAT, offset: offset as u64, reason }
}
