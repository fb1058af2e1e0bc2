//! Maps of any marks come back, say no less than what is true, and keep to their limits.

use proptest::prelude::*;

use crate::Picture;
use crate::image::Mask;
use crate::random::Random;

use super::marks::{Comparison, Mark, Marks};
use super::*;

const SIZE: (u32, u32) = (150, 90);

fn grey(value: u8) -> Picture {
    let mut picture = Picture::new(SIZE.0, SIZE.1);
    picture.data.fill(value);
    picture
}

/// A picture with rectangles that are off by some amount.
fn with_spots(spots: &[(u32, u32, u32, u32, u8)]) -> Picture {
    let mut picture = grey(100);
    for (left, top, width, height, by) in spots {
        for y in *top..(top + height).min(SIZE.1) {
            for x in *left..(left + width).min(SIZE.0) {
                let at = 3 * (y * SIZE.0 + x) as usize;
                picture.data[at..at + 3].fill(100 + by);
            }
        }
    }
    picture
}

fn spots() -> impl Strategy<Value = Vec<(u32, u32, u32, u32, u8)>> {
    proptest::collection::vec((0..SIZE.0, 0..SIZE.1, 1..70_u32, 1..70_u32, 0..120_u8), 0..5)
}

/// The worst window whose centre lies in each block, found the long way.
fn worst_windows(frame: &Picture, shown: &Picture) -> Vec<f64> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    let block = BLOCK as usize;
    let (across, down) = (block.min(width), block.min(height));
    let columns = width.div_ceil(block);
    let mut worst = vec![0.0_f64; columns * height.div_ceil(block)];
    let rms = |left: usize, top: usize, right: usize, bottom: usize| {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in top..bottom {
            for at in 3 * (y * width + left)..3 * (y * width + right) {
                sum += (f64::from(frame.data[at]) - f64::from(shown.data[at])).powi(2);
                count += 1.0;
            }
        }
        f64::sqrt(sum / count)
    };
    for top in 0..=height - down {
        for left in 0..=width - across {
            let index = (top + down / 2) / block * columns + (left + across / 2) / block;
            worst[index] = worst[index].max(rms(left, top, left + across, top + down));
        }
    }
    for (index, worst) in worst.iter_mut().enumerate() {
        let (left, top) = (index % columns * block, index / columns * block);
        *worst = worst.max(rms(left, top, (left + block).min(width), (top + block).min(height)));
    }
    worst
}

#[test]
fn blocks_have_the_level_of_their_worst_window() {
    let frame = grey(100);
    // A window that lies across four blocks: its centre is in one of them.
    for (spot, levels) in [
        ((8, 8, 16, 16, 30), 1..5),
        ((16, 16, 16, 16, 20), 1..2),
        ((140, 80, 10, 10, 40), 1..5),
        ((3, 3, 2, 2, 100), 0..1),
    ] {
        let shown = with_spots(&[spot]);
        let mut marks = Marks::new(SIZE.0, SIZE.1);
        let mut comparison = Comparison::new(SIZE.0, SIZE.1);
        comparison.mark(&frame, [&shown, &frame], None, THRESHOLDS[0], &mut marks);
        for (index, worst) in worst_windows(&frame, &shown).iter().enumerate() {
            let mark = marks.marks[index];
            assert_eq!(*worst > 28.0, mark == Mark::Wrong, "{spot:?}: block {index}, {worst}");
            assert_eq!(*worst > 16.0, mark >= Mark::Differs, "{spot:?}: block {index}, {worst}");
        }
        let off = marks.marks.iter().filter(|mark| mark.is_off()).count();
        assert!(levels.contains(&off), "{spot:?}: {off}");
    }
}

#[test]
fn pictures_of_any_size_are_compared() {
    let mut random = Random::new(3);
    let sizes =
        [(1, 1), (7, 5), (5, 40), (40, 5), (16, 16), (17, 16), (48, 33), (33, 48), (31, 31)];
    for (width, height) in sizes {
        let mut picture = || {
            let mut picture = Picture::new(width, height);
            picture.data.fill_with(|| random.bits() as u8);
            picture
        };
        let (frame, shown) = (picture(), picture());
        let mut comparison = Comparison::new(width, height);
        // Twice: what was compared before does not matter.
        comparison.worst(&shown.data, &frame.data);
        let found = comparison.worst(&frame.data, &shown.data);
        let expected = worst_windows(&frame, &shown);
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-3, "{width}×{height}: {found}");
        }
    }
}

#[test]
fn masked_pixels_have_no_error() {
    let (frame, shown) = (grey(100), with_spots(&[(32, 32, 40, 40, 90)]));
    let mut mask = Mask::all(SIZE.0, SIZE.1);
    for y in 32..72 {
        mask.data[y * SIZE.0 as usize + 32..][..40].fill(false);
    }
    let mut encoder = TruthEncoder::new(SIZE.0, SIZE.1);
    let compared =
        Compared { frame: &frame, picture: &shown, base: Base::Picture, mask: Some(&mask) };
    assert_eq!(encoder.compare(0, &compared), 1);
    assert_eq!(encoder.encode(0, 6), Some(&[0][..]));
    let needed = encoder.compare(1, &Compared { mask: None, ..compared });
    assert!(needed > 1);
    assert_eq!(encoder.encode(1, needed).map(<[u8]>::len), Some(needed));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_map_by_which_no_block_differs_takes_three_bytes_at_most(
        renders in proptest::collection::vec(spots(), 1..12),
    ) {
        let frame = grey(100);
        let mut encoder = TruthEncoder::new(SIZE.0, SIZE.1);
        for (number, render) in (0..).zip(&renders) {
            let render = with_spots(render);
            let base = Base::Render(&render);
            let compared = Compared { frame: &frame, picture: &frame, base, mask: None };
            prop_assert!(encoder.compare(number, &compared) <= 3);
            prop_assert!(encoder.encode(number, 3).is_some());
        }
    }

    #[test]
    fn a_map_says_what_is_true_or_more(
        runs in proptest::collection::vec((spots(), spots(), 1..60_usize, 1..18_u32, 0..10), 1..20),
    ) {
        let frame = grey(100);
        let mut encoder = TruthEncoder::new(SIZE.0, SIZE.1);
        let mut decoder = TruthDecoder::new(SIZE.0, SIZE.1);
        let mut number = 7;
        let mut lost = false;
        for (picture, render, limit, step, fate) in runs {
            number += step;
            let (picture, render) = (with_spots(&picture), with_spots(&render));
            let compared =
                Compared { frame: &frame, picture: &picture, base: Base::Render(&render), mask: None };
            encoder.compare(number, &compared);
            let Some(bytes) = encoder.encode(number, limit) else {
                prop_assert!(limit < 10, "{} bytes hold a map", limit);
                continue;
            };
            prop_assert!(bytes.len() <= limit);
            let bytes = bytes.to_vec();
            // What follows it does not matter, and it tells its end.
            let (map, rest) = crate::packet::truth::split(&[&bytes[..], &[1, 2, 3]].concat())
                .map(|(map, rest)| (map.to_vec(), rest.to_vec())).unwrap();
            prop_assert_eq!((&map, &rest[..]), (&bytes, &[1, 2, 3][..]));
            let is_key = bytes[0] & crate::packet::truth::PREDICTED == 0;
            if fate == 0 {
                lost |= is_key;
                continue;
            }
            let whole = fate > 3;
            // Of a picture that is cut, what came changed all of the render a little, or nothing.
            let by = if fate == 1 { 9 } else { 0 };
            let cut = render.data.iter().map(|v| v.saturating_add(by)).collect::<Vec<u8>>();
            let arrived = match whole {
                true => Arrived::All,
                false => Arrived::Start { render: &render.data, picture: &cut },
            };
            let mut found = TruthMap::not_seen(SIZE.0, SIZE.1);
            let read = decoder.decode(number, &bytes, arrived, &mut found);
            prop_assert!(read || lost && !is_key, "it is read unless its key map was lost");
            lost &= !is_key;
            let worst = [&picture, &render].map(|shown| worst_windows(&frame, shown));
            for (index, level) in found.levels.iter().enumerate() {
                let [picture, render] = [worst[0][index], worst[1][index]];
                match (read, level) {
                    (false, level) => prop_assert_eq!(*level, 3),
                    (_, 0) if whole => prop_assert!(picture < 16.01),
                    (_, 0) => prop_assert!(by == 0 && picture < 16.01 && render < 12.81),
                    (_, 1) => prop_assert!(whole && picture < 28.01),
                    (_, level) => {
                        let most = if whole { 2 } else { 3 };
                        prop_assert_eq!(*level, most);
                    }
                }
            }
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(
        bytes in proptest::collection::vec(any::<u8>(), 0..40), frame: u32,
    ) {
        let mut decoder = TruthDecoder::new(SIZE.0, SIZE.1);
        let mut found = TruthMap::not_seen(SIZE.0, SIZE.1);
        if !decoder.decode(frame, &bytes, Arrived::All, &mut found) {
            prop_assert_eq!(found, TruthMap::not_seen(SIZE.0, SIZE.1));
        }
    }
}
