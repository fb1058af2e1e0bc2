//! The radix sort in all forms against a stable sort.

use nvsprior::Pose;
use nvsprior_kernels::shared::CULLED;
use nvsprior_reference::radix;

use crate::chain::{Chain, FORMS, Settings, View};
use crate::common::{Random, camera, random_prior};

/// Sorts keys in all forms, by all digits and by all but the first.
fn assert_sorts(what: &str, keys: &[u32], log_blocks: u32, seed: u64) {
    let prior = random_prior(1, 8, 0);
    let view = View::new(&prior, camera(8, 8), Pose::IDENTITY);
    let values: Vec<u32> = (0..keys.len() as u32).collect();
    for form in FORMS {
        for first_digit in [0, 1] {
            let settings =
                Settings { log_sort_blocks: log_blocks, first_digit, ..Settings::new(form, seed) };
            let mut chain = Chain::new(&view, settings);
            chain.set_keys(keys);
            let bits = chain.buffers["counters"][2] * first_digit;
            chain.sort(false);
            let coarse = |key: &u32| if *key == CULLED { CULLED } else { key >> bits };
            let coarse: Vec<u32> = keys.iter().map(coarse).collect();
            let (_, expected) = radix::sort_visible(&coarse, &values);
            assert!(chain.order() == expected, "{what}, {form:?}, from digit {first_digit}");
        }
    }
}

#[test]
fn any_number_of_keys_sorts() {
    for (seed, count) in (1..).zip([1, 2, 31, 127, 128, 1_025, 3_000]) {
        let keys: Vec<u32> = (0..count).map(|i| Random::new(i).bits() as u32 >> 1).collect();
        assert_sorts(&format!("{count} keys"), &keys, 3, seed);
    }
}

#[test]
fn any_number_of_blocks_sorts() {
    let keys: Vec<u32> = (0..2_000).map(|i| Random::new(i).bits() as u32 >> 3).collect();
    // With one row of counters per block, and with rows of sums of four and of eight blocks before them.
    for (seed, log_blocks) in (1..).zip([2, 4, 5, 6]) {
        assert_sorts(&format!("2^{log_blocks} blocks"), &keys, log_blocks, seed);
    }
}

#[test]
fn equal_keys_keep_their_order() {
    let few: Vec<u32> =
        (0..900).map(|i| (Random::new(i).bits() % 5) as u32 * 0x0101_0101).collect();
    assert_sorts("few distinct", &few, 3, 1);
    assert_sorts("all equal", &[0x1234_5678; 700], 3, 2);
}

#[test]
fn culled_keys_are_left_behind() {
    let keys: Vec<u32> = (0..1_100).map(|i| if i % 3 == 0 { CULLED } else { 7 * i }).collect();
    assert_sorts("a third culled", &keys, 3, 1);
    assert_sorts("all culled", &[CULLED; 300], 3, 2);
}
