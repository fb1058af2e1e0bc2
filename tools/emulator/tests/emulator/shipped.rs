//! Modules that ship: all are known, they run, and what is taken from them is missed.

use nvsprior_emulator::{Dispatch, Error, Module, without_barrier};
use nvsprior_kernels::block_table::BlockTable;
use nvsprior_kernels::modules;
use nvsprior_kernels::portable::sample;
use nvsprior_kernels::shared::{DIGITS, Params, SUMS, TABLE};

use crate::assembly::dispatch;

#[test]
fn all_modules_are_known_but_those_of_64_bits() {
    let mut unknown = Vec::new();
    for module in modules::ALL {
        match Module::new(module.spirv) {
            Ok(_) => {}
            Err(Error::Unknown { what, entry }) if what == "number of 64 bits" => {
                unknown.push(entry);
            }
            Err(other) => panic!("{}: {other}", module.entry),
        }
    }
    let expected = [
        "bin::bin_count_lockstep",
        "bin::bin_emit_lockstep",
        "project::project_lockstep",
        "splat_backward::splat_backward_lockstep",
        "ssim::ssim_back_lockstep",
        "ssim::ssim_columns_lockstep",
        "ssim::ssim_gradient_lockstep",
        "ssim::ssim_rows_lockstep",
        "train_activate::train_activate_lockstep",
        "train_step::train_step_lockstep",
    ];
    assert_eq!(unknown, expected);
}

#[test]
fn arithmetic_is_the_hosts() {
    let numbers: Vec<[f32; 3]> =
        (1..=64).map(|i| i as f32).map(|i| [0.3 * i, 2.0 - i, 0.1 * i]).collect();
    let bits = |v: f32| v.to_bits();
    let expected: Vec<u32> =
        numbers.iter().flat_map(|[a, b, c]| sample(*a, *b, *c)).map(bits).collect();
    let mut buffers = [numbers.concat().into_iter().map(bits).collect(), vec![0; expected.len()]];
    let module = Module::new(modules::arithmetic.spirv).unwrap();
    let counts = module.run(&dispatch(1, 16, 3), &mut buffers).unwrap();
    assert_eq!((counts.groups, buffers[1] == expected), (1, true));
}

/// The module without its barrier number `nth`.
fn without(module: &modules::Module, nth: usize) -> Option<Module> {
    without_barrier(module.spirv, nth).map(|spirv| Module::new(&spirv).unwrap())
}

/// So many that each subgroup loads keys twice.
const KEYS: u32 = 3_000;

/// Scatters keys by their only digit, as in the first pass of a sort.
fn scatter(module: &Module, subgroup: u32, seed: u64) -> Result<Vec<u32>, Error> {
    const LOG_BLOCKS: u32 = 2;
    const BITS: u32 = 5;
    let keys: Vec<u32> = (0..KEYS).map(|i| i * i % 29).collect();
    let table = BlockTable::new(1 << BITS, LOG_BLOCKS, 0, DIGITS);
    let mut histogram = vec![0; table.words() as usize];
    // Blocks of whole steps: the last one has fewer keys.
    for (i, key) in (0..).zip(&keys) {
        histogram[table.cell(i / 768, *key) as usize] += 1;
    }
    let none = vec![0; KEYS as usize];
    let mut buffers = [vec![0, 0, BITS], histogram, keys, none.clone(), none.clone(), none];
    let push = [0, 1, LOG_BLOCKS, KEYS];
    let dispatch = Dispatch { push: &push, ..dispatch(1 << LOG_BLOCKS, subgroup, seed) };
    module.run(&dispatch, &mut buffers)?;
    let [.., keys_out, _] = buffers;
    Ok(keys_out)
}

#[test]
fn a_barrier_taken_from_the_sort_is_missed() {
    let mut sorted: Vec<u32> = (0..KEYS).map(|i| i * i % 29).collect();
    sorted.sort();
    let forms = [
        (modules::radix_scatter_wave16, 16),
        (modules::radix_scatter_wave32, 32),
        (modules::radix_scatter_wave64, 64),
    ];
    for (module, subgroup) in forms {
        let whole = Module::new(module.spirv).unwrap();
        assert_eq!(scatter(&whole, subgroup, 1), Ok(sorted.clone()));
        let mut taken = 0;
        while let Some(broken) = without(&module, taken) {
            for seed in 0..4 {
                let fault = scatter(&broken, subgroup, seed).expect_err("a race");
                let is_race = matches!(fault, Error::Race { .. } | Error::Unwritten { .. });
                assert!(is_race, "{}, barrier {taken}: {fault}", module.entry);
            }
            taken += 1;
        }
        assert!(taken >= 3, "{}: {taken} barriers", module.entry);
    }
}

#[test]
fn a_form_for_other_subgroups_is_missed() {
    let module = Module::new(modules::radix_scatter_wave64.spirv).unwrap();
    let fault = scatter(&module, 32, 1).unwrap_err();
    let is_missed = matches!(
        fault,
        Error::InactiveLane { lane: 63, .. } | Error::Race { .. } | Error::Unwritten { .. }
    );
    assert!(is_missed, "{fault}");
}

#[test]
fn a_buffer_that_is_too_short_is_named() {
    let module = Module::new(modules::radix_count.spirv).unwrap();
    let words = BlockTable::new(TABLE, 0, 0, DIGITS).words() as usize;
    let run = |keys: usize| {
        let push = [0, 1, 0, 300];
        let dispatch = Dispatch { push: &push, ..dispatch(1, 32, 0) };
        module.run(&dispatch, &mut [vec![0, 0, 11, 0], vec![5; keys], vec![0; words]]).err()
    };
    assert_eq!(run(300), None);
    match run(290) {
        Some(Error::OutOfBounds { place, memory, index }) => {
            assert_eq!((memory.as_str(), index), ("binding 1", 290));
            let named = (place.entry.as_str(), place.instruction.as_str());
            assert_eq!(named, ("radix::radix_count", "OpLoad"));
        }
        other => panic!("{other:?}"),
    }
}

/// Lanes of `reduce` read what others wrote only behind the first barrier.
#[test]
fn a_barrier_taken_from_the_sums_is_missed() {
    let at = std::mem::offset_of!(Params, tiles_x) / 4;
    let run = |module: &Module| {
        let mut params = vec![0; size_of::<Params>() / 4];
        params[at..at + 2].fill(3);
        let partials = vec![1.0_f32.to_bits(); 9 * SUMS as usize];
        let mut buffers = [params, partials, vec![0; SUMS as usize]];
        module.run(&dispatch(1, 32, 1), &mut buffers)?;
        Ok::<_, Error>(buffers[2].clone())
    };
    let whole = Module::new(modules::reduce.spirv).unwrap();
    assert_eq!(run(&whole), Ok(vec![9.0_f32.to_bits(); SUMS as usize]));
    let broken = without(&modules::reduce, 0).unwrap();
    assert!(matches!(run(&broken), Err(Error::Unwritten { .. } | Error::Race { .. })));
}
