//! Tells whether a frame shows what the prior shows at a pose: block by block, whatever the light.
//!
//! The luma of both pictures, at half the size, is compared in blocks of 8×8 by normalised cross-correlation. Gain and
//! offset do not change that. Each block is weighted by the deviation of the render's luma: if the prior shows nothing,
//! the frame cannot confirm it. Even at a wrong pose a part of the scene may agree, such as a far wall. So the tracker
//! looks for other poses unless nearly all agrees.

use std::ops::Range;
use std::sync::Arc;

use crate::image::Mask;
use crate::render::{Cell, Correction, FlatField};

/// Side of a block, pixels of half the picture's size.
const BLOCK: usize = 8;
/// Blocks agree from this correlation on.
const AGREES: f64 = 0.5;
/// The share of what the prior shows that must agree. Something new may cover half of the picture.
const CONFIRMED: f64 = 0.4;
/// Variance of a pixel's noise at half size, values in [0, 255]: the rounding to 8 bits and a little more.
const NOISE: f64 = 0.12;
/// Fewest blocks that can judge a pose.
const BLOCKS: f64 = 8.0;
/// Least mean deviation of the render's luma in its blocks, values in [0, 255]. With less, there is nothing to confirm.
const PLAIN: f64 = 0.5;
/// Least deviation of a channel from which its light can be told, values in [0, 255].
const RANGE: f64 = 3.0;
/// If gain and offset differ by less than this, the light counts as the prior's.
const SAME_GAIN: f64 = 0.3;
const SAME_OFFSET: f64 = 0.1;

/// The channel that sharpness is measured in: camera sensors see it best.
const GREEN: usize = 1;

/// Cells around each that tell its light, to each side.
const AROUND: usize = 2;
/// Agreeing cells that are needed to tell the light of a place.
const TOLD: usize = 4;
/// Below this share of agreement, what does not agree is masked.
const NEARLY_ALL: f64 = 0.8;
/// A block that agrees is masked too if its squared error is more than this many times the median of such blocks:
/// something may cover a part of it.
const PARTLY_COVERED: f64 = 6.0;
/// If the mean change by cells is larger than this, the light differs from place to place; values in [0, 1].
const UNEVEN: f64 = 0.02;

/// How a frame and a render agree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// The share of what the prior shows that the frame shows too, 0 to 1; 0 if the prior shows nothing.
    pub share: f64,
    /// Mean correlation of what the prior shows, 0 to 1. Ranks poses at which the share is nearly the same.
    pub score: f64,
    /// Whether the prior shows enough, and the pictures are large enough, to confirm or refute a pose.
    pub is_conclusive: bool,
    /// Brings the frame's light to the prior's. Measured in the blocks that agree; `None` if it cannot be told.
    pub correction: Option<Correction>,
    /// Fine detail of the frame as a share of the render's, measured in the blocks that agree. About 1, or less if the
    /// frame is blurred. Not a number if it cannot be told.
    pub sharpness: f64,
}

impl Agreement {
    /// Whether the frame confirms the pose.
    pub fn confirms(&self) -> bool {
        self.share >= CONFIRMED
    }
}

/// Compares frames and renders of one size. Takes all its memory when it is made.
pub struct Comparison {
    width: usize,
    columns: usize,
    rows: usize,
    /// Luma of each block of the pictures compared last.
    blocks: Vec<Sums>,
    /// Room for the errors of blocks.
    errors: Vec<f64>,
    mask: Option<Arc<Mask>>,
}

impl Comparison {
    /// Makes one for pictures of a size in pixels.
    pub fn new(width: usize, height: usize) -> Comparison {
        let (columns, rows) = (width / (2 * BLOCK), height / (2 * BLOCK));
        let count = columns * rows;
        let (blocks, errors) = (Vec::with_capacity(count), Vec::with_capacity(count));
        Comparison { width, columns, rows, blocks, errors, mask: None }
    }

    /// Sets which pixels of frames count from here on; `None`: all do. A block of which less than half counts is left
    /// out.
    ///
    /// # Panics
    /// Comparing, if the mask has not the pictures' size.
    pub fn set_mask(&mut self, mask: Option<Arc<Mask>>) {
        self.mask = mask;
    }

    /// Compares two 8-bit RGB pictures, row by row.
    ///
    /// # Panics
    /// If a picture has fewer bytes than its size takes.
    pub fn compare(&mut self, frame: &[u8], render: &[u8]) -> Agreement {
        let (mut compared, mut seen, mut agreeing, mut score) = (0.0, 0.0, 0.0, 0.0);
        let mut light = [Sums::default(); 3];
        self.blocks.clear();
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (left, top) = (2 * BLOCK * column, 2 * BLOCK * row);
                let mask = self.mask.as_deref();
                let Some(Block { channels, luma }) =
                    Block::of(frame, render, mask, self.width, left, top)
                else {
                    // It agrees with nothing, and has no error.
                    self.blocks.push(Sums::default());
                    continue;
                };
                compared += 1.0;
                let (weight, correlation) = (luma.render_deviation(), luma.correlation());
                seen += weight;
                score += weight * correlation.max(0.0);
                if correlation > AGREES {
                    agreeing += weight;
                    light.iter_mut().zip(&channels).for_each(|(to, of)| to.add(of));
                }
                self.blocks.push(luma);
            }
        }
        let is_conclusive = compared >= BLOCKS && seen > PLAIN * compared;
        let share = |of: f64| if is_conclusive { of / seen } else { 0.0 };
        let correction = if is_conclusive { correction(&light) } else { None };
        let sharpness = if is_conclusive { light[GREEN].sharpness() } else { f64::NAN };
        Agreement {
            share: share(agreeing),
            score: share(score),
            is_conclusive,
            correction,
            sharpness,
        }
    }

    /// Whether a search must mask parts or correct the light from place to place, for the pictures compared last and
    /// their `agreement`. `max`: the share of the squared error, 0 to 1, that parts that do not agree may make.
    pub fn is_uneven(&self, agreement: &Agreement, max: f64) -> bool {
        let (Some(all), Some(correction)) = (self.light(), agreement.correction) else {
            return false;
        };
        let (mut error, mut other, mut change, mut agreeing) = (0.0, 0.0, 0.0, 0.0);
        for (index, block) in self.blocks.iter().enumerate() {
            let own = block.error(&correction);
            error += own;
            if block.correlation() > AGREES {
                let cell = self.cell(index, all);
                let mean = correction.mean(block.frame / block.count / 255.0);
                let lit = f64::from(cell.factor) * mean + f64::from(cell.summand);
                change += (lit - mean).abs();
                agreeing += 1.0;
            } else {
                other += own;
            }
        }
        agreement.share < NEARLY_ALL || other > max * error || change > UNEVEN * agreeing
    }

    /// Masks the blocks that do not agree, and fills in the light of each place, from the pictures compared last.
    ///
    /// # Panics
    /// If the flat field is of another size.
    pub fn describe(&mut self, field: &mut FlatField) {
        assert_eq!(field.size(), [self.columns, self.rows], "cells");
        let Some(all) = self.light() else { return };
        let max = PARTLY_COVERED * self.typical_error(all);
        for (index, to) in field.set().iter_mut().enumerate() {
            *to = self.cell(index, all);
            if self.blocks[index].error_in(all) > max {
                to.counts = 0.0;
            }
        }
    }

    /// Median of the agreeing blocks' squared errors, in one light.
    fn typical_error(&mut self, light: (f64, f64)) -> f64 {
        let agreeing = self.blocks.iter().filter(|block| block.correlation() > AGREES);
        self.errors.clear();
        self.errors.extend(agreeing.map(|block| block.error_in(light)));
        let middle = self.errors.len() / 2;
        if self.errors.is_empty() {
            return 0.0;
        }
        *self.errors.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// One light for all that agrees, `(gain, offset)`.
    fn light(&self) -> Option<(f64, f64)> {
        self.pooled(0..self.rows, 0..self.columns).0.light()
    }

    /// The light of a block relative to that of the whole picture, `(gain, offset)`.
    fn cell(&self, index: usize, all: (f64, f64)) -> Cell {
        let (column, row) = (index % self.columns, index / self.columns);
        let around = |at: usize, end: usize| at.saturating_sub(AROUND)..(at + AROUND + 1).min(end);
        let (sums, told) = self.pooled(around(row, self.rows), around(column, self.columns));
        let counts = if self.blocks[index].correlation() > AGREES { 1.0 } else { 0.0 };
        let own = if told < TOLD { None } else { sums.light() };
        let (gain, offset) = own.unwrap_or(all);
        let factor = (all.0 / gain).clamp(0.2, 5.0) as f32;
        Cell { factor, summand: ((all.1 - offset) / gain) as f32, counts }
    }

    /// Sums of the agreeing blocks of some rows and columns, and their number.
    fn pooled(&self, rows: Range<usize>, columns: Range<usize>) -> (Sums, usize) {
        let (mut sums, mut count) = (Sums::default(), 0);
        for row in rows {
            for block in &self.blocks[row * self.columns..][columns.clone()] {
                if block.correlation() > AGREES {
                    sums.add(block);
                    count += 1;
                }
            }
        }
        (sums, count)
    }
}

/// The correction of the channels' light; none if the light is the prior's.
fn correction(light: &[Sums; 3]) -> Option<Correction> {
    let mut correction = Correction::NONE;
    let mut same = true;
    for (channel, sums) in light.iter().enumerate() {
        let (gain, offset) = sums.light()?;
        same &= (gain - 1.0).abs() < SAME_GAIN && offset.abs() < SAME_OFFSET;
        correction.factor[channel] = (1.0 / gain) as f32;
        correction.summand[channel] = (-offset / gain) as f32;
    }
    Some(if same { Correction::NONE } else { correction })
}

/// Sums over pixels at half size, values in [0, 255].
#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    frame: f64,
    render: f64,
    frame_square: f64,
    render_square: f64,
    product: f64,
    /// Sums of the variance within two by two pixels.
    frame_fine: f64,
    render_fine: f64,
}

impl Sums {
    fn note(&mut self, frame: f64, render: f64) {
        self.count += 1.0;
        self.frame += frame;
        self.render += render;
        self.frame_square += frame * frame;
        self.render_square += render * render;
        self.product += frame * render;
    }

    fn add(&mut self, other: &Sums) {
        self.count += other.count;
        self.frame += other.frame;
        self.render += other.render;
        self.frame_square += other.frame_square;
        self.render_square += other.render_square;
        self.product += other.product;
        self.frame_fine += other.frame_fine;
        self.render_fine += other.render_fine;
    }

    fn frame_variance(&self) -> f64 {
        self.frame_square / self.count - (self.frame / self.count).powi(2)
    }

    fn render_variance(&self) -> f64 {
        self.render_square / self.count - (self.render / self.count).powi(2)
    }

    fn render_deviation(&self) -> f64 {
        self.render_variance().max(0.0).sqrt()
    }

    fn covariance(&self) -> f64 {
        self.product / self.count - self.frame / self.count * (self.render / self.count)
    }

    /// Fine detail of the frame as a share of the render's, each divided by its own variance: see
    /// [`Agreement::sharpness`].
    fn sharpness(&self) -> f64 {
        let fine = (self.frame_fine / self.count, self.render_fine / self.count);
        fine.0 / self.frame_variance() * self.render_variance() / fine.1
    }

    /// Sum of the squared differences, the frame's light corrected.
    fn error(&self, correction: &Correction) -> f64 {
        let summand = 255.0 * correction.mean(0.0);
        let factor = correction.mean(1.0) - correction.mean(0.0);
        let frame = factor * (factor * self.frame_square + 2.0 * summand * self.frame);
        let both = factor * self.product + summand * self.render;
        (frame + self.count * summand * summand - 2.0 * both + self.render_square).max(0.0)
    }

    /// Sum of the squared differences, after `(gain, offset)` has brought the render's light to the frame's.
    fn error_in(&self, (gain, offset): (f64, f64)) -> f64 {
        let offset = 255.0 * offset;
        let lit = self.frame_square - 2.0 * (gain * self.product + offset * self.frame);
        let render = gain * gain * self.render_square + 2.0 * gain * offset * self.render;
        (lit + render + self.count * offset * offset).max(0.0)
    }

    fn correlation(&self) -> f64 {
        let spread = (self.frame_variance() + NOISE) * (self.render_variance() + NOISE);
        self.covariance() / spread.sqrt()
    }

    /// Gain and offset (values in [0, 1]) that turn the render's light into the frame's. The gain is the ratio of the
    /// two deviations (reduced major axis), so that differences in content do not count as darkness.
    fn light(&self) -> Option<(f64, f64)> {
        let told = self.count > 0.0 && self.render_variance() > RANGE * RANGE;
        let gain = ((self.frame_variance() - NOISE).max(0.0) / self.render_variance()).sqrt();
        let valid = told && self.covariance() > 0.0 && gain > 0.02 && gain < 50.0;
        valid.then(|| (gain, (self.frame - gain * self.render) / self.count / 255.0))
    }
}

/// One block of both pictures.
struct Block {
    channels: [Sums; 3],
    luma: Sums,
}

impl Block {
    /// `None` if less than half of it counts.
    fn of(
        frame: &[u8],
        render: &[u8],
        mask: Option<&Mask>,
        width: usize,
        left: usize,
        top: usize,
    ) -> Option<Block> {
        let mut block = Block { channels: [Sums::default(); 3], luma: Sums::default() };
        for y in (top..top + 2 * BLOCK).step_by(2) {
            for x in (left..left + 2 * BLOCK).step_by(2) {
                let first = y * width + x;
                let four = [first, first + 1, first + width, first + width + 1];
                if mask.is_some_and(|mask| !four.iter().all(|pixel| mask.data[*pixel])) {
                    continue;
                }
                let at = 3 * first;
                let (f, r) = (mean(frame, at, width), mean(render, at, width));
                for (channel, sums) in block.channels.iter_mut().enumerate() {
                    sums.note(f[channel], r[channel]);
                }
                block.luma.note(luma(&f), luma(&r));
                block.channels[GREEN].frame_fine += fine(frame, at + GREEN, width);
                block.channels[GREEN].render_fine += fine(render, at + GREEN, width);
            }
        }
        (2.0 * block.luma.count >= (BLOCK * BLOCK) as f64).then_some(block)
    }
}

/// Mean of two by two pixels, by channel.
fn mean(picture: &[u8], at: usize, width: usize) -> [f64; 3] {
    let next = at + 3 * width;
    std::array::from_fn(|c| {
        let four = [at + c, at + 3 + c, next + c, next + 3 + c].map(|i| u32::from(picture[i]));
        f64::from(four.iter().sum::<u32>()) * 0.25
    })
}

/// Variance of one channel of two by two pixels.
fn fine(picture: &[u8], at: usize, width: usize) -> f64 {
    let next = at + 3 * width;
    let four = [at, at + 3, next, next + 3].map(|i| i32::from(picture[i]));
    let [sum, squares] = [four.iter().sum::<i32>(), four.iter().map(|v| v * v).sum()];
    f64::from(4 * squares - sum * sum) * 0.0625
}

/// Luma of R, G, B (ITU-R BT.601).
fn luma(rgb: &[f64; 3]) -> f64 {
    0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (192, 48);

    /// Smooth noise.
    fn picture(seed: u32) -> Vec<u8> {
        let value = |i: usize, j: usize| {
            let mut z = (i as u32).wrapping_mul(0x9e37_79b9) ^ (j as u32).wrapping_mul(0x85eb_ca6b);
            z = (z ^ seed ^ (z >> 15)).wrapping_mul(0xc2b2_ae35);
            f64::from((z ^ (z >> 13)) as u8)
        };
        let at = |i: usize| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let (ax, ay) = ((x % 5) as f64 / 5.0, (y % 5) as f64 / 5.0);
            let along = |j| value(x / 5, j) * (1.0 - ax) + value(x / 5 + 1, j) * ax;
            along(y / 5) * (1.0 - ay) + along(y / 5 + 1) * ay
        };
        (0..SIZE.0 * SIZE.1)
            .flat_map(|i| [at(i), 0.8 * at(i), 0.5 * at(i) + 20.0])
            .map(|v| v as u8)
            .collect()
    }

    fn lit(picture: &[u8], gain: f64, offset: f64) -> Vec<u8> {
        picture.iter().map(|v| (f64::from(*v) * gain + offset * 255.0).round() as u8).collect()
    }

    fn agreement(frame: &[u8], render: &[u8]) -> Agreement {
        Comparison::new(SIZE.0, SIZE.1).compare(frame, render)
    }

    #[test]
    fn light_does_not_matter_and_is_told() {
        let render = picture(1);
        for (gain, offset) in [(1.0, 0.0), (0.25, 0.0), (0.2, 0.3), (0.6, 0.1)] {
            let found = agreement(&lit(&render, gain, offset), &render);
            assert!(found.share > 0.99 && found.confirms(), "{gain} {offset}: {}", found.share);
            let correction = found.correction.unwrap();
            for channel in 0..3 {
                let value = |v: f64| correction.of(channel, (v * gain + offset) as f32);
                assert!((value(0.2) - 0.2).abs() < 0.02 && (value(0.6) - 0.6).abs() < 0.03);
            }
        }
        assert_eq!(agreement(&render, &render).correction, Some(Correction::NONE));
    }

    #[test]
    fn another_picture_confirms_nothing() {
        let found = agreement(&picture(2), &picture(1));
        assert!(found.share < 0.25 && !found.confirms(), "{}", found.share);
    }

    #[test]
    fn half_a_picture_is_enough_and_an_eighth_is_not() {
        let render = picture(1);
        for (rows, confirmed) in [(24, true), (6, false)] {
            let mut frame = picture(3);
            let shown = 3 * SIZE.0 * rows;
            frame[..shown].copy_from_slice(&render[..shown]);
            assert_eq!(agreement(&frame, &render).confirms(), confirmed, "{rows} rows");
        }
    }

    /// The flat field for a search of these two pictures, if they need one.
    fn described(frame: &[u8], render: &[u8]) -> Option<FlatField> {
        let mut comparison = Comparison::new(SIZE.0, SIZE.1);
        let agreement = comparison.compare(frame, render);
        let mut field = FlatField::new(SIZE.0, SIZE.1);
        comparison.describe(&mut field);
        comparison.is_uneven(&agreement, 0.85).then_some(field)
    }

    #[test]
    fn what_is_covered_does_not_count() {
        let render = picture(1);
        let mut frame = lit(&render, 0.8, 0.05);
        assert_eq!(described(&frame, &render), None);
        // The upper third.
        frame[..3 * SIZE.0 * 16].copy_from_slice(&picture(3)[..3 * SIZE.0 * 16]);
        let field = described(&frame, &render).unwrap();
        let (covered, others) = field.cells().split_at(12);
        assert!(covered.iter().all(|cell| cell.counts == 0.0), "{covered:?}");
        assert!(others.iter().all(|cell| cell.counts == 1.0), "{others:?}");
    }

    #[test]
    fn a_block_of_which_a_part_is_covered_is_masked_too() {
        let render = picture(1);
        let mut frame = render.clone();
        // The upper third, and two rows more of the left half.
        frame[..3 * SIZE.0 * 16].copy_from_slice(&picture(3)[..3 * SIZE.0 * 16]);
        for row in 16..18 {
            let left = 3 * SIZE.0 * row..3 * SIZE.0 * row + 3 * SIZE.0 / 2;
            frame[left.clone()].copy_from_slice(&picture(3)[left]);
        }
        let mut comparison = Comparison::new(SIZE.0, SIZE.1);
        comparison.compare(&frame, &render);
        let agreeing = (12..18).filter(|i| comparison.blocks[*i].correlation() > AGREES).count();
        assert!(agreeing >= 3, "{agreeing}");
        let field = described(&frame, &render).unwrap();
        assert!(field.cells()[12..18].iter().all(|cell| cell.counts == 0.0));
        assert!(field.cells()[18..].iter().all(|cell| cell.counts == 1.0));
    }

    #[test]
    fn blur_is_told_in_any_light() {
        let render = picture(1);
        let image = image::RgbImage::from_raw(SIZE.0 as u32, SIZE.1 as u32, render.clone());
        let blurred = image::imageops::blur(&image.unwrap(), 3.0).into_raw();
        for (gain, offset) in [(1.0, 0.0), (0.5, 0.0), (0.5, 0.3)] {
            let sharp = agreement(&lit(&render, gain, offset), &render).sharpness;
            assert!((0.9..1.1).contains(&sharp), "{gain} {offset}: {sharp}");
            let blurred = agreement(&lit(&blurred, gain, offset), &render);
            assert!(blurred.confirms() && blurred.sharpness < 0.4, "{:?}", blurred);
        }
    }

    #[test]
    fn a_lamp_beside_the_picture_is_told() {
        let render = picture(1);
        let gain = |i: usize| 1.3 - 1.0 * (i / 3 % SIZE.0) as f64 / SIZE.0 as f64;
        let lit = |(i, v): (usize, &u8)| (f64::from(*v) * gain(i)).min(255.0) as u8;
        let frame: Vec<u8> = render.iter().enumerate().map(lit).collect();
        let field = described(&frame, &render).unwrap();
        let first = &field.cells()[..12];
        assert!(first.iter().all(|cell| cell.counts == 1.0), "{first:?}");
        assert!(first[10].factor > 1.8 * first[1].factor, "{first:?}");
    }

    #[test]
    fn what_shows_nothing_confirms_nothing() {
        let (flat, textured) = (vec![90; 3 * SIZE.0 * SIZE.1], picture(1));
        for (frame, render) in [(&flat, &flat), (&flat, &textured), (&textured, &flat)] {
            assert!(!agreement(frame, render).confirms());
        }
        assert!(!Comparison::new(3, 1).compare(&[0; 9], &[0; 9]).confirms());
    }
}
