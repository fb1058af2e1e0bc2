use proptest::prelude::*;

use super::*;
use crate::random::Random;

const BOTH: Preprocessing = Preprocessing {
    white_balance: WhiteBalance::GrayWorld,
    clahe: Some(Clahe { clip_limit: 2.0, tiles: 8 }),
};

fn clahe(clip_limit: f32, tiles: u8) -> Preprocessing {
    Preprocessing { clahe: Some(Clahe::new(clip_limit, tiles).unwrap()), ..Preprocessing::NONE }
}

fn treated(picture: &Picture, preprocessing: &Preprocessing) -> Picture {
    let mut treated = picture.clone();
    Preprocessor::new(preprocessing).apply(&mut treated);
    treated
}

fn one_colour(width: u32, height: u32, rgb: [u8; 3]) -> Picture {
    let count = width as usize * height as usize;
    Picture::from_rgb(width, height, rgb.repeat(count)).unwrap()
}

/// A dark, green scene of soft shapes and noise.
fn murky(width: u32, height: u32, seed: u64) -> Picture {
    let mut picture = Picture::new(width, height);
    let mut random = Random::at(seed);
    for (at, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = ((at % width as usize) as f32, (at / width as usize) as f32);
        let light = 0.5 + 0.3 * (0.09 * x).sin() * (0.13 * y).cos() + 0.002 * x;
        for (value, (gain, offset)) in rgb.iter_mut().zip([(18.0, 2.0), (60.0, 6.0), (45.0, 4.0)]) {
            *value = (gain * light + offset + random.within(-2.0, 2.0)) as u8;
        }
    }
    picture
}

/// Gray world as its definition says, in f64.
fn gray_world_f64(picture: &Picture) -> Vec<f64> {
    let pixels = picture.data.len() as f64 / 3.0;
    let mean = |channel: usize| {
        let values = picture.data.iter().skip(channel).step_by(3);
        values.map(|v| f64::from(*v)).sum::<f64>() / pixels
    };
    let means = [mean(0), mean(1), mean(2)];
    let grey = means.iter().sum::<f64>() / 3.0;
    let gain = |channel: usize| (grey / means[channel].max(1e-9)).min(4.0);
    let balanced = |(i, v): (usize, &u8)| (f64::from(*v) * gain(i % 3)).min(255.0);
    picture.data.iter().enumerate().map(balanced).collect()
}

/// CLAHE as its definition says, in f64, pixel by pixel.
fn clahe_f64(picture: &Picture, clip_limit: f64, tiles: usize) -> Vec<f64> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let weights = [19_595.0, 38_470.0, 7_471.0].map(|w| w / 65_536.0);
    let rgb = |x: usize, y: usize| -> [f64; 3] {
        std::array::from_fn(|c| f64::from(picture.data[3 * (y * width + x) + c]))
    };
    let luma = |x, y| {
        let [r, g, b] = rgb(x, y);
        (weights[0] * r + weights[1] * g + weights[2] * b).round()
    };
    let (across, down) = (tiles.min(width), tiles.min(height));
    let bounds =
        |tile: usize, tiles: usize, side: usize| (tile * side / tiles, (tile + 1) * side / tiles);
    // What a tile makes of a level.
    let curve = |column: usize, row: usize, level: f64| {
        let ((left, right), (top, bottom)) =
            (bounds(column, across, width), bounds(row, down, height));
        let mut histogram = [0.0; 256];
        for y in top..bottom {
            for x in left..right {
                histogram[luma(x, y) as usize] += 1.0;
            }
        }
        let area: f64 = histogram.iter().sum();
        let limit = clip_limit * area / 256.0;
        let excess: f64 = histogram.iter().map(|count| (count - limit).max(0.0)).sum();
        let bins = &histogram[..=level as usize];
        255.0 / area * bins.iter().map(|count| count.min(limit) + excess / 256.0).sum::<f64>()
    };
    // The two tiles along a side whose middles are around a pixel, and the weight of the second.
    let around = |at: usize, tiles: usize, side: usize| {
        let middle = |tile| {
            let (from, to) = bounds(tile, tiles, side);
            (from + to) as f64 / 2.0
        };
        let at = at as f64 + 0.5;
        if at <= middle(0) {
            return (0, 0, 0.0);
        }
        let first = (0..tiles).rev().find(|tile| middle(*tile) <= at).unwrap();
        let second = (first + 1).min(tiles - 1);
        let apart = middle(second) - middle(first);
        (first, second, if apart > 0.0 { (at - middle(first)) / apart } else { 0.0 })
    };
    let mut equalised = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (left, right, u) = around(x, across, width);
            let (top, bottom, v) = around(y, down, height);
            let level = luma(x, y);
            let above = (1.0 - u) * curve(left, top, level) + u * curve(right, top, level);
            let below = (1.0 - u) * curve(left, bottom, level) + u * curve(right, bottom, level);
            let change = (1.0 - v) * above + v * below - level;
            equalised.extend(rgb(x, y).map(|value| (value + change).clamp(0.0, 255.0)));
        }
    }
    equalised
}

fn greatest_difference(found: &Picture, expected: &[f64]) -> f64 {
    assert_eq!(found.data.len(), expected.len());
    let differences = found.data.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs());
    differences.fold(0.0, f64::max)
}

#[test]
fn white_balance_is_its_definition() {
    let gray_world = Preprocessing { clahe: None, ..BOTH };
    for (width, height) in [(96, 54), (7, 5), (1, 1)] {
        let picture = murky(width, height, 3);
        let found = treated(&picture, &gray_world);
        let difference = greatest_difference(&found, &gray_world_f64(&picture));
        // Half a level, and half a step of the gain.
        assert!(difference <= 0.5 + 255.0 / 8192.0, "{width}×{height}: {difference}");
    }
}

#[test]
fn channel_means_match_after_white_balance() {
    let found = treated(&murky(96, 54, 3), &Preprocessing { clahe: None, ..BOTH });
    let sum = |c: usize| found.data.iter().skip(c).step_by(3).map(|v| f64::from(*v)).sum::<f64>();
    let means = [0, 1, 2].map(|c| sum(c) / (96.0 * 54.0));
    assert!(means.iter().all(|mean| (mean - means[0]).abs() < 0.5), "{means:?}");
}

#[test]
fn gains_are_bounded() {
    let gray_world = Preprocessing { clahe: None, ..BOTH };
    let colour = |rgb| treated(&one_colour(9, 9, rgb), &gray_world).data[..3].to_vec();
    // The mean is 68; red of 3 would need a gain of 22.7.
    assert_eq!(colour([3, 1, 200]), [12, 4, 68]);
    assert_eq!(colour([0, 0, 90]), [0, 0, 30]);
    assert_eq!(colour([100, 150, 200]), [150, 150, 150]);
    assert_eq!(colour([0, 0, 0]), [0, 0, 0]);
    assert_eq!(colour([255, 255, 255]), [255, 255, 255]);
}

#[test]
fn equalisation_is_its_definition() {
    // Sizes that tiles do not divide, and fewer pixels than tiles.
    for (width, height, clip_limit, tiles) in [
        (64, 32, 2.0, 8),
        (61, 37, 3.5, 8),
        (61, 37, 1.0, 5),
        (40, 30, 256.0, 4),
        (33, 5, 2.0, 8),
        (5, 3, 40.0, 32),
        (1, 1, 2.0, 8),
    ] {
        let picture = murky(width, height, u64::from(width));
        let found = treated(&picture, &clahe(clip_limit, tiles));
        let expected = clahe_f64(&picture, clip_limit.into(), tiles.into());
        let difference = greatest_difference(&found, &expected);
        // Half a level each for curves and result; steps of the weights of tiles.
        assert!(difference <= 1.1, "{width}×{height}, {clip_limit}, {tiles}: {difference}");
    }
}

#[test]
fn white_balance_comes_first() {
    let picture = murky(64, 36, 11);
    let balanced = treated(&picture, &Preprocessing { clahe: None, ..BOTH });
    let equalised_last = treated(&balanced, &clahe(2.0, 8));
    assert_eq!(treated(&picture, &BOTH), equalised_last);
    assert_ne!(equalised_last, balanced);
    assert_ne!(balanced, picture);
    assert_eq!(treated(&picture, &Preprocessing::NONE), picture);
}

#[test]
fn dark_scenes_become_bright_and_keep_their_chroma() {
    let picture = murky(320, 180, 5);
    let found = treated(&picture, &clahe(4.0, 8));
    let deviation = |picture: &Picture| {
        let values = || picture.data.iter().map(|v| f64::from(*v));
        let mean = values().sum::<f64>() / picture.data.len() as f64;
        (values().map(|v| (v - mean).powi(2)).sum::<f64>() / picture.data.len() as f64).sqrt()
    };
    assert!(deviation(&found) > 1.5 * deviation(&picture), "{}", deviation(&found));
    for (before, after) in picture.data.chunks_exact(3).zip(found.data.chunks_exact(3)) {
        if after.iter().all(|v| (1..255).contains(v)) {
            let chroma = |rgb: &[u8]| [0, 2].map(|c| i16::from(rgb[c]) - i16::from(rgb[1]));
            assert_eq!(chroma(before), chroma(after));
        }
    }
}

#[test]
fn the_bytes_are_the_same_everywhere() {
    // x86-64 and aarch64 gave them, and an implementation in Python.
    let mut random = Random::new(1);
    let mut picture = Picture::new(320, 180);
    for (at, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
        let light = 10 + at % 320 / 9 + at / 3200;
        rgb.copy_from_slice(
            &[light / 2, light, light * 3 / 4].map(|v| v as u8 + (random.bits() % 5) as u8),
        );
    }
    let sum = |preprocessing| crc32fast::hash(&treated(&picture, preprocessing).data);
    let found = [sum(&BOTH), sum(&clahe(3.3, 5)), sum(&Preprocessing::NONE)];
    assert_eq!(found.map(|sum| format!("{sum:08x}")), ["a17bafcf", "e4817b36", "f38418b9"]);
}

#[test]
fn limits_are_checked() {
    for clip_limit in [0.0, 0.99, 256.5, -1.0, f32::NAN, f32::INFINITY] {
        let error = Clahe::new(clip_limit, 8).unwrap_err();
        assert!(matches!(error, PreprocessingError::ClipLimit { .. }), "{error}");
    }
    for tiles in [0, 33, 255] {
        let error = Clahe::new(2.0, tiles).unwrap_err();
        assert_eq!(error, PreprocessingError::Tiles { found: tiles });
    }
    assert_eq!(Clahe::new(2.0, 8), Ok(Clahe::default()));
    assert_eq!(Clahe::new(2.001, 8).unwrap().clip_limit(), 2.0);
}

#[test]
fn said_in_words() {
    let words = |preprocessing: Preprocessing| preprocessing.to_string();
    assert_eq!(words(Preprocessing::NONE), "none");
    assert_eq!(words(Preprocessing { clahe: None, ..BOTH }), "gray-world white balance");
    assert_eq!(
        words(Preprocessing { clahe: Some(Clahe::new(2.5, 4).unwrap()), ..BOTH }),
        "gray-world white balance, then CLAHE with clip limit 2.5 in 4×4 tiles"
    );
    assert_eq!(words(clahe(3.0, 8)), "CLAHE with clip limit 3 in 8×8 tiles");
}

#[test]
fn nothing_is_allocated_for_a_picture_no_larger_than_before() {
    let mut preprocessor = Preprocessor::new(&BOTH);
    let mut apply = |width, height| {
        preprocessor.apply(&mut murky(width, height, 2));
        preprocessor.equaliser.as_ref().map(Equaliser::buffers)
    };
    let first = apply(64, 48);
    for (width, height) in [(64, 48), (32, 20), (3, 2), (64, 48)] {
        assert_eq!(apply(width, height), first);
    }
    preprocessor.apply(&mut Picture::new(0, 7));
}

#[test]
fn what_is_masked_changes_nothing_else() {
    let plain = murky(97, 61, 5);
    let mut mask = Mask::all(97, 61);
    for (at, counts) in mask.data.iter_mut().enumerate() {
        *counts = at % 97 + at / 97 < 90;
    }
    let treated_by = |arm: [u8; 3]| {
        let mut picture = plain.clone();
        mask.each_masked(&mut picture.data, |_, rgb| rgb.copy_from_slice(&arm));
        let mut without = picture.clone();
        Preprocessor::new(&BOTH).apply(&mut without);
        Preprocessor::new(&BOTH).apply_by(&mut picture, Some(&mask));
        for treated in [&mut picture, &mut without] {
            mask.each_masked(&mut treated.data, |_, rgb| rgb.fill(0));
        }
        (picture, without)
    };
    let (bright, bright_without) = treated_by([250, 240, 10]);
    let (dark, dark_without) = treated_by([0, 0, 0]);
    assert_eq!(bright, dark, "the arm's colour does not matter");
    assert_ne!(bright_without, dark_without, "without the mask it does");
    let mut all = plain.clone();
    Preprocessor::new(&BOTH).apply_by(&mut all, Some(&Mask::all(97, 61)));
    assert_eq!(all, treated(&plain, &BOTH));
}

proptest! {
    #[test]
    fn one_colour_stays_one_colour(
        rgb: [u8; 3], width in 1u32..70, height in 1u32..40, clip_limit in 1f32..8.0,
        tiles in 1u8..=32,
    ) {
        let picture = one_colour(width, height, rgb);
        let found = treated(&picture, &clahe(clip_limit, tiles));
        let first = &found.data[..3];
        prop_assert!(found.data.chunks_exact(3).all(|pixel| pixel == first));
        for (before, after) in rgb.into_iter().zip(first) {
            // The colour's bin holds `clip_limit` of the mean in place of 1: no more than that is added.
            let change = f32::from(*after) - f32::from(before);
            prop_assert!((-1.0..=clip_limit + 1.5).contains(&change), "{before} → {after}");
        }
    }

    #[test]
    fn any_picture_is_treated(
        width in 1u32..50, height in 1u32..50, seed: u64, clip_limit in 1f32..=256.0,
        tiles in 1u8..=32,
    ) {
        let mut random = Random::at(seed);
        let mut picture = Picture::new(width, height);
        picture.data.fill_with(|| random.within(0.0, 256.0) as u8);
        let both = Preprocessing { white_balance: WhiteBalance::GrayWorld, ..clahe(clip_limit, tiles) };
        let found = treated(&picture, &both);
        prop_assert_eq!(found.data.len(), picture.data.len());
        prop_assert_eq!(&treated(&picture, &both), &found);
    }

    #[test]
    fn one_tile_keeps_the_order_of_levels(seed: u64, clip_limit in 1f32..=256.0) {
        let mut random = Random::at(seed);
        let mut picture = Picture::new(30, 20);
        for grey in picture.data.chunks_exact_mut(3) {
            grey.fill(random.within(0.0, 256.0).powf(random.within(0.5, 1.0)) as u8);
        }
        let found = treated(&picture, &clahe(clip_limit, 1));
        let mut levels: Vec<_> = picture.data.iter().zip(&found.data).collect();
        levels.sort_unstable();
        prop_assert!(levels.windows(2).all(|pair| pair[0].1 <= pair[1].1));
    }
}
