//! Faults other than races are found and named.

use nvsprior_emulator::{Error, Module};

use crate::assembly::*;

/// What is wrong with a workgroup of 16, two subgroups.
fn fault(body: &[Vec<Op>], seed: u64) -> Error {
    let body = [body.concat(), vec![end()]].concat();
    run(16, &body, seed, &mut vec![0; 16]).expect_err("a fault")
}

#[test]
fn a_private_access_is_refused() {
    let [chain, mut load] = load_from_shared(50, constant(0), 51);
    // Without the memory operand.
    load.pop();
    load[0] -= 1 << 16;
    let of_buffer = store_to_buffer(50, constant(0), INDEX);
    assert!(matches!(fault(&[vec![chain, load]], 0), Error::Private { .. }));
    let [chain, mut store] = of_buffer;
    store[3] = 0;
    assert!(matches!(fault(&[vec![chain, store]], 0), Error::Private { .. }));
}

#[test]
fn a_divergent_shuffle_is_found() {
    let shuffle = op(345, &[WORD, 50, subgroup(), LANE, constant(1)]);
    let any = vec![op(176, &[BOOL, 51, LANE, constant(2)]), op(335, &[BOOL, 52, subgroup(), 51])];
    for seed in 0..12 {
        let fault = fault(&[when_below(40, LANE, 3, [shuffle.clone()]), any.clone()], seed);
        let text = fault.to_string();
        assert!(matches!(fault, Error::Divergent { .. }), "{text}");
        assert!(text.contains("instruction 345") || text.contains("OpGroupNonUniformShuffle"));
        assert!(text.contains("OpGroupNonUniformAny"), "{text}");
    }
}

#[test]
fn a_value_of_a_lane_that_is_not_there_is_found() {
    let shuffle = |lane| vec![op(345, &[WORD, 50, subgroup(), LANE, constant(lane)])];
    for seed in 0..12 {
        // Lanes below 4 have ended.
        let ended = when_below(40, LANE, 4, [end()]);
        let fault_of = |lane| fault(&[ended.clone(), shuffle(lane)], seed);
        assert!(matches!(fault_of(2), Error::InactiveLane { lane: 2, .. }));
        assert!(matches!(fault(&[shuffle(8)], seed), Error::InactiveLane { lane: 8, .. }));
        let body = [ended, shuffle(5), vec![end()]].concat();
        assert_eq!(run(16, &body, seed, &mut vec![]).err(), None);
    }
}

#[test]
fn a_barrier_that_some_do_not_reach_is_found() {
    for seed in 0..12 {
        for scope in [workgroup(), subgroup()] {
            let body = [when_below(40, INDEX, 5, [end()]), vec![barrier(scope, ORDERS_SHARED)]];
            let fault = fault(&body, seed);
            assert!(fault.to_string().contains("has ended"), "{fault}");
        }
        let inside = when_below(40, INDEX, 5, [barrier(workgroup(), ORDERS_SHARED)]);
        let body = [inside, vec![barrier(workgroup(), ORDERS_SHARED)]];
        assert!(matches!(fault(&body, seed), Error::Divergent { .. }));
    }
}

#[test]
fn barriers_that_only_some_subgroups_pass_are_found() {
    let own = || barrier(subgroup(), ORDERS_SHARED);
    let all = || vec![barrier(workgroup(), ORDERS_SHARED)];
    for seed in 0..12 {
        let first_only = || when_below(40, SUBGROUP, 1, [own()]);
        for body in [vec![first_only()], vec![first_only(), all()]] {
            let fault = fault(&body, seed);
            assert!(matches!(fault, Error::Uneven { barriers: [1, 0], other: 1, .. }), "{fault}");
        }
        let body = [vec![own()], all(), vec![own(), end()]].concat();
        assert_eq!(run(16, &body, seed, &mut vec![]).err(), None);
    }
}

#[test]
fn accesses_out_of_bounds_are_found() {
    let beyond = vec![op(128, &[WORD, 49, INDEX, constant(60)])];
    for seed in 0..12 {
        let fault_of = |access: [Op; 2]| fault(&[beyond.clone(), access.into()], seed);
        let memory_of = |fault: Error| match fault {
            Error::OutOfBounds { memory, index, .. } => (memory, index >= 16),
            other => panic!("{other}"),
        };
        let of_buffer = ("binding 0".to_string(), true);
        assert_eq!(memory_of(fault_of(store_to_buffer(50, 49, INDEX))), of_buffer);
        assert_eq!(memory_of(fault_of(load_from_buffer(50, 49, 51))), of_buffer);
        assert_eq!(memory_of(fault_of(count_in_buffer(50, 49, 51))), of_buffer);
        let of_shared = ("shared memory".to_string(), true);
        assert_eq!(memory_of(fault_of(store_to_shared(50, 49, INDEX))), of_shared);
    }
}

#[test]
fn shared_memory_that_nobody_wrote_is_found() {
    let fault = fault(&[load_from_shared(50, INDEX, 51).into()], 1);
    assert!(matches!(fault, Error::Unwritten { .. }), "{fault}");
    // Another workgroup's is not this one's.
    let write = when_below(40, INDEX, 1, store_to_shared(50, constant(0), INDEX));
    let once = [write, vec![end()]].concat();
    run_with(1, &once, &dispatch(3, 8, 1), &mut vec![]).unwrap();
}

#[test]
fn what_it_does_not_know_is_named() {
    let name = |body: &[Op]| run(16, body, 0, &mut vec![]).unwrap_err().to_string();
    assert!(name(&[op(300, &[])]).contains("unknown instruction 300 in module main"));
    let glsl = op(12, &[WORD, 50, 51, 52, INDEX]);
    assert!(name(&[glsl]).contains("unknown OpExtInst"));
    assert!(name(&[op(61, &[WORD, 50, 999])]).contains("unknown pointer %999"));
    assert!(name(&[op(128, &[WORD, 50, INDEX, 999])]).contains("unknown use of %999"));
    assert!(name(&[op(249, &[999])]).contains("unknown block %999"));
}

/// Never a panic, wherever a module is cut or damaged.
#[test]
fn damaged_modules_are_refused() {
    let whole = nvsprior_kernels::modules::radix_scatter_wave64.spirv;
    for end in (0..whole.len()).step_by(97) {
        let _ = Module::new(&whole[..end]);
    }
    let mut state = 1_u64;
    for _ in 0..3_000 {
        let mut bytes = whole.to_vec();
        for _ in 0..3 {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
            let at = 4 * ((state >> 33) as usize % (bytes.len() / 4));
            bytes[at] = (state >> 20) as u8;
        }
        let _ = Module::new(&bytes);
    }
    assert!(matches!(Module::new(b"no module at all"), Err(Error::Malformed(_))));
}
