//! What both sides know of a coefficient before its bits: the networks' inputs.
//!
//! All of it are integers. Counts are quantised magnitudes; sizes are in quantiser steps, as coefficients of unit
//! norm. Both are given as logarithms; signed numbers are clamped.

use std::ops::Range;

use super::coarser::{Around, Coarser, in_steps};
use super::fixed::{ONE, bounded, log_count, size_input};
use super::frame::Frame;

use super::geometry::Band;
use super::inter::Inter;
use super::predictor::{BandBias, MagnitudeInputs, Predictor, QuietInputs, SignInputs};
use super::quantised::{Places, Quantised};
use super::render_value::RenderValue;
use crate::coder_tables::networks::FEATURE_PLACES;
use crate::coder_tables::networks::{COUNT_INPUTS, classes};

/// All that is the same for a band of a plane.
pub struct BandContext<'a> {
    frame: &'a Frame,
    pub band: Band,
    pub plane: usize,
    /// The band's share of the networks.
    pub bias: BandBias,
    /// Where its coefficients lie, and those of its relatives.
    pub own: Places,
    parent: Option<Places>,
    grandparent: Option<Places>,
    siblings: [Option<Places>; 2],
    others: [Option<Places>; 2],
    coarser: &'a Coarser,
    /// Steps per unit of the lifted coefficient, 16 binary places.
    scale: i64,
    log_step: i16,
    /// Whether the whole render may be looked at, or nothing of it; `None`: as the block says.
    known: Option<bool>,
}

/// What is predicted of a coefficient from an earlier frame, and the mean size around it; features in steps.
struct InterValue {
    predicted: i32,
    around: i32,
}

fn clamped(value: i32, limit: i32) -> i16 {
    value.clamp(-limit * ONE, limit * ONE) as i16
}

/// A signed count as a feature.
fn signed(count: i16) -> i16 {
    clamped(i32::from(count) << FEATURE_PLACES, 2)
}

impl<'a> BandContext<'a> {
    /// For a band of a plane, after all bands before it.
    pub fn new(
        frame: &'a Frame,
        predictor: &Predictor,
        quantised: &Quantised,
        coarser: &'a Coarser,
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
        BandContext {
            bias: predictor.band_bias(classes(band.rank(), orientation, plane)),
            own: places(plane, band.level, orientation),
            parent: above(1),
            grandparent: above(2),
            siblings: [sibling(1), sibling(2)],
            others: [other(0), other(1)],
            coarser,
            scale: frame.step.per_unit(geometry.norm(&band)),
            log_step: frame.step.log(),
            known: match frame.sees_render {
                true if frame.small_blocks.in_use || frame.has_displaced() => None,
                sees_render => Some(sees_render),
            },
            frame,
            band,
            plane,
        }
    }

    /// Place in a transformed plane.
    pub fn index(&self, x: usize, y: usize) -> usize {
        self.band.offset + y * self.frame.geometry.width + x
    }

    /// Whether contexts may look at the render here.
    fn is_known(&self, x: usize, y: usize) -> bool {
        self.known.unwrap_or_else(|| self.frame.is_detailed(&self.band, x, y))
    }

    /// Inputs of the network for magnitudes. `seen`: what [`BandContext::see`] made for the place.
    pub fn magnitude_inputs(
        &self,
        quantised: &Quantised,
        x: usize,
        y: usize,
        seen: &QuietInputs,
    ) -> MagnitudeInputs {
        let mut inputs: MagnitudeInputs = [[0; 2]; _];
        let (counts, pictures) = inputs.split_at_mut(COUNT_INPUTS / 2);
        if !quantised.is_quiet(self.own, x, y) {
            self.counts(quantised, x, y, counts.as_flattened_mut());
        }
        pictures.copy_from_slice(seen);
        inputs
    }

    /// What was coded before: inputs 0 to 17.
    pub fn counts(&self, quantised: &Quantised, x: usize, y: usize, inputs: &mut [i16]) {
        self.counts_near(quantised, x, y, inputs);
        self.counts_beside(quantised, x, y, inputs);
    }

    /// Coefficients of the band itself: inputs 0 to 6.
    fn counts_near(&self, quantised: &Quantised, x: usize, y: usize, inputs: &mut [i16]) {
        let near = quantised.near(self.own, x, y);
        for (to, count) in inputs.iter_mut().zip(near.next) {
            *to = log_count(count.into()) as i16;
        }
        inputs[6] = bounded(log_count(near.beyond));
    }

    /// Coefficients of other bands: inputs 7 to 17.
    fn counts_beside(&self, quantised: &Quantised, x: usize, y: usize, inputs: &mut [i16]) {
        let count_of = |places: Places, x: usize, y: usize| {
            log_count(quantised.at(places, x, y).into()) as i16
        };
        if let Some(parent) = self.parent {
            inputs[7] = count_of(parent, x / 2, y / 2);
            inputs[8] = bounded(log_count(quantised.around(parent, x / 2, y / 2)));
        }
        if let Some(grandparent) = self.grandparent {
            inputs[9] = count_of(grandparent, x / 4, y / 4);
        }
        // Bands of one level differ by a row or a column, which the margin holds.
        for (i, relative) in self.siblings.iter().chain(&self.others).enumerate() {
            if let Some(places) = *relative {
                inputs[10 + 2 * i] = count_of(places, x, y);
                inputs[11 + 2 * i] = bounded(log_count(quantised.around(places, x, y)));
            }
        }
    }

    /// Visits the zeros of a band of details of which the render tells something.
    pub fn zeros(&self, quantised: &Quantised, mut visit: impl FnMut(usize, RenderValue)) {
        if !self.frame.sees_render {
            return;
        }
        let Band { width, height, .. } = self.band;
        for y in 0..height {
            let row = quantised.row(self.plane, &self.band, y).iter();
            let places = self.index(0, y)..self.index(width, y);
            let own = &self.frame.render.planes[self.plane][places.clone()];
            let seen = own.iter().zip(self.coarser.light(0..width, y));
            for ((x, place), (value, (own, light))) in places.enumerate().zip(row.zip(seen)) {
                if *value == 0 && self.is_known(x, y) {
                    visit(place, self.in_light(*own, *light));
                }
            }
        }
    }

    /// What a number of the render tells, if the light changes by so much.
    fn in_light(&self, lifted: i32, light: i32) -> RenderValue {
        let own = in_steps(lifted, self.scale);
        RenderValue { own, guess: ((i64::from(own) * i64::from(light)) >> 8) as i32 }
    }

    /// What is predicted of a coefficient from an earlier frame.
    fn inter_value(&self, inter: &Inter, x: usize, y: usize) -> InterValue {
        let (predicted, around) = inter.around(self.plane, self.index(x, y));
        let [predicted, around] = [predicted, around].map(|value| in_steps(value, self.scale));
        InterValue { predicted, around }
    }

    /// What is seen of the render and of the decoded coarser picture along a part of a row: inputs 18 to 32 for
    /// magnitudes, and all inputs for quiet contexts. The first two of them say where the coefficient lies. If the
    /// frame is predicted from an earlier one, the first two are that prediction instead.
    pub fn see(&self, xs: Range<usize>, y: usize, seen: &mut [QuietInputs]) {
        let Band { level, width, height, .. } = self.band;
        let inter = self.frame.inter_seen();
        for (x, seen) in xs.clone().zip(&mut *seen) {
            let [first, second] = match inter {
                None => [along(y, height), along(x, width)],
                Some(inter) => {
                    let InterValue { predicted, around } = self.inter_value(inter, x, y);
                    [predicted, around].map(size_input)
                }
            };
            *seen = [[0; 2]; _];
            [seen[0], seen[1]] = [[first, second], [self.log_step, 0]];
        }
        let known = level > 0 && self.known != Some(false);
        if known {
            self.see_brightness(xs.clone(), y, seen);
        }
        if self.band.rank() > 0 {
            if known {
                self.see_render(xs.clone(), y, seen);
            }
            self.see_shapes(xs, y, seen);
        }
    }

    /// Whether the render is known, and how bright it is: inputs 21 and 22.
    fn see_brightness(&self, xs: Range<usize>, y: usize, seen: &mut [QuietInputs]) {
        let (level, sizes) = (self.band.level, &self.frame.geometry.sizes);
        let low = &self.frame.render.low[0][level][y * sizes[level].0..][xs.clone()];
        for ((x, [_, second, third, ..]), low) in xs.zip(seen).zip(low) {
            if self.is_known(x, y) {
                (second[1], third[0]) = (ONE as i16, bounded(low >> 7));
            }
        }
    }

    /// The render's coefficients, if it is known: inputs 23 to 26.
    fn see_render(&self, xs: Range<usize>, y: usize, seen: &mut [QuietInputs]) {
        let render = &self.frame.render;
        let places = self.index(xs.start, y)..self.index(xs.end, y);
        let own = render.planes[self.plane][places.clone()].iter();
        let energy = &render.energy[self.plane][places];
        let values = own.zip(energy).zip(self.coarser.light(xs, y));
        for (seen, ((own, energy), light)) in seen.iter_mut().zip(values) {
            let inputs = seen.as_flattened_mut();
            if inputs[3] != 0 {
                let [own, energy] = [own, energy].map(|value| self.in_light(*value, *light));
                inputs[5] = size_input(own.guess);
                inputs[6] = size_input(energy.guess);
                inputs[7] = size_input(own.own / 10);
                inputs[8] = size_input(energy.own / 10);
            }
        }
    }

    /// The decoded coarser picture: inputs 27 to 32.
    fn see_shapes(&self, xs: Range<usize>, y: usize, seen: &mut [QuietInputs]) {
        let rows = self.coarser.rows(self.plane, xs, y);
        let [above, row, below] = rows.map(|row| row.windows(3));
        for (((seen, a), b), c) in seen.iter_mut().zip(above).zip(row).zip(below) {
            let around = [[a[0], a[1], a[2]], [b[0], b[1], b[2]], [c[0], c[1], c[2]]];
            let shapes = shapes(&around, self.band.level);
            for (to, shape) in seen.as_flattened_mut()[9..].iter_mut().zip(shapes) {
                *to = size_input(shape);
            }
        }
    }

    /// Inputs of the network for signs.
    pub fn sign_inputs(&self, quantised: &Quantised, x: usize, y: usize) -> SignInputs {
        let mut inputs: SignInputs = [[0; 2]; _];
        let all = inputs.as_flattened_mut();
        let near = quantised.near(self.own, x, y);
        for (to, count) in all.iter_mut().zip(&near.next[..4]) {
            *to = signed(*count);
        }
        if let Some(parent) = self.parent {
            all[4] = signed(quantised.at(parent, x / 2, y / 2));
        }
        for (to, relative) in all[5..].iter_mut().zip(self.siblings.iter().chain(&self.others)) {
            if let Some(places) = *relative {
                *to = signed(quantised.at(places, x, y));
            }
        }
        // In place of the sign in the second plane.
        if let Some(inter) = self.frame.inter_seen() {
            all[8] = clamped(self.inter_value(inter, x, y).predicted, 3);
        }
        if self.band.rank() == 0 {
            return inputs;
        }
        if self.is_known(x, y) {
            let own = self.frame.render.planes[self.plane][self.index(x, y)];
            let light = self.coarser.light(x..x + 1, y)[0];
            let RenderValue { own, guess } = self.in_light(own, light);
            all[9] = clamped(guess, 2);
            all[10] = clamped(own / 10, 2);
        }
        let shapes = shapes(&self.coarser.around(self.plane, x, y), self.band.level);
        for (to, shape) in all[11..].iter_mut().zip(shapes) {
            *to = clamped(shape, 3);
        }
        inputs
    }
}

/// A place along a band's side, −32 to 32.
fn along(place: usize, side: usize) -> i16 {
    ((2 * place as u32 + 1) * 32 / side as u32) as i16 - 32
}

/// How the decoded picture bends and slopes around a place.
fn shapes([above, row, below]: &Around, level: usize) -> [i32; 6] {
    let here = row[1];
    [
        row[0] + row[2] - 2 * here,
        above[1] + below[1] - 2 * here,
        row[2] - row[0],
        below[1] - above[1],
        here >> level,
        below[2] + above[0] - above[2] - below[0],
    ]
}
