//! Twin of the radix sort: a stable sort by key.

use nvsprior_kernels::shared::CULLED;

/// Sorts values by their keys; equal keys keep their order.
///
/// # Panics
/// If the numbers of keys and values differ.
pub fn sort(keys: &[u32], values: &[u32]) -> (Vec<u32>, Vec<u32>) {
    assert_eq!(keys.len(), values.len(), "keys and values");
    let mut pairs: Vec<(u32, u32)> = std::iter::zip(keys, values).map(|(k, v)| (*k, *v)).collect();
    pairs.sort_by_key(|(key, _)| *key);
    pairs.into_iter().unzip()
}

/// As [`sort`], without those whose key is [`CULLED`].
pub fn sort_visible(keys: &[u32], values: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut keys, mut values) = sort(keys, values);
    let visible = keys.partition_point(|key| *key < CULLED);
    keys.truncate(visible);
    values.truncate(visible);
    (keys, values)
}
