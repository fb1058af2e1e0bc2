//! White balance and CLAHE: `map` states them in the prior, and what the other commands make of that.

use nvsprior::image::{Clahe, Preprocessing};
use nvsprior::prior::compact::{self, Quantisation};

use crate::dive::{Dive, FRAMES, pictures};
use crate::scene::{wall, write_prior};
use crate::study::row;
use crate::treated::{open, preprocessed, preprocessing, treated, treated_by_hand};

#[test]
fn map_treats_its_pictures_and_states_it_in_the_prior() {
    const MAP: &str = "map --cameras cameras.json --split dive --splats 400 --iterations 40";
    let dive = Dive::new();
    for out in ["a.ply", "a.nvsg"] {
        let command = format!("{MAP} --white-balance --clahe 3 --out {out} --report report");
        dive.run(&command).ends_with(0);
        assert_eq!(open(&dive, out).preprocessing(), &preprocessing(), "{out}");
        let text = dive.run(&format!("inspect {out}")).ends_with(0).stdout;
        let expected = "gray-world white balance, then CLAHE with clip limit 3 in 8×8 tiles";
        assert_eq!(row(&text, "preprocessing"), expected);
    }
    // The same splats as from pictures that were treated before.
    let by_hand = treated_by_hand();
    by_hand.run(&format!("{MAP} --out b.ply --report report")).ends_with(0);
    let (stated, plain) = (open(&dive, "a.ply"), open(&by_hand, "b.ply"));
    assert_eq!((stated.id(), stated.splats()), (plain.id(), plain.splats()));
    assert!(plain.preprocessing().is_none());
    assert_eq!(dive.bytes("report/preview.png"), by_hand.bytes("report/preview.png"));
    let text = by_hand.run("inspect b.ply").ends_with(0).stdout;
    assert_eq!(row(&text, "preprocessing"), "none");
    // The limit is 2 unless it is given.
    dive.run(&format!("{MAP} --iterations 1 --clahe --out c.ply").replace("--iterations 40", ""))
        .ends_with(0);
    let expected = Preprocessing { clahe: Some(Clahe::default()), ..Preprocessing::NONE };
    assert_eq!(open(&dive, "c.ply").preprocessing(), &expected);
    for limit in ["0.5", "300", "much", "nan"] {
        dive.run(&format!("{MAP} --clahe {limit} --out d.ply")).ends_with(2).says("--clahe");
    }
}

#[test]
fn encode_treats_frames_unless_they_are_treated() {
    let (dive, by_hand) = (preprocessed(), treated_by_hand());
    let output = "--starts camera-file --pictures seen --sheet sheet.png";
    let expected = by_hand.encode(output);
    let packet = |t: usize| format!("packets/{t}.nvsp");
    let packets: Vec<_> = (0..FRAMES).map(|t| by_hand.bytes(&packet(t))).collect();
    let sheet = by_hand.bytes("sheet.png");
    let check = |dive: &Dive, args: &str| {
        let found = dive.encode(&format!("{output} {args}"));
        for t in 0..FRAMES {
            assert_eq!(dive.bytes(&packet(t)), packets[t], "frame {t}");
            assert_eq!(found["frames"][t]["psnr"], expected["frames"][t]["psnr"]);
        }
        // The sheet shows what was encoded.
        assert_eq!(dive.bytes("sheet.png"), sheet);
    };
    check(&dive, "");
    write_prior(&by_hand.path("plain.ply"), &wall(1));
    write_prior(&by_hand.path("prior.ply"), &wall(1).with_preprocessing(preprocessing()));
    check(&by_hand, "--frames-treated");
    // The topside needs no preprocessing.
    by_hand
        .run("decode --prior plain.ply --packets packets --overwrite --frames topside")
        .ends_with(0);
    for t in 0..FRAMES {
        let [seen, topside] = ["seen", "topside"].map(|d| by_hand.picture(&format!("{d}/{t}.png")));
        assert_eq!(seen, topside, "frame {t}");
        let frame = &pictures()[t];
        assert!(topside.psnr(&treated(frame)) > topside.psnr(frame), "frame {t}");
    }
}

#[test]
fn copies_and_reduced_priors_keep_it() {
    let dive = preprocessed();
    let prior = open(&dive, "prior.ply");
    let mut bytes = Vec::new();
    let q = Quantisation::default();
    compact::write(prior.splats(), &prior.besides(), &q, &mut bytes).unwrap();
    std::fs::write(dive.path("prior.nvsg"), bytes).unwrap();
    for command in [
        "key-frames prior.ply --cameras cameras.json --cover 0 --out own.nvsg",
        "key-frames prior.nvsg --cameras cameras.json --cover 0 --out keys.nvsg",
        "prior tables --cameras cameras.json --steps 1 --prior prior.nvsg --out tables.nvsg",
        "prior trim prior.ply --cameras cameras.json --steps 1 --out trimmed.ply",
        "prior trim prior.nvsg --cameras cameras.json --steps 1 --out trimmed.nvsg",
    ] {
        dive.run(command).ends_with(0);
        let out = command.rsplit(' ').next().unwrap();
        assert_eq!(open(&dive, out).preprocessing(), &preprocessing(), "{out}");
    }
}
