//! What is trained or compared with frames takes them as the prior's preprocessing says.

use crate::treated::{open, preprocessed, treated_by_hand};

#[test]
fn trim_and_tables_compare_with_the_treated_pictures() {
    let (dive, by_hand) = (preprocessed(), treated_by_hand());
    for dive in [&dive, &by_hand] {
        dive.run("prior tables --cameras cameras.json --steps 1 --prior prior.ply --out a.nvsg")
            .ends_with(0);
        let fit = "--steps 1 --fit frames --out small.nvsg";
        dive.run(&format!("prior trim prior.ply --cameras cameras.json {fit}")).ends_with(0);
    }
    let tables = |dive| open(dive, "a.nvsg").coder_tables().cloned().unwrap();
    assert_eq!(tables(&dive), tables(&by_hand));
    let splats = |dive| open(dive, "small.nvsg").splats().clone();
    assert_eq!(splats(&dive), splats(&by_hand));
}
