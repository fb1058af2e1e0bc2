//! `nvsprior prior filter`, and `decode --filter`.

use nvsprior::Prior;
use nvsprior::filter_weights::{FRACTION, FilterWeights};
use nvsprior::prior::{Extras, extras_file};

use crate::dive::{Dive, FRAMES};
use crate::study::row;

const FILTER: &str = "prior filter --cameras cameras.json --steps 100 --prior";

fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}

#[test]
fn trained_beside_the_prior_and_needed_on_one_side() {
    let dive = Dive::new();
    dive.encode("--bytes 300 --pictures seen");
    let id = open(&dive, "prior.ply").id();
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    assert_eq!(row(&text, "display filter"), "the library's own, for any scene");
    // A damaged file is named, and replaced.
    std::fs::write(dive.path("prior.ply.nvsx"), "broken").unwrap();
    dive.run("inspect prior.ply").ends_with(1).says("prior.ply.nvsx: neither");
    let text = dive.run(&format!("{FILTER} prior.ply")).ends_with(0).stdout;
    assert_eq!(row(&text, "frames"), "4, 4 certain: 3 learned from, 1 held out");
    let size = FilterWeights::encoded_len();
    assert!(row(&text, "written").starts_with("prior.ply.nvsx, "), "{text}");
    let prior = open(&dive, "prior.ply");
    assert_eq!(prior.id(), id, "it is no part of the prior's identity");
    assert_ne!(prior.filter_weights().map(|w| &**w), Some(&FilterWeights::generic()));
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    let expected = format!("the scene's own, {size} bytes");
    assert_eq!(row(&text, "display filter"), expected);
    // Packets from before it was there are filtered, or not, as the topside likes: here by weights that make all
    // pixels brighter by two levels.
    let mut layers = FilterWeights::zero().layers().to_vec();
    let last = layers.last_mut().unwrap();
    last.biases.iter_mut().for_each(|bias| bias[0] += 2 * FRACTION);
    let weights = Some(FilterWeights::new(layers).unwrap().into());
    let extras = Extras { filter_weights: weights, ..Extras::default() };
    let beside = extras_file::to_bytes(&extras, id, prior.len());
    std::fs::write(dive.path("prior.ply.nvsx"), beside).unwrap();
    let decode = "decode --prior prior.ply --packets packets --overwrite --frames";
    dive.run(&format!("{decode} plain")).ends_with(0);
    let text = dive.run(&format!("{decode} filtered --filter")).ends_with(0).stdout;
    assert!(
        text.contains(&format!("{FRAMES} pictures filtered, with the scene's weights")),
        "{text}"
    );
    for t in 0..FRAMES {
        let [seen, plain, filtered] =
            ["seen", "plain", "filtered"].map(|d| dive.picture(&format!("{d}/{t}.png")));
        assert_eq!(seen, plain, "frame {t}");
        let brighter = plain.data.iter().map(|byte| byte.saturating_add(2));
        assert!(filtered.data.iter().copied().eq(brighter), "frame {t}");
    }
}

#[test]
fn too_few_steps_are_refused() {
    let dive = Dive::new();
    dive.run("prior filter --prior prior.ply --cameras cameras.json --steps 99")
        .ends_with(2)
        .says("100");
}
