//! The radix sort against a stable sort.

use nvsprior::reference::radix;
use nvsprior::render::probe;

use crate::common::{self, Random};

/// Sizes about the block of 4096 keys, and one of many blocks.
const SIZES: [usize; 8] = [1, 2, 255, 4_095, 4_096, 4_097, 8_193, 100_000];

fn assert_sorts(what: &str, key: impl Fn(usize, usize) -> u32) {
    let engine = common::engine();
    for count in SIZES {
        let keys: Vec<u32> = (0..count).map(|i| key(i, count)).collect();
        let values: Vec<u32> = (0..count as u32).collect();
        let sorted = probe::sort(&engine, &keys, &values).unwrap();
        assert!(sorted == radix::sort(&keys, &values), "{count} keys, {what}");
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
    assert_sorts("largest", |i, _| u32::MAX - (i as u32 % 2));
}
