use super::*;
use crate::coder_tables::Pair;
use nvsprior::Picture;
use nvsprior::coder_tables::Tables;
use nvsprior::render::filter::definition::filtered;

/// A frame with stripes that its render does not have.
fn pair(seed: u64) -> Pair {
    let mut random = Random::new(seed);
    let mut render = Picture::new(64, 64);
    render.data.iter_mut().for_each(|byte| *byte = 100 + (random.bits() % 30) as u8);
    let mut frame = render.clone();
    let phase = (random.bits() % 9) as usize;
    for (at, byte) in frame.data.iter_mut().enumerate() {
        let column = at / 3 % 64 + phase;
        *byte += if column % 9 < 4 { 60 } else { 0 };
    }
    Pair { frame, render }
}

#[test]
fn a_trained_filter_helps_on_other_pictures() {
    let pairs: Vec<_> = (0..6).map(pair).collect();
    let examples = filter_examples(&pairs, &Tables::generic(), 6, 1);
    assert!(examples.iter().all(|example| example.decoded.len() == 6));
    let (learned, held_out) = examples.split_at(4);
    let options = FilterOptions { steps: 200, ..FilterOptions::default() };
    let mut losses = Vec::new();
    let weights = train_filter(&[learned], None, &options, |_, loss| losses.push(loss)).unwrap();
    assert!(losses[1] < losses[0], "{losses:?}");
    let square = |a: &Picture, b: &Picture| -> f64 {
        a.data.iter().zip(&b.data).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum()
    };
    let (mut before, mut after) = (0.0, 0.0);
    for example in held_out {
        for (step, decoded) in &example.decoded {
            before += square(decoded, &example.frame);
            let shown = filtered(&weights, *step, &example.render, decoded);
            after += square(&shown, &example.frame);
        }
    }
    assert!(after < 0.95 * before, "{after} for {before}");
}

#[test]
fn the_same_input_gives_the_same_weights() {
    let examples = filter_examples(&[pair(0)], &Tables::generic(), 6, 1);
    let options = FilterOptions { steps: 10, ..FilterOptions::default() };
    let train = || train_filter(&[&examples], None, &options, |_, _| ()).unwrap();
    assert_eq!(train(), train());
}
