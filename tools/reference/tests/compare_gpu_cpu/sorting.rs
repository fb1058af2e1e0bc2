//! The radix sort against a stable sort.

use nvsprior_kernels::shared::{CULLED, digit_bits};
use nvsprior_reference::probe::{Probe, SortPrecision};
use nvsprior_reference::radix;

use crate::common::{self, Random};

/// Fewer keys than there are blocks, about as many, and many a block.
const SIZES: [usize; 8] = [1, 2, 15, 255, 4_095, 4_096, 8_193, 100_000];

fn assert_sorts(what: &str, key: impl Fn(usize, usize) -> u32) {
    let engine = common::engine();
    for count in SIZES {
        let keys: Vec<u32> = (0..count).map(|i| key(i, count)).collect();
        let values: Vec<u32> = (0..count as u32).collect();
        let sorted = Probe::of(&engine).sort(&keys, SortPrecision::Exact).unwrap();
        assert!(sorted == radix::sort_visible(&keys, &values).1, "{count} keys, {what}");
        let largest = keys.iter().copied().filter(|key| *key != CULLED).max().unwrap_or(0);
        let coarse = |key: u32| if key == CULLED { key } else { key >> digit_bits(largest) };
        let sorted = Probe::of(&engine).sort(&keys, SortPrecision::Coarse).unwrap();
        let keys: Vec<u32> = keys.into_iter().map(coarse).collect();
        assert!(sorted == radix::sort_visible(&keys, &values).1, "{count} keys, {what}, coarse");
    }
    common::assert_silent(&engine);
}

#[test]
fn any_number_of_blocks_sorts() {
    let engine = common::engine();
    // With one row of counters per block, and with rows of sums of four and of eight blocks before them.
    for (log_blocks, count) in [(2, 700), (3, 9_000), (5, 9_000), (6, 20_000), (7, 100)] {
        let keys: Vec<u32> = (0..count).map(|i| Random::new(i).bits() as u32 >> 3).collect();
        let values: Vec<u32> = (0..count as u32).collect();
        let exact = SortPrecision::Exact;
        let sorted = Probe::of(&engine).sort_in_blocks(&keys, exact, log_blocks).unwrap();
        assert!(sorted == radix::sort_visible(&keys, &values).1, "2^{log_blocks} blocks");
    }
    common::assert_silent(&engine);
}

#[test]
fn random_keys() {
    // For the test that runs this one at other subgroup sizes.
    println!("{}", common::engine().device());
    assert_sorts("random", |i, _| Random::new(i as u64).bits() as u32);
}

#[test]
fn few_distinct_keys_keep_their_order() {
    assert_sorts("few distinct", |i, _| (Random::new(i as u64).bits() % 5) as u32 * 0x0101_0101);
    assert_sorts("all equal", |_, _| 0xdead_beef);
}

#[test]
fn sorted_and_reversed_keys() {
    assert_sorts("sorted", |i, _| i as u32 * 3);
    assert_sorts("reversed", |i, count| (count - i) as u32 * 40_000);
    assert_sorts("largest", |i, _| u32::MAX - 1 - (i as u32 % 2));
    assert_sorts("smallest", |i, _| i as u32 % 2);
}

#[test]
fn culled_keys_are_left_behind() {
    let culled =
        |i: usize, every: usize| if i.is_multiple_of(every) { u32::MAX } else { 7 * i as u32 };
    assert_sorts("a third culled", |i, _| culled(i, 3));
    assert_sorts("all culled", |i, _| culled(i, 1));
}
