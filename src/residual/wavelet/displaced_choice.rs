//! The vehicle's choice of displaced blocks: where in the earlier picture each lies, and whether it pays.

use crate::Picture;
use crate::coder_tables::PLANES;

use super::displaced::{
    DisplacedBlocks, Displacement, Earlier, Kind, LONGEST, Of, PARTS, SIDE, displaced,
};
use super::fixed::ONE;
use super::geometry::Planes;
use super::small_blocks_choice::cost;
use super::step::Step;
use super::sub_pixel::{SubPixel, brightness_at};

/// A pyramid is as deep as brings the longer side below this, pixels.
const COARSE: usize = 100;
/// Most levels above the picture.
const MAX_LEVELS: usize = 5;
/// Half of the side of a window that is compared, pixels of its level; a block's at the finest.
const HALF: isize = 4;
/// How far displacements are sought, pixels of the coarsest level.
const REACH: isize = 10;
/// Levels of brightness, summed over a block, that two bits of a displacement must save.
const FAR: i64 = 24;
/// A block that costs no more than this is not looked at, bits as a feature.
const CHEAP: i64 = 12 * ONE as i64;
/// Bits of a displacement, beside those for its distance from the expected one; of no prediction.
const DISPLACED: i64 = 5 * ONE as i64;
const UNPREDICTED: i64 = 7 * ONE as i64;
/// All blocks must save this part of what the warped difference leaves.
const LEAST: i64 = 16;

/// A picture's brightness, and this at half, a quarter, … of its size.
struct Pyramid(Vec<Level>);

struct Level {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl Level {
    fn at(&self, x: isize, y: isize) -> i64 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        i64::from(self.data[y * self.width + x])
    }
}

impl Pyramid {
    fn new(width: usize, height: usize) -> Pyramid {
        let level = |shift: usize| {
            let [width, height] = [width, height].map(|len| (len >> shift).max(1));
            Level { width, height, data: vec![0; width * height] }
        };
        let deep = (0..MAX_LEVELS).find(|shift| width.max(height) >> shift < COARSE);
        Pyramid((0..=deep.unwrap_or(MAX_LEVELS)).map(level).collect())
    }

    /// Takes a picture whose pixels `value` gives, red, green and blue.
    fn set(&mut self, value: impl Fn(usize) -> [u8; 3]) {
        for (i, to) in self.0[0].data.iter_mut().enumerate() {
            let [r, g, b] = value(i).map(u32::from);
            *to = ((r + 2 * g + b + 2) / 4) as u8;
        }
        for coarse in 1..self.0.len() {
            let (finer, coarser) = self.0.split_at_mut(coarse);
            let (from, to) = (&finer[coarse - 1], &mut coarser[0]);
            for y in 0..to.height {
                for x in 0..to.width {
                    let [x2, y2] = [x, y].map(|v| 2 * v as isize);
                    let sum = from.at(x2, y2)
                        + from.at(x2 + 1, y2)
                        + from.at(x2, y2 + 1)
                        + from.at(x2 + 1, y2 + 1);
                    to.data[y * to.width + x] = ((sum + 2) / 4) as u8;
                }
            }
        }
    }
}

/// Chooses displaced blocks, in memory of its own.
pub struct DisplacementChooser {
    pictures: Search,
    differences: Search,
}

/// Looks for the parts of one picture in another.
struct Search {
    seen: Pyramid,
    shown: Pyramid,
}

/// What is chosen for.
pub struct Pictures<'a> {
    pub frame: &'a Picture,
    pub render: &'a Picture,
    /// Planes of the difference of both.
    pub difference: &'a Planes,
    pub earlier: &'a Earlier<'a>,
}

impl DisplacementChooser {
    /// For pictures of a size.
    pub fn new(width: usize, height: usize) -> DisplacementChooser {
        let pyramid = || Pyramid::new(width, height);
        let search = || Search { seen: pyramid(), shown: pyramid() };
        DisplacementChooser { pictures: search(), differences: search() }
    }

    /// Chooses what each block of a frame is predicted from, if it is coded at about a step.
    pub fn choose(&mut self, blocks: &mut DisplacedBlocks, pictures: &Pictures, step: Step) {
        let Pictures { frame, render, earlier, .. } = pictures;
        let pixel = |picture: &Picture, i: usize| picture.data.as_chunks::<3>().0[i];
        self.pictures.seen.set(|i| pixel(frame, i));
        self.pictures.shown.set(|i| pixel(earlier.shown, i));
        self.differences.seen.set(|i| {
            let (seen, render) = (pixel(frame, i), pixel(render, i));
            std::array::from_fn(|c| {
                (i16::from(seen[c]) - i16::from(render[c]) + 128).clamp(0, 255) as u8
            })
        });
        self.differences.shown.set(|i| pixel(earlier.difference, i));
        blocks.clear();
        let (mut before, mut after) = (0, 0);
        for at in 0..blocks.grid.len() {
            let (warped, chosen) = self.choose_block(blocks, at, pictures, step);
            (before, after) = (before + warped, after + chosen);
        }
        blocks.in_use = blocks.kinds.iter().any(|kind| *kind != Kind::Warped);
        if (before - after) * LEAST < before {
            blocks.clear();
        }
    }

    /// Chooses one block's kind. What the warped difference costs, and what is chosen.
    fn choose_block(
        &self,
        blocks: &mut DisplacedBlocks,
        at: usize,
        pictures: &Pictures,
        step: Step,
    ) -> (i64, i64) {
        let Pictures { render, difference, earlier, .. } = pictures;
        let width = render.width as usize;
        let pixels = blocks.pixels(at);
        let price = |value: &dyn Fn(usize, usize) -> [i32; PLANES]| {
            let left = |x: usize, y: usize| {
                let index = y * width + x;
                let predicted = value(x, y);
                std::array::from_fn(|plane| difference[plane][index] - predicted[plane])
            };
            block_price(&pixels, left, step)
        };
        let warped =
            price(&|x, y| std::array::from_fn(|plane| earlier.warped[plane][y * width + x]));
        let unpredicted = price(&|_, _| [0; PLANES]) + UNPREDICTED;
        let mut best = (warped, Kind::Warped);
        if unpredicted < best.0 {
            best = (unpredicted, Kind::Unpredicted);
        }
        if best.0 > CHEAP {
            let guess = blocks.guess(at);
            for (search, of) in [(&self.pictures, Of::Picture), (&self.differences, Of::Difference)]
            {
                let by = search.find(&pixels, guess);
                let bits = DISPLACED + i64::from(ONE) * bits_away(by, guess);
                let price = price(&|x, y| displaced(earlier, render, (x, y), by, of)) + bits;
                if price < best.0 {
                    best = (price, Kind::Displaced(by, of));
                }
            }
        }
        blocks.kinds[at] = best.1;
        (warped, best.0)
    }
}

impl Search {
    /// Where a block lies in the earlier picture, by brightness.
    fn find(&self, pixels: &[std::ops::Range<usize>; 2], guess: Displacement) -> Displacement {
        let deepest = self.seen.0.len() - 1;
        let [columns, rows] = pixels;
        let middle = |level: usize| {
            [columns, rows].map(|range| ((range.start + SIDE / 2) >> level) as isize)
        };
        let mut found = self.around(deepest, middle(deepest), [0; 2], REACH);
        for level in (0..deepest).rev() {
            found = self.around(level, middle(level), found.map(|v| 2 * v), 1);
        }
        let parts = i64::from(PARTS);
        let limit = |v: i64| v.clamp(-i64::from(LONGEST), i64::from(LONGEST)) as i16;
        let start = found.map(|v| limit(v as i64 * parts));
        let error = |by: Displacement| self.error_of(pixels, by) + FAR * bits_away(by, guess) / 2;
        let mut best = [start, guess, [0; 2]].map(|by| (error(by), by));
        best.sort_unstable_by_key(|(error, _)| *error);
        let mut best = best[0];
        for reach in [4, 2, 1] {
            let from = best.1;
            for [x, y] in around(reach) {
                let by = [limit(i64::from(from[0] + x)), limit(i64::from(from[1] + y))];
                let error = error(by);
                if error < best.0 {
                    best = (error, by);
                }
            }
        }
        best.1
    }

    /// The best displacement of a level at most so far from one, pixels of the level.
    fn around(
        &self,
        level: usize,
        middle: [isize; 2],
        from: [isize; 2],
        reach: isize,
    ) -> [isize; 2] {
        let (seen, shown) = (&self.seen.0[level], &self.shown.0[level]);
        let half = if level == 0 { SIDE as isize / 2 } else { HALF };
        let mut best = (i64::MAX, from);
        for dy in from[1] - reach..=from[1] + reach {
            for dx in from[0] - reach..=from[0] + reach {
                let mut error = (dx.abs() + dy.abs()) as i64;
                for y in middle[1] - half..middle[1] + half {
                    for x in middle[0] - half..middle[0] + half {
                        error += (seen.at(x, y) - shown.at(x + dx, y + dy)).abs();
                    }
                }
                if error < best.0 {
                    best = (error, [dx, dy]);
                }
            }
        }
        best.1
    }

    /// Sum of a block's differences in brightness from the earlier picture, displaced.
    fn error_of(&self, pixels: &[std::ops::Range<usize>; 2], by: Displacement) -> i64 {
        let (seen, shown) = (&self.seen.0[0], &self.shown.0[0]);
        let [columns, rows] = pixels;
        let mut error = 0;
        for y in rows.clone() {
            for x in columns.clone() {
                let place = SubPixel::displaced([x, y], by, PARTS);
                let there = brightness_at(&shown.data, (shown.width, shown.height), &place);
                error += (seen.at(x as isize, y as isize) - there).abs();
            }
        }
        error
    }
}

/// The eight places around one.
fn around(reach: i16) -> impl Iterator<Item = Displacement> {
    (0..9).filter(|i| *i != 4).map(move |i| [(i % 3 - 1) * reach, (i / 3 - 1) * reach])
}

/// About how many bits it takes to say a displacement.
fn bits_away(by: Displacement, guess: Displacement) -> i64 {
    std::iter::zip(by, guess)
        .map(|(by, guess)| {
            let away = (i32::from(by) - i32::from(guess)).unsigned_abs();
            i64::from(2 * (u32::BITS - away.leading_zeros()))
        })
        .sum()
}

/// What is left of a block costs about so much: bits, and errors in bits, as a feature. By Walsh and Hadamard's
/// transform of its first 16×16 pixels.
fn block_price(
    [columns, rows]: &[std::ops::Range<usize>; 2],
    left: impl Fn(usize, usize) -> [i32; PLANES],
    step: Step,
) -> i64 {
    let mut values = [[0; SIDE * SIDE]; PLANES];
    for (j, y) in rows.clone().take(SIDE).enumerate() {
        for (i, x) in columns.clone().take(SIDE).enumerate() {
            for (values, left) in values.iter_mut().zip(left(x, y)) {
                values[j * SIDE + i] = left;
            }
        }
    }
    let scale = step.per_unit(1.0);
    let of_plane = |values: &mut [i32; SIDE * SIDE]| {
        hadamard(values);
        values.iter().map(|value| cost(value >> SIDE.ilog2(), scale)).sum::<i64>()
    };
    values.iter_mut().map(of_plane).sum()
}

/// Walsh and Hadamard's transform; values grow by the square root of their number.
fn hadamard(values: &mut [i32; SIDE * SIDE]) {
    let mut half = 1;
    while half < values.len() {
        for pair in values.chunks_exact_mut(2 * half) {
            let (a, b) = pair.split_at_mut(half);
            for (a, b) in a.iter_mut().zip(b) {
                (*a, *b) = (*a + *b, *a - *b);
            }
        }
        half *= 2;
    }
}
