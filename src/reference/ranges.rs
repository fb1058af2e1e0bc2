//! Twin of stage `ranges`.

/// Where each of `tiles` tiles' pairs begin and end in the sorted `pair_tiles`; `[0, 0]` where it
/// has none. Pairs of tiles behind the last are padding.
pub fn ranges(pair_tiles: &[u32], tiles: u32) -> Vec<[u32; 2]> {
    let begin = |tile| pair_tiles.partition_point(|t| *t < tile) as u32;
    let range = |tile| match [begin(tile), begin(tile + 1)] {
        [from, to] if from == to => [0, 0],
        range => range,
    };
    (0..tiles).map(range).collect()
}
