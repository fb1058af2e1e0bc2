//! Right modules have the right results, in any order of invocations.

use crate::assembly::*;

/// Words of a buffer after a run.
fn left(size: u32, subgroup: u32, seed: u64, body: &[Op]) -> Vec<u32> {
    let mut buffer = vec![0; size as usize];
    run_with(size, body, &dispatch(1, subgroup, seed), &mut buffer).unwrap();
    buffer
}

/// Stores value 50 at the invocation's place in its subgroup.
fn collective(instruction: Op) -> Vec<Op> {
    [vec![instruction], store_to_buffer(51, LANE, 50).into(), vec![end()]].concat()
}

#[test]
fn subgroup_operations() {
    for (seed, size) in (1..).zip([16, 32, 64]) {
        let left = |op: Op| left(size, size, seed, &collective(op));
        let lanes: Vec<u32> = (0..size).collect();
        let before = |lane: &u32| lane * lane.saturating_sub(1) / 2;
        let sums: Vec<u32> = lanes.iter().map(before).collect();
        assert_eq!(left(op(349, &[WORD, 50, subgroup(), 2, LANE])), sums);
        let sums: Vec<u32> = lanes.iter().map(|lane| before(&(lane + 1))).collect();
        assert_eq!(left(op(349, &[WORD, 50, subgroup(), 1, LANE])), sums);
        assert_eq!(
            left(op(349, &[WORD, 50, subgroup(), 0, LANE])),
            vec![before(&size); size as usize]
        );
        let broadcast = op(337, &[WORD, 50, subgroup(), LANE, constant(5)]);
        assert_eq!(left(broadcast), vec![5; size as usize]);
    }
}

#[test]
fn shuffles_and_ballots() {
    for (seed, size) in (1..).zip([16, 32, 64]) {
        // Of the lane in the mirror.
        let mirrored = [
            op(130, &[WORD, 49, constant(size - 1), LANE]),
            op(345, &[WORD, 50, subgroup(), LANE, 49]),
        ];
        let mirror: Vec<u32> = (0..size).rev().collect();
        let body = [mirrored.to_vec(), collective(vec![])].concat();
        assert_eq!(left(size, size, seed, &body), mirror);
        // A bit for each lane from 9 on.
        let ballot = [
            op(174, &[BOOL, 48, LANE, constant(9)]),
            op(339, &[FOUR, 49, subgroup(), 48]),
            op(81, &[WORD, 50, 49, 0]),
        ];
        let body = [ballot.to_vec(), collective(vec![])].concat();
        let bits = ((u64::MAX >> (64 - size)) & !0x1ff) as u32;
        assert_eq!(left(size, size, seed, &body), vec![bits; size as usize]);
    }
}

/// Invocations pass their numbers on through shared memory.
#[test]
fn shared_memory_behind_a_barrier() {
    let body = [
        store_to_shared(50, INDEX, INDEX).to_vec(),
        vec![barrier(workgroup(), ORDERS_SHARED), op(130, &[WORD, 51, constant(31), INDEX])],
        load_from_shared(52, 51, 53).to_vec(),
        store_to_buffer(54, INDEX, 53).to_vec(),
        vec![end()],
    ]
    .concat();
    let mirror: Vec<u32> = (0..32).rev().collect();
    for seed in 0..20 {
        assert_eq!(left(32, 8, seed, &body), mirror);
    }
}

#[test]
fn atomics_add_up() {
    let body = [count_in_buffer(50, constant(3), 51).to_vec(), vec![end()]].concat();
    let mut buffer = vec![0; 4];
    run_with(24, &body, &dispatch(5, 8, 7), &mut buffer).unwrap();
    assert_eq!(buffer, [0, 0, 0, 120]);
}
