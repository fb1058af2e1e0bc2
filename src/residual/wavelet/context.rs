//! What both sides know of a coefficient before its bits: the networks' inputs.
//!
//! All of it are integers. Counts are quantised magnitudes; sizes are in quantiser steps, as coefficients of unit
//! norm. Both are given as logarithms; signed numbers are clamped.

use super::fixed::{FEATURE_PLACES, LARGEST, ONE, log_count, log_size};
use super::frame::Frame;
use super::gains::Seen;
use super::geometry::{Band, PLANES};
use super::lean::Lean;
use super::lifting::FRACTION;
use super::network::{COUNT_INPUTS, classes};
use super::predictor::{BandBias, MagnitudeInputs, Predictor, SignInputs};
use super::quantised::{Places, Quantised};

/// A plane's first-row sum of grey in the planes' places: what the render's luma lies above.
const GREY_LUMA: i32 = (221 + 12) << FRACTION;

/// All that is the same for a band of a plane.
pub struct BandContext<'a> {
    frame: &'a Frame,
    /// Which band.
    pub band: Band,
    /// Of which plane.
    pub plane: usize,
    /// The band's share of the networks.
    pub bias: BandBias,
    /// Where its coefficients lie, and those of its relatives.
    pub own: Places,
    parent: Option<Places>,
    grandparent: Option<Places>,
    siblings: [Option<Places>; 2],
    others: [Option<Places>; 2],
    /// Decoded low band of this plane and of the first one, rows of the picture's width.
    low: [&'a [i32]; 2],
    /// Steps per unit of the lifted coefficient, and of the low band, 16 binary places.
    scale: i64,
    low_scale: i64,
    log_step: i16,
}

/// A coefficient's inputs.
pub struct Inputs {
    pub magnitude: MagnitudeInputs,
    pub sign: SignInputs,
}

fn clamped(value: i32, limit: i32) -> i16 {
    value.clamp(-limit * ONE, limit * ONE) as i16
}

/// A signed count as a feature.
fn signed(count: i16) -> i16 {
    clamped(i32::from(count) << FEATURE_PLACES, 2)
}

fn bounded(value: i32) -> i16 {
    value.clamp(-LARGEST, LARGEST) as i16
}

fn scaled(value: i32, factor: i64) -> i32 {
    let value = (i64::from(value) * factor) >> 16;
    value.clamp(-(1 << 26), 1 << 26) as i32
}

impl<'a> BandContext<'a> {
    /// For a band of a plane, after all bands before it.
    pub fn new(
        frame: &'a Frame,
        predictor: &Predictor,
        quantised: &Quantised,
        decoded: &'a [Vec<i32>; PLANES],
        band: Band,
        plane: usize,
    ) -> BandContext<'a> {
        let geometry = &frame.geometry;
        let orientation = band.orientation.index();
        let places = |plane: usize, level: usize, orientation: usize| {
            quantised.places(plane, level, orientation)
        };
        let above = |by: usize| {
            let level = band.level + by;
            (orientation > 0 && level <= geometry.levels).then(|| places(plane, level, orientation))
        };
        let sibling =
            |before: usize| (orientation > before).then(|| places(plane, band.level, before));
        let other =
            |before: usize| (plane > before).then(|| places(before, band.level, orientation));
        let low_norm = f64::from(1u32 << band.level);
        BandContext {
            bias: predictor.band_bias(classes(band.rank(), orientation, plane)),
            own: places(plane, band.level, orientation),
            parent: above(1),
            grandparent: above(2),
            siblings: [sibling(1), sibling(2)],
            others: [other(0), other(1)],
            low: [&decoded[plane], &decoded[0]],
            scale: frame.step.per_unit(geometry.norm(&band)),
            low_scale: frame.step.per_unit(low_norm),
            log_step: frame.step.log(),
            frame,
            band,
            plane,
        }
    }

    /// Inputs of a coefficient.
    pub fn inputs(&self, quantised: &Quantised, x: usize, y: usize) -> Inputs {
        let mut inputs = Inputs { magnitude: [[0; 2]; _], sign: [[0; 2]; _] };
        let magnitude = inputs.magnitude.as_flattened_mut();
        let sign = inputs.sign.as_flattened_mut();
        self.neighbours(quantised, x, y, magnitude, sign);
        self.relatives(quantised, x, y, magnitude, sign);
        self.pictures(x, y, magnitude, sign);
        inputs
    }

    /// Place in a transformed plane.
    pub fn index(&self, x: usize, y: usize) -> usize {
        self.band.offset + y * self.frame.geometry.width + x
    }

    /// Coefficients of the band itself: inputs 0 to 6.
    fn neighbours(
        &self,
        quantised: &Quantised,
        x: usize,
        y: usize,
        magnitude: &mut [i16],
        sign: &mut [i16],
    ) {
        let at = |dx: isize, dy: isize| quantised.at(self.own, x, y, dx, dy);
        let near = [at(-1, 0), at(0, -1), at(-1, -1), at(1, -1)];
        for (i, count) in near.into_iter().enumerate() {
            magnitude[i] = log_count(count.into()) as i16;
            sign[i] = signed(count);
        }
        magnitude[4] = log_count(at(-2, 0).into()) as i16;
        magnitude[5] = log_count(at(0, -2).into()) as i16;
        let wide = [(-2, -1), (2, -1), (-1, -2), (1, -2), (-2, -2), (2, -2), (-3, 0), (0, -3)];
        let sum = wide.into_iter().map(|(dx, dy)| i32::from(at(dx, dy)).abs()).sum();
        magnitude[6] = bounded(log_count(sum));
    }

    /// Coefficients of other bands: inputs 7 to 17.
    fn relatives(
        &self,
        quantised: &Quantised,
        x: usize,
        y: usize,
        magnitude: &mut [i16],
        sign: &mut [i16],
    ) {
        if let Some(parent) = self.parent {
            let count = quantised.at(parent, x / 2, y / 2, 0, 0);
            magnitude[7] = log_count(count.into()) as i16;
            magnitude[8] = bounded(log_count(quantised.around(parent, x / 2, y / 2)));
            sign[4] = signed(count);
        }
        if let Some(grandparent) = self.grandparent {
            magnitude[9] = log_count(quantised.at(grandparent, x / 4, y / 4, 0, 0).into()) as i16;
        }
        for (i, relative) in self.siblings.iter().chain(&self.others).enumerate() {
            if let Some(places) = *relative {
                // Bands of one level differ by a row or a column, which the margin holds.
                let count = quantised.at(places, x, y, 0, 0);
                magnitude[10 + 2 * i] = log_count(count.into()) as i16;
                magnitude[11 + 2 * i] = bounded(log_count(quantised.around(places, x, y)));
                sign[5 + i] = signed(count);
            }
        }
    }

    /// Visits the zeros of a band of details of which the render tells something.
    pub fn zeros(&self, quantised: &Quantised, mut visit: impl FnMut(usize, usize, Seen)) {
        let Frame { geometry, predicted, sees_render, .. } = self.frame;
        if !sees_render {
            return;
        }
        let (width, height) = geometry.sizes[self.band.level];
        for y in 0..self.band.height {
            for x in 0..self.band.width {
                if quantised.at(self.own, x, y, 0, 0) == 0
                    && predicted[geometry.block(&self.band, x, y)]
                {
                    let light = self.light(x.min(width - 1), y.min(height - 1));
                    visit(x, y, self.seen(self.index(x, y), light));
                }
            }
        }
    }

    /// How much brighter the decoded picture is than the render, 8 binary places. Light that changes multiplies what
    /// is there.
    fn light(&self, x: usize, y: usize) -> i32 {
        let Frame { geometry, render, .. } = self.frame;
        let level = self.band.level;
        let luma = render.low[0][level][y * geometry.sizes[level].0 + x];
        let decoded = self.low[1][y * geometry.width + x];
        let light = (i64::from(decoded) << 8) / i64::from((luma + GREY_LUMA).max(12 << FRACTION));
        light.clamp(-1024, 1024) as i32
    }

    /// What the render tells of a coefficient.
    fn seen(&self, index: usize, light: i32) -> Seen {
        let own = scaled(self.frame.render.planes[self.plane][index], self.scale);
        Seen { own, guess: ((i64::from(own) * i64::from(light)) >> 8) as i32 }
    }

    /// What is predicted of the coefficient, in place of where it lies and of its sign in the second plane.
    fn leaned(&self, lean: &Lean, x: usize, y: usize, magnitude: &mut [i16], sign: &mut [i16]) {
        let (predicted, around) = lean.around(self.plane, self.index(x, y));
        let predicted = scaled(predicted, self.scale);
        magnitude[18] = bounded(log_size(predicted));
        magnitude[19] = bounded(log_size(scaled(around, self.scale)));
        sign[8] = clamped(predicted, 3);
    }

    /// The render and the decoded coarser picture: inputs 18 to 32.
    fn pictures(&self, x: usize, y: usize, magnitude: &mut [i16], sign: &mut [i16]) {
        let Frame { geometry, render, predicted, sees_render, .. } = self.frame;
        let (width, height) = geometry.sizes[self.band.level];
        let (gx, gy) = (x.min(width - 1), y.min(height - 1));
        let known = *sees_render && predicted[geometry.block(&self.band, x, y)];
        match self.frame.leaning() {
            Some(lean) => self.leaned(lean, x, y, magnitude, sign),
            None => {
                magnitude[18] = ((2 * y + 1) * 32 / self.band.height.max(1)) as i16 - 32;
                magnitude[19] = ((2 * x + 1) * 32 / self.band.width.max(1)) as i16 - 32;
            }
        }
        magnitude[20] = self.log_step;
        if self.band.level == 0 {
            return;
        }
        let luma = if known { render.low[0][self.band.level][gy * width + gx] } else { 0 };
        if known {
            magnitude[21] = ONE as i16;
            magnitude[22] = bounded(luma >> 7);
        }
        if self.band.rank() == 0 {
            return;
        }
        if known {
            let index = self.index(x, y);
            let gain = self.light(gx, gy);
            let Seen { own, guess } = self.seen(index, gain);
            let energy = scaled(render.energy[self.plane][index], self.scale);
            let around = ((i64::from(energy) * i64::from(gain)) >> 8) as i32;
            magnitude[23] = bounded(log_size(guess));
            magnitude[24] = bounded(log_size(around));
            magnitude[25] = bounded(log_size(own / 10));
            magnitude[26] = bounded(log_size(energy / 10));
            sign[9] = clamped(guess, 2);
            sign[10] = clamped(own / 10, 2);
        }
        let (left, right) = (gx.saturating_sub(1), (gx + 1).min(width - 1));
        let (up, down) = (gy.saturating_sub(1), (gy + 1).min(height - 1));
        let low =
            |gx: usize, gy: usize| scaled(self.low[0][gy * geometry.width + gx], self.low_scale);
        let here = low(gx, gy);
        let (west, east, north, south) =
            (low(left, gy), low(right, gy), low(gx, up), low(gx, down));
        let corners = [low(right, down), low(left, up), low(right, up), low(left, down)];
        let shapes = [
            west + east - 2 * here,
            north + south - 2 * here,
            east - west,
            south - north,
            here >> self.band.level,
            corners[0] + corners[1] - corners[2] - corners[3],
        ];
        for (i, shape) in shapes.into_iter().enumerate() {
            magnitude[27 + i] = bounded(log_size(shape));
            sign[11 + i] = clamped(shape, 3);
        }
    }
}

impl Inputs {
    /// Nothing near, nor above, nor beside was coded as anything but zero.
    pub fn is_quiet(&self) -> bool {
        self.magnitude[..COUNT_INPUTS / 2].iter().all(|pair| *pair == [0, 0])
    }
}
