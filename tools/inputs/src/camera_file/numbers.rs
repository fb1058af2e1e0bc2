//! Lists of numbers in JSON.

use serde_json::Value;

/// Exactly `N` numbers.
pub fn floats<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let values: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
    values?.try_into().ok()
}
