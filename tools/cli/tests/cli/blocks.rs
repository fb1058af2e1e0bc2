//! `nvsprior prior blocks`, and both sides of a dive with the prior in blocks.

use crate::dive::{Dive, FRAMES};

const ENCODE: &str = "encode --cameras cameras.json --split dive --prior";

#[test]
fn a_prior_in_blocks_gives_the_packets_of_the_whole_one() {
    let dive = Dive::new();
    let written =
        dive.run("prior blocks prior.ply --out wall.nvsb --block 256").ends_with(0).stdout;
    assert!(written.contains("4800"), "{written}");
    let inspected = dive.run("inspect wall.nvsb").ends_with(0).stdout;
    assert!(inspected.contains("blocked prior"), "{inspected}");
    dive.run(&format!("{ENCODE} wall.nvsb --packets whole --overwrite --pictures sent"))
        .ends_with(0);
    dive.run(&format!("{ENCODE} wall.nvsb --prior-memory 2 --packets parts --overwrite"))
        .ends_with(0);
    dive.run("decode --prior wall.nvsb --prior-memory 2 --packets whole --overwrite --frames seen")
        .ends_with(0);
    for t in 0..FRAMES {
        let packet = |folder: &str| dive.bytes(&format!("{folder}/{t}.nvsp"));
        assert_eq!(packet("whole"), packet("parts"), "frame {t}");
        let picture = |folder: &str| dive.picture(&format!("{folder}/{t}.png"));
        assert_eq!(picture("sent"), picture("seen"), "frame {t}");
    }
    // Two parts of one site; what they have in common is not asked.
    let both = dive.run("prior blocks prior.ply wall.nvsb --out both.nvsb").ends_with(0).stdout;
    assert!(both.contains("9600"), "{both}");
}

#[test]
fn what_blocks_cannot_do_is_refused() {
    let dive = Dive::new();
    dive.run("prior blocks prior.ply --out wall.nvsg").ends_with(2).says("ends in .nvsb");
    dive.run("prior blocks prior.ply --out wall.nvsb --block 20000").ends_with(2).says("16384");
    dive.run("prior blocks prior.ply nowhere.ply --out wall.nvsb").ends_with(1).says("nowhere.ply");
    assert!(!dive.path("wall.nvsb").exists());
    dive.run("prior blocks prior.ply --out wall.nvsb").ends_with(0);
    let in_blocks = format!("{ENCODE} wall.nvsb --prior-memory 2 --packets packets --overwrite");
    dive.run(&format!("{in_blocks} --near 0.1")).ends_with(1).says("options of the file");
    let whole = format!("{ENCODE} prior.ply --prior-memory 2 --packets packets --overwrite");
    dive.run(&whole).ends_with(1).says("prior.ply");
    dive.run(&format!("{whole} --prior-memory 0")).ends_with(2);
}
