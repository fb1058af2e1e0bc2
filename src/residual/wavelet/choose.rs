//! Rate–distortion choice of coefficients: each one as the bits are worth it.

use std::ops::Range;

use super::bits::{First, LARGEST_MAGNITUDE, cost};
use super::context::BandContext;
use super::gains::{GainFit, Gains, LevelGains};
use super::pass::{Due, Source};
use super::predictor::Predictor;
use super::prices::Prices;
use super::quantised::Quantised;
use crate::coder_tables::PLANES;

/// Coefficients nearer to zero than this are zero, steps.
const MIN: f32 = 0.45;

/// Chooses coefficients in coding order. What a choice costs those after it is left out of account.
pub struct Chooser<'a> {
    /// The coefficients to code, in quantiser steps, by plane.
    pub wanted: &'a [Vec<f32>; PLANES],
    /// What a bit is worth, squared steps.
    pub lambda: f32,
    /// How many times more it costs at each coefficient.
    pub prices: &'a Prices,
    pub predictor: &'a Predictor,
    /// Receives the gains, by level.
    pub gains: &'a mut LevelGains,
    /// Bits of the choices that had to be weighed: all but the zeros that were near zero from the start.
    pub bits: f32,
}

impl Source for Chooser<'_> {
    const LOOKS_AT_ALL: bool = false;

    fn next(&mut self, due: &Due) -> Option<i16> {
        let context = due.context;
        let wanted = self.wanted[context.plane][due.index()];
        let size = wanted.abs();
        if !(size >= MIN) {
            return Some(0);
        }
        let Predictor { chances, offsets, .. } = self.predictor;
        let first = First::of(self.predictor, due);
        let bits_of_zero = chances.cost(first.logit, false);
        let lambda = self.lambda * self.prices.factor(context.plane, due.index());
        let zero = size * size + lambda * bits_of_zero;
        // Another value has this first bit at least: it would be no better even if all else cost nothing.
        if zero <= lambda * chances.cost(first.logit, true) {
            self.bits += bits_of_zero;
            return Some(0);
        }
        let logits = first.all(self.predictor, due);
        let sign = self.predictor.sign(&context.bias, &due.sign_inputs());
        let sign = chances.cost(sign, wanted < 0.0);
        let offsets = &offsets[context.plane][context.band.rank()];
        let bits = |magnitude| cost(chances, &logits, magnitude);
        let mut best = (zero, 0, bits_of_zero);
        let near = (size as i32).min(LARGEST_MAGNITUDE - 1);
        for magnitude in (near - 1).max(1)..=near + 1 {
            let offset = f32::from(offsets[magnitude.min(3) as usize - 1]) / 256.0;
            let error = size - (magnitude as f32 - offset);
            let bits = bits(magnitude) + sign;
            let total = error * error + lambda * bits;
            if total < best.0 {
                best = (total, magnitude, bits);
            }
        }
        self.bits += best.2;
        let value = best.1 as i16;
        Some(if wanted < 0.0 { -value } else { value })
    }

    fn are_zeros(&self, plane: usize, places: Range<usize>) -> bool {
        let wanted = &self.wanted[plane][places];
        !wanted.iter().fold(false, |any, wanted| any | (wanted.abs() >= MIN))
    }

    fn gains(&mut self, zeros: &[BandContext; 3], quantised: &Quantised) -> Option<Gains> {
        let mut fit = GainFit::default();
        for zeros in zeros {
            fit.take(zeros, quantised, &self.wanted[0]);
        }
        let level = zeros[0].band.level;
        let gains = fit.solve(level, self.lambda);
        self.gains[level] = gains;
        Some(gains)
    }
}
