//! `encode --learn`: a new object becomes updates, and `decode` finds them.

use nvsprior::Prior;
use nvsprior::prior::{Learnt, Update, UpdateChain};
use serde_json::Value;

use crate::dive::Dive;

/// Frames of run T2: enough for a first update, and for frames that are drawn with it.
const FRAMES: usize = 12;
const ENCODE: &str = "encode --prior prior.nvsg --cameras T2/cameras.json --psnr 31 --learn";

/// A folder with the demo's prior and the frames of T2, which show a new box and a line.
fn dive() -> Dive {
    let dive = Dive::without_frames();
    std::fs::write(dive.path("prior.nvsg"), nvsprior_basin::PRIOR).unwrap();
    dive.run(&format!("demo --run T2 --draw-only --frames {FRAMES} --out .")).ends_with(0);
    dive
}

fn number(frame: &Value, name: &str) -> f64 {
    frame[name].as_f64().unwrap()
}

#[test]
fn a_new_object_is_learnt_and_shown_on_both_sides() {
    let dive = dive();
    let files = "--packets packets --summary summary.json --frames-out expected";
    let said = dive.run(&format!("{ENCODE} {files}")).ends_with(0).stdout;
    assert!(said.contains("learnt: "), "{said}");
    let summary = dive.json("summary.json");
    let frames = summary["frames"].as_array().unwrap();
    let first = frames.iter().position(|frame| number(frame, "update_bytes") > 0.0);
    let first = first.expect("an update within the run");
    assert!(first + 1 < FRAMES, "frames after it");
    // Frames that it was not learnt from look better by it, and cost less.
    let [before, after] = [&frames[first], &frames[first + 1]];
    assert!(number(after, "render_psnr") > number(before, "render_psnr") + 1.5, "{after}");
    assert!(number(after, "bytes") < 0.9 * number(before, "bytes"), "{after}");
    // The update is a file of its own, of the prior and with the bytes that the summary says.
    let name = format!("packets/{:04}.nvsu", first + 1);
    let update = Update::read(&dive.bytes(&name)).unwrap();
    assert_eq!(dive.bytes(&name).len() as f64, number(&frames[first], "update_bytes"));
    let prior = Prior::open(&dive.path("prior.nvsg"), &Default::default()).unwrap();
    Learnt::none(prior.id()).add(&update).unwrap();
    // The topside shows what the vehicle expects.
    dive.run("decode --prior prior.nvsg --packets packets --frames shown").ends_with(0);
    let picture = |folder: &str, frame: usize| dive.picture(&format!("{folder}/{frame:04}.png"));
    for frame in 1..=FRAMES {
        assert!(picture("shown", frame) == picture("expected", frame), "frame {frame}");
    }
    // Both sides keep the same, and it is enough to decode by.
    let kept = UpdateChain::open(&dive.path("packets/dive.nvsu")).unwrap();
    assert!(kept.left_out.is_none() && kept.chain.updates().contains(&update));
    assert_eq!(dive.bytes("shown/dive.nvsu"), dive.bytes("packets/dive.nvsu"));
    let decode = "decode --prior prior.nvsg --packets packets --frames by-chain";
    dive.run(&format!("{decode} --updates packets/dive.nvsu")).ends_with(0);
    for frame in 1..=FRAMES {
        assert!(picture("by-chain", frame) == picture("expected", frame), "frame {frame}");
    }
    assert_eq!(dive.bytes("by-chain/dive.nvsu"), dive.bytes("packets/dive.nvsu"));
    // Without the updates it says which pictures are not the vehicle's.
    std::fs::create_dir(dive.path("none")).unwrap();
    let decode = "decode --prior prior.nvsg --packets packets --frames alone --updates none";
    let run = dive.run(decode).ends_with(0).says("which this side does not hold");
    let drawn_with = FRAMES - 1 - first;
    assert!(run.stdout.contains(&format!("{drawn_with} pictures are renders")), "{}", run.stdout);
    assert!(picture("alone", FRAMES) != picture("expected", FRAMES));
    // The same frames give the same updates.
    dive.run(&format!("{ENCODE} --packets again")).ends_with(0);
    assert_eq!(dive.bytes(&name.replace("packets", "again")), dive.bytes(&name));
    begins_anew(&dive, &update);
    goes_on(&dive, &frames[0]);
}

/// A vehicle that was started again has learnt from the prior alone: its first update stands on that.
fn begins_anew(dive: &Dive, first: &Update) {
    let anew = Update { frames: [1, 2], ..first.clone() };
    let path = dive.path(&format!("packets/{FRAMES:04}.nvsu"));
    assert!(!path.exists());
    anew.save(&path).unwrap();
    dive.run("decode --prior prior.nvsg --packets packets --frames anew").ends_with(0);
    let kept = UpdateChain::open(&dive.path("anew/dive.nvsu")).unwrap();
    assert_eq!(kept.chain.updates(), [anew]);
    std::fs::remove_file(path).unwrap();
}

/// The next dive begins with what both sides kept of the first one.
fn goes_on(dive: &Dive, first: &Value) {
    let learnt = "--learnt packets/dive.nvsu";
    let files = "--packets next --summary next.json --frames-out next-expected --limit 2";
    let encode = ENCODE.replace(" --learn", "");
    dive.run(&format!("{encode} {learnt} {files}")).ends_with(0);
    let summary = dive.json("next.json");
    assert!(number(&summary["frames"][0], "bytes") < 0.9 * number(first, "bytes"), "{summary}");
    // The chain goes on from there; nothing is new within two frames.
    assert_eq!(dive.bytes("next/dive.nvsu"), dive.bytes("packets/dive.nvsu"));
    let decode = "decode --prior prior.nvsg --packets next --frames next-shown";
    dive.run(&format!("{decode} {learnt}")).ends_with(0);
    for frame in ["0001.png", "0002.png"] {
        let [shown, expected] = ["next-shown", "next-expected"].map(|f| format!("{f}/{frame}"));
        assert!(dive.picture(&shown) == dive.picture(&expected), "{frame}");
    }
    // What another dive left is kept, too.
    std::fs::write(dive.path("next/dive.nvsu"), "an earlier one").unwrap();
    let run = dive.run(&format!("{encode} {learnt} {files}")).ends_with(0);
    run.says("next/dive.nvsu: of an earlier dive; it is now next/dive.nvsu.before");
    assert_eq!(dive.bytes("next/dive.nvsu.before"), b"an earlier one");
    assert_eq!(dive.bytes("next/dive.nvsu"), dive.bytes("packets/dive.nvsu"));
    // What is no updates is refused.
    let wrong = |path: &str, says: &str| {
        dive.run(&format!("{decode} --updates {path}")).ends_with(1).says(says);
    };
    wrong("none-there", "none-there: ");
    wrong("next/0001.nvsp", "next/0001.nvsp: --updates takes a folder, or a dive.nvsu");
    // Updates of another prior are refused.
    let run = dive.run(&format!("{encode} {learnt} {files}").replace("prior.nvsg", "prior.ply"));
    run.ends_with(1).says("packets/dive.nvsu: an update of prior ");
}
