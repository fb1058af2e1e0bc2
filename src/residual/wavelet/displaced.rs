//! Displaced blocks: what an inter frame takes from an earlier frame as it was shown.
//!
//! A warped difference lies in the right place only if the prior's depth is right there. What the prior does not know
//! lies elsewhere, and hides what the prior shows. So a block of 16×16 pixels may have a displacement of its own. It is
//! then predicted from the earlier picture, moved, less this frame's render; or from the earlier difference picture,
//! moved. A block may also be predicted from the render alone. Predictions overlap by four pixels on both sides of an
//! edge, so no seam shows.

use crate::Picture;
use crate::adaptive_numbers::Signed;
use crate::range_coder::Bits;

use super::adaptive_bit::{AdaptiveBit, Price};
use super::colour;
use super::geometry::Planes;
use super::lifting::FRACTION;
use super::small_blocks::{Chances, Grid};
use super::sub_pixel::{NONE, SubPixel, sample};

/// Side of a block, pixels. The last ones of a row or column have up to twice as many.
pub const SIDE: usize = 16;
/// Displacements are told apart to this part of a pixel.
pub const PARTS: i16 = 4;
/// Longest displacement along an axis, in [`PARTS`].
pub const LONGEST: i16 = 1023;
/// Pixels beyond its edges in which a block's prediction still counts.
const OVERLAP: usize = 4;
/// Weights of a block's prediction, 16ths, from the pixel at an edge on: inside.
const INSIDE: [i32; OVERLAP] = [9, 11, 13, 15];
/// Binary places of the weights along both axes.
const WEIGHT_PLACES: u32 = 8;
/// Most displacements are nearer than this to the one expected.
const USUAL: u32 = 4;

/// Where a block lies in the earlier picture, from where it lies in this one: to the right and down, in [`PARTS`].
pub type Displacement = [i16; 2];

/// What a block is predicted from, beside the render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The warped difference picture.
    Warped,
    /// Nothing.
    Unpredicted,
    /// What was shown, displaced.
    Displaced(Displacement, Of),
}

/// What is displaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// The earlier picture, less this frame's render: of what hides the scene.
    Picture,
    /// The earlier difference picture: of what is so thin that the scene shows beside it.
    Difference,
}

impl Kind {
    fn displacement(self) -> Option<Displacement> {
        match self {
            Kind::Displaced(displacement, _) => Some(displacement),
            _ => None,
        }
    }
}

/// An earlier frame of the stream, as the topside showed it.
#[derive(Clone, Copy)]
pub struct Earlier<'a> {
    /// Its difference picture's planes, warped to this view.
    pub warped: &'a Planes,
    /// Its picture.
    pub shown: &'a Picture,
    /// Its difference picture, as it was seen.
    pub difference: &'a Picture,
}

/// The blocks of a frame.
pub struct DisplacedBlocks {
    /// Whether the payload says something of them. Else all are predicted from the warped difference.
    pub in_use: bool,
    pub grid: Grid,
    /// Row by row.
    pub kinds: Vec<Kind>,
    size: (usize, usize),
}

impl DisplacedBlocks {
    /// For pictures of a size.
    pub fn new(width: usize, height: usize) -> DisplacedBlocks {
        let [columns, rows] = [width, height].map(|len| (len / SIDE).max(1));
        let grid = Grid { level: SIDE.ilog2() as usize, columns, rows };
        let kinds = vec![Kind::Warped; grid.len()];
        DisplacedBlocks { in_use: false, grid, kinds, size: (width, height) }
    }

    /// Predicts all blocks from the warped difference.
    pub fn clear(&mut self) {
        self.in_use = false;
        self.kinds.fill(Kind::Warped);
    }

    /// Whether a detail coefficient lies in a displaced block.
    pub fn is_displaced(&self, level: usize, x: usize, y: usize) -> bool {
        if !self.in_use || level > self.grid.level {
            return false;
        }
        self.kinds[self.grid.block(level, x, y)].displacement().is_some()
    }

    /// The pixels of a block: columns and rows.
    pub fn pixels(&self, at: usize) -> [std::ops::Range<usize>; 2] {
        let along = |at: usize, count: usize, len: usize| {
            at * SIDE..if at + 1 == count { len } else { (at + 1) * SIDE }
        };
        let Grid { columns, rows, .. } = self.grid;
        let (width, height) = self.size;
        [along(at % columns, columns, width), along(at / columns, rows, height)]
    }

    /// The displacement that a block's own is told from: the median of those to the left, above, and above to the
    /// right; if not all three have one, the first of these that has; else the last one before it.
    pub fn guess(&self, at: usize) -> Displacement {
        let Grid { columns, .. } = self.grid;
        let (x, y) = (at % columns, at / columns);
        let of = |is_there: bool, back: usize| {
            if is_there { self.kinds[at - back].displacement() } else { None }
        };
        let near = [of(x > 0, 1), of(y > 0, columns), of(y > 0 && x + 1 < columns, columns - 1)];
        if let [Some(a), Some(b), Some(c)] = near {
            return std::array::from_fn(|i| a[i].max(b[i]).min(a[i].min(b[i]).max(c[i])));
        }
        let before = || self.kinds[..at].iter().rev().find_map(|kind| kind.displacement());
        near.into_iter().flatten().next().or_else(before).unwrap_or_default()
    }

    /// Codes all blocks. A displacement that is too long is read as [`LONGEST`].
    pub fn code(&mut self, coder: &mut impl Bits) {
        let mut displaced = Chances::new();
        let mut unpredicted = Chances::new();
        let mut differences = AdaptiveBit::new(1, 2);
        let mut apart = [const { Signed::new(USUAL) }; 2];
        for at in 0..self.kinds.len() {
            let kind = self.kinds[at];
            let is_displaced = |at: usize| self.kinds[at].displacement().is_some();
            let chance = displaced.of(self.grid, is_displaced, at);
            self.kinds[at] = if chance.code(coder, kind.displacement().is_some()) {
                let [guess, due] = [self.guess(at), kind.displacement().unwrap_or_default()];
                let displacement = std::array::from_fn(|axis| {
                    let [guess, due] = [guess[axis], due[axis]].map(i32::from);
                    let read = guess.saturating_add(apart[axis].code(coder, due - guess));
                    read.clamp(-i32::from(LONGEST), i32::from(LONGEST)) as i16
                });
                let is_difference = matches!(kind, Kind::Displaced(_, Of::Difference));
                let of = match differences.code(coder, is_difference) {
                    true => Of::Difference,
                    false => Of::Picture,
                };
                Kind::Displaced(displacement, of)
            } else {
                let is_unpredicted = |at: usize| self.kinds[at] == Kind::Unpredicted;
                let chance = unpredicted.of(self.grid, is_unpredicted, at);
                match chance.code(coder, kind == Kind::Unpredicted) {
                    true => Kind::Unpredicted,
                    false => Kind::Warped,
                }
            };
        }
    }

    /// Bits that they take, if they are in use.
    pub fn bits(&mut self) -> f64 {
        let mut price = Price::default();
        if self.in_use {
            self.code(&mut price);
        }
        price.0
    }

    /// Writes the planes that the frame is predicted from, beside its render.
    pub fn compose(&self, earlier: &Earlier, render: &Picture, into: &mut Planes) {
        if !self.in_use {
            for (to, warped) in into.iter_mut().zip(earlier.warped) {
                to.copy_from_slice(warped);
            }
            return;
        }
        into.iter_mut().for_each(|plane| plane.fill(0));
        for at in 0..self.kinds.len() {
            self.add(at, earlier, render, into);
        }
        for value in into.iter_mut().flatten() {
            *value = (*value + (1 << (WEIGHT_PLACES - 1))) >> WEIGHT_PLACES;
        }
    }

    /// Adds a block's prediction, weighed.
    fn add(&self, at: usize, earlier: &Earlier, render: &Picture, into: &mut Planes) {
        let kind = self.kinds[at];
        if kind == Kind::Unpredicted {
            return;
        }
        let [columns, rows] = self.pixels(at);
        let (width, height) = self.size;
        for (y, down) in weighed(&rows, height) {
            for (x, along) in weighed(&columns, width) {
                let index = y * width + x;
                let value = match kind {
                    Kind::Displaced(by, of) => displaced(earlier, render, (x, y), by, of),
                    _ => std::array::from_fn(|plane| earlier.warped[plane][index]),
                };
                for (plane, value) in into.iter_mut().zip(value) {
                    plane[index] += along * down * value;
                }
            }
        }
    }
}

/// A pixel of the earlier picture, moved, less that of the render; or of the difference picture, moved: its planes.
pub fn displaced(
    earlier: &Earlier,
    render: &Picture,
    (x, y): (usize, usize),
    by: Displacement,
    of: Of,
) -> [i32; 3] {
    let place = SubPixel::displaced([x, y], by, PARTS);
    if of == Of::Difference {
        return colour::fine_to_planes(sample(earlier.difference, &place));
    }
    let there = sample(earlier.shown, &place);
    let here = &render.data[3 * (y * render.width as usize + x)..][..3];
    let value = |c: usize| there[c] - ((i32::from(here[c]) - NONE) << FRACTION);
    colour::fine_to_planes(std::array::from_fn(value))
}

/// The places of a picture's row or column in which a block counts, and its weight there, 16ths.
fn weighed(own: &std::ops::Range<usize>, len: usize) -> impl Iterator<Item = (usize, i32)> + use<> {
    let (start, end) = (own.start, own.end);
    let first = start.saturating_sub(OVERLAP);
    let last = if end == len { end } else { end + OVERLAP };
    (first..last).map(move |at| {
        let weight = |beyond: usize, within: usize, is_edge: bool| match () {
            () if !is_edge => 16,
            () if beyond > 0 => 16 - INSIDE[beyond - 1],
            () => INSIDE.get(within).copied().unwrap_or(16),
        };
        let left = weight(start.saturating_sub(at), at.saturating_sub(start), start > 0);
        let beyond = (at + 1).saturating_sub(end);
        let right = weight(beyond, (end - 1).saturating_sub(at), end < len);
        (at, left.min(right))
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::range_coder::{RangeEncoder, WholeReader};

    fn kinds() -> impl Strategy<Value = Vec<Kind>> {
        let part = -LONGEST..=LONGEST;
        let kind = prop_oneof![
            Just(Kind::Warped),
            Just(Kind::Unpredicted),
            (-9_i16..9, -9_i16..9).prop_map(|(x, y)| Kind::Displaced([x, y], Of::Difference)),
            (part.clone(), part).prop_map(|(x, y)| Kind::Displaced([x, y], Of::Picture)),
        ];
        proptest::collection::vec(kind, 1..200)
    }

    fn blocks(width: usize, height: usize, kinds: &[Kind]) -> DisplacedBlocks {
        let mut blocks = DisplacedBlocks::new(width, height);
        blocks.in_use = true;
        blocks.kinds.iter_mut().zip(kinds.iter().cycle()).for_each(|(to, kind)| *to = *kind);
        blocks
    }

    proptest! {
        #[test]
        fn blocks_come_back_at_their_price(
            width in 1_usize..200,
            height in 1_usize..200,
            kinds in kinds(),
        ) {
            let mut written = blocks(width, height, &kinds);
            let mut bytes = Vec::new();
            let mut encoder = RangeEncoder::new(&mut bytes, 10_000);
            written.code(&mut encoder);
            prop_assert!(encoder.finish());
            prop_assert!(bytes.len() as f64 <= written.bits() / 8.0 + 2.0);
            let mut read = DisplacedBlocks::new(width, height);
            read.code(&mut WholeReader::new(&bytes));
            prop_assert_eq!(read.kinds, written.kinds);
        }

        #[test]
        fn any_bytes_are_blocks(bytes: Vec<u8>) {
            let mut blocks = DisplacedBlocks::new(100, 60);
            blocks.code(&mut WholeReader::new(&bytes));
            let near = |part: &i16| part.abs() <= LONGEST;
            let all = blocks.kinds.iter().filter_map(|kind| kind.displacement());
            prop_assert!(all.flatten().all(|part| near(&part)));
        }

        #[test]
        fn weights_add_up_to_one_everywhere(width in 1_usize..200) {
            let blocks = DisplacedBlocks::new(width, 16);
            let mut sums = vec![0; width];
            for at in 0..blocks.grid.len() {
                let [columns, _] = blocks.pixels(at);
                weighed(&columns, width).for_each(|(x, weight)| sums[x] += weight);
            }
            prop_assert!(sums.iter().all(|sum| *sum == 16), "{:?}", sums);
        }
    }

    fn picture(width: u32, height: u32, add: usize) -> Picture {
        let mut picture = Picture::new(width, height);
        let value = |i: usize| (i * (7 + add) + i / 17) % 251;
        picture.data.iter_mut().enumerate().for_each(|(i, to)| *to = value(i) as u8);
        picture
    }

    #[test]
    fn predictions_are_what_the_kinds_say() {
        let (shown, render) = (picture(48, 32, 0), picture(48, 32, 40));
        let warped: Planes =
            std::array::from_fn(|p| (0..48 * 32).map(|i| i * 3 - p as i32).collect());
        let difference = picture(48, 32, 77);
        let earlier = Earlier { warped: &warped, shown: &shown, difference: &difference };
        let composed = |kind: Kind| {
            let mut into: Planes = std::array::from_fn(|_| vec![7; 48 * 32]);
            blocks(48, 32, &[kind]).compose(&earlier, &render, &mut into);
            into
        };
        assert!(composed(Kind::Warped) == warped);
        assert!(composed(Kind::Unpredicted).iter().flatten().all(|value| *value == 0));
        // Two pixels to the right and one up.
        let moved = composed(Kind::Displaced([8, -4], Of::Picture));
        let differs = composed(Kind::Displaced([8, -4], Of::Difference));
        for (x, y) in [(3, 5), (16, 15), (17, 16), (40, 20)] {
            let of = |picture: &Picture, x: usize, y: usize, c: usize| {
                i32::from(picture.data[3 * (y * 48 + x) + c])
            };
            let left = |c| (of(&shown, x + 2, y - 1, c) - of(&render, x, y, c)) << FRACTION;
            let due = colour::fine_to_planes([left(0), left(1), left(2)]);
            let found: [i32; 3] = std::array::from_fn(|plane| moved[plane][y * 48 + x]);
            assert_eq!(found, due, "{x} {y}");
            let left = |c| (of(&difference, x + 2, y - 1, c) - NONE) << FRACTION;
            let due = colour::fine_to_planes([left(0), left(1), left(2)]);
            let found: [i32; 3] = std::array::from_fn(|plane| differs[plane][y * 48 + x]);
            assert_eq!(found, due, "{x} {y}");
        }
    }
}
