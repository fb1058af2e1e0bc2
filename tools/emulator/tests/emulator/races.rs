//! Races are found in any order of invocations, and only races.

use nvsprior_emulator::Error;

use crate::assembly::*;

const SEEDS: std::ops::Range<u64> = 0..12;

/// What is wrong with a workgroup of 16, two subgroups, for each seed.
fn faults(body: &[Vec<Op>]) -> Vec<Option<Error>> {
    let body = [body.concat(), vec![end()]].concat();
    SEEDS.map(|seed| run(16, &body, seed, &mut vec![0; 64]).err()).collect()
}

fn assert_all(body: &[Vec<Op>], is_it: impl Fn(&Error) -> bool) {
    for fault in faults(body) {
        assert!(fault.as_ref().is_some_and(&is_it), "{fault:?}");
    }
}

fn assert_none(body: &[Vec<Op>]) {
    assert!(faults(body).iter().all(Option::is_none), "{:?}", faults(body));
}

/// Each invocation writes its word of shared memory, and reads the word 8 or 1 further on.
fn neighbours(distance: u32, between: Vec<Op>) -> [Vec<Op>; 3] {
    let other = vec![
        op(128, &[WORD, 51, INDEX, constant(distance)]),
        op(137, &[WORD, 52, 51, constant(16)]),
    ];
    let read = [other, load_from_shared(53, 52, 54).into()].concat();
    [store_to_shared(50, INDEX, INDEX).into(), between, read]
}

fn is_race(error: &Error) -> bool {
    matches!(error, Error::Race { .. } | Error::Unwritten { .. })
}

#[test]
fn a_missing_barrier_is_found() {
    assert_all(&neighbours(8, vec![]), is_race);
    assert_none(&neighbours(8, vec![barrier(workgroup(), ORDERS_SHARED)]));
}

#[test]
fn a_barrier_orders_what_it_names() {
    assert_all(&neighbours(8, vec![barrier(workgroup(), ORDERS_STORAGE)]), is_race);
    assert_all(&neighbours(8, vec![barrier(workgroup(), SHOWS_NOTHING)]), is_race);
}

/// The words of another subgroup: its barrier does not order them.
#[test]
fn a_subgroup_s_barrier_orders_the_subgroup() {
    assert_all(&neighbours(8, vec![barrier(subgroup(), ORDERS_SHARED)]), is_race);
    let own = |between: Vec<Op>| {
        let own = vec![op(198, &[WORD, 52, LANE, constant(1)])];
        let write = when_below(40, INDEX, 8, store_to_shared(50, LANE, LANE));
        let read = when_below(44, INDEX, 8, load_from_shared(53, 52, 54));
        [own, write, between, read]
    };
    // One subgroup of eight: the whole workgroup.
    let run = |body: &[Vec<Op>], seed| {
        run(8, &[body.concat(), vec![end()]].concat(), seed, &mut vec![0; 8])
    };
    for seed in SEEDS {
        assert!(is_race(&run(&own(vec![]), seed).unwrap_err()));
        let any = op(335, &[BOOL, 60, subgroup(), 61]);
        let any = vec![op(176, &[BOOL, 61, LANE, constant(3)]), any];
        assert!(is_race(&run(&own(any), seed).unwrap_err()), "an operation is no barrier");
        run(&own(vec![barrier(subgroup(), ORDERS_SHARED)]), seed).unwrap();
    }
}

#[test]
fn a_write_after_others_read_is_a_race() {
    let read = load_from_buffer(50, constant(3), 51).to_vec();
    let write = when_below(40, INDEX, 1, store_to_buffer(52, constant(3), constant(7)));
    let shared = vec![barrier(workgroup(), ORDERS_SHARED)];
    assert_all(&[read.clone(), shared, write.clone()], is_race);
    assert_none(&[read, vec![barrier(workgroup(), ORDERS_STORAGE)], write]);
}

#[test]
fn equal_writes_are_named() {
    let body = [store_to_buffer(50, constant(3), constant(7)).to_vec(), vec![end()]].concat();
    for seed in SEEDS {
        let fault = run(16, &body, seed, &mut vec![0; 64]).unwrap_err();
        assert!(matches!(fault, Error::EqualWrites { word: 3, .. }), "{fault}");
    }
    assert_all(&[store_to_buffer(50, constant(3), INDEX).into()], is_race);
}

#[test]
fn atomics_race_with_other_accesses() {
    let count = count_in_buffer(50, constant(3), 51).to_vec();
    let read = when_below(40, INDEX, 1, load_from_buffer(52, constant(3), 53));
    assert_none(std::slice::from_ref(&count));
    assert_all(&[count.clone(), read.clone()], is_race);
    assert_none(&[count, vec![barrier(workgroup(), ORDERS_STORAGE)], read]);
}

#[test]
fn workgroups_race() {
    let write = [store_to_buffer(50, constant(3), INDEX).to_vec(), vec![end()]].concat();
    let read = [load_from_buffer(50, constant(3), 51).to_vec(), vec![end()]].concat();
    for seed in SEEDS {
        let of = |groups, body: &[Op]| {
            run_with(1, body, &dispatch(groups, 8, seed), &mut vec![0; 8]).err()
        };
        assert!(matches!(of(2, &write), Some(Error::GroupRace { word: 3, .. })));
        assert_eq!([of(1, &write), of(2, &read)], [None, None]);
    }
}
