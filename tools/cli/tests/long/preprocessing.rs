//! What is trained or compared with frames takes them as the prior's preprocessing says.

use crate::dive::{Dive, INPUT};
use crate::treated::{open, preprocessed, treated_by_hand};

#[test]
fn trim_tables_and_bench_compare_with_the_treated_pictures() {
    let (dive, by_hand) = (preprocessed(), treated_by_hand());
    for dive in [&dive, &by_hand] {
        dive.run("tables --cameras cameras.json --rounds 1 --prior prior.ply --out a.nvsg")
            .ends_with(0);
        let fit = "--steps 1 --share 0.3 --fit frames --out small.nvsg";
        dive.run(&format!("trim prior.ply --cameras cameras.json {fit}")).ends_with(0);
        let small = "--trials 0 --bfgs-frames 0 --configurations 0 --report out";
        dive.run(&format!("bench {INPUT} --starts camera-file {small}")).ends_with(0);
    }
    let tables = |dive| open(dive, "a.nvsg").coder_tables().cloned().unwrap();
    assert_eq!(tables(&dive), tables(&by_hand));
    let splats = |dive| open(dive, "small.nvsg").splats().clone();
    assert_eq!(splats(&dive), splats(&by_hand));
    let best = |dive: &Dive| dive.json("out/report.json")["best_known"].clone();
    assert_eq!(best(&dive), best(&by_hand));
    assert!(best(&dive)[0]["psnr"].as_f64().is_some());
}
