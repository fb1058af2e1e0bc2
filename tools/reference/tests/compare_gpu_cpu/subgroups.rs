//! The same order and picture at other subgroup sizes. Lavapipe reads its subgroup size from a
//! variable, once per process.

use std::process::Command;

use crate::common;

#[test]
fn other_sizes_sort_and_draw_the_same() {
    let engine = common::engine();
    if !engine.device().name.contains("llvmpipe") {
        println!("skipped: {} has one subgroup size", engine.device());
        return;
    }
    for (bits, subgroup) in [(128, 4), (256, 8), (512, 16)] {
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "--nocapture", "--test-threads=1"])
            .args(["sorting::random_keys", "pictures::every_sh_degree", "equations::random_scenes"])
            .arg("subgroups::forms_are_chosen_by_subgroup_size")
            .env("LP_NATIVE_VECTOR_WIDTH", bits.to_string())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        let complaint = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "subgroup {subgroup}: {said}\n{complaint}");
        assert!(said.contains("4 passed"), "subgroup {subgroup}: {said}");
        if !said.contains(&format!("subgroup {subgroup})")) {
            println!("skipped: this processor does not take subgroup {subgroup}");
        }
    }
}

#[test]
fn forms_are_chosen_by_subgroup_size() {
    let engine = common::engine();
    let info = engine.device();
    if info.name.contains("llvmpipe") {
        let expected = match info.subgroup {
            16 => (Some(16), false),
            8 => (None, true),
            _ => (None, false),
        };
        assert_eq!((info.wave, info.in_lockstep()), expected, "{info}");
    }
    assert!(info.wave.is_none() || info.wave == Some(info.subgroup), "{info}: {:?}", info.wave);
}
