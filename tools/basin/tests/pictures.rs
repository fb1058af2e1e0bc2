//! The pictures that figures elsewhere were measured on: they stay what they are, byte for byte.

use nvsprior::Picture;
use nvsprior_basin::{Conditions, DemoFrame, Run, Site, inspection_run, mapping_run};

/// FNV-1a of a picture's bytes.
fn hash(picture: &Picture) -> u64 {
    let join = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    picture.data.iter().fold(0xcbf2_9ce4_8422_2325, join)
}

/// Checks the frames at which a hash is pinned.
fn check(what: &str, mut frames: impl Iterator<Item = DemoFrame>, pinned: &[(usize, u64)]) {
    let mut passed = 0;
    for (index, pin) in pinned {
        let frame = frames.nth(index - passed).unwrap_or_else(|| panic!("{what} is too short"));
        passed = index + 1;
        let found = hash(&frame.picture);
        assert_eq!(found, *pin, "{what}, frame {index}: {found:#018x}");
    }
}

#[test]
fn mapping_runs_stay_as_priors_were_trained_on_them() {
    check(
        "M1",
        mapping_run(Site::Basin, Conditions::CALM),
        &[(0, 0x8e5a_4007_32da_7b01), (12, 0xa4d3_d5ca_016f_a393), (24, 0xb87a_2f44_4222_b939)],
    );
    check(
        "M2",
        mapping_run(Site::Quay, Conditions::CALM),
        &[(0, 0x7340_9eed_fa83_c891), (8, 0xfd42_185a_d3e3_3d1c)],
    );
}

#[test]
fn inspection_runs_stay_as_figures_were_measured_on_them() {
    for (run, pinned) in [
        (Run::T1, [(0, 0x0262_8597_48d7_c149), (9, 0x0435_9690_8eb7_7423)]),
        (Run::T2, [(0, 0x338e_2f0c_0eae_5c31), (9, 0xda45_bcb7_4c19_bc57)]),
        (Run::T3, [(0, 0x06da_695e_2d90_f485), (9, 0x21dc_67bd_eb85_65db)]),
    ] {
        check(run.name(), inspection_run(run, 10, Conditions::CALM), &pinned);
    }
}
