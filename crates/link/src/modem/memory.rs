//! Memory that the system may refuse.

use super::error::ModemError;

/// An empty list with room for so many values.
pub fn room<T>(count: usize) -> Result<Vec<T>, ModemError> {
    let mut values = Vec::new();
    let refused = |_| ModemError::Memory(count.saturating_mul(size_of::<T>()));
    values.try_reserve_exact(count).map_err(refused)?;
    Ok(values)
}

/// `count` values.
pub fn filled<T: Clone>(count: usize, value: T) -> Result<Vec<T>, ModemError> {
    let mut values = room(count)?;
    values.resize(count, value);
    Ok(values)
}
