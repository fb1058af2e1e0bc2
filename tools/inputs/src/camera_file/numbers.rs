//! Numbers in JSON.

use serde_json::Value;

/// How far the product of a rotation with its transpose may be from the identity: files round.
pub const RIGID: f64 = 1e-3;

/// Exactly `N` numbers.
pub fn floats<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let values: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
    values?.try_into().ok()
}
