//! A coefficient as bits: its magnitude in unary, then Golomb's way, then its sign.

use super::context::BandContext;
use super::gains::{Gains, LevelGains};
use super::pass::{Due, Source};
use super::predictor::{Chances, Predictor};
use super::quantised::Quantised;
use crate::coder_tables::PLANES;
use crate::coder_tables::networks::{LOGITS, Logit};
use crate::range_coder::{EVEN, RangeDecoder, RangeEncoder};

/// Magnitudes up to this are coded in unary.
pub const UNARY: i32 = 24;
/// Bits of the magnitude beyond, at most.
const GOLOMB: u32 = 14;
pub const LARGEST_MAGNITUDE: i32 = 8191;

/// The logit of "more than `magnitude`".
fn logit_of(logits: &[Logit; LOGITS], magnitude: i32) -> Logit {
    logits[magnitude.min(LOGITS as i32 - 1) as usize]
}

/// The logit of "not zero", and the others as far as they are known.
pub struct First {
    pub logit: Logit,
    others: Option<[Logit; LOGITS]>,
}

impl First {
    /// Predicts the first bit of a coefficient.
    pub fn of(predictor: &Predictor, due: &Due) -> First {
        let bias = &due.context.bias;
        if due.is_quiet() {
            First { logit: predictor.quiet(bias, &due.quiet_inputs()), others: None }
        } else {
            let all = predictor.magnitude(bias, &due.magnitude_inputs());
            First { logit: all[0], others: Some(all) }
        }
    }

    /// All logits of the magnitude.
    pub fn all(&self, predictor: &Predictor, due: &Due) -> [Logit; LOGITS] {
        let others = || predictor.magnitude(&due.context.bias, &due.magnitude_inputs());
        let mut all = self.others.unwrap_or_else(others);
        all[0] = self.logit;
        all
    }
}

pub fn cost(chances: &Chances, logits: &[Logit; LOGITS], magnitude: i32) -> f32 {
    let unary = magnitude.min(UNARY);
    let mut bits: f32 = (0..unary).map(|k| chances.cost(logit_of(logits, k), true)).sum();
    if magnitude < UNARY {
        bits += chances.cost(logit_of(logits, magnitude), false);
    } else {
        bits += (2 * (magnitude - UNARY + 1).ilog2() + 1) as f32;
    }
    bits
}

/// Writes coefficients that are known.
pub struct Writer<'a, 'b> {
    pub encoder: RangeEncoder<'a>,
    pub predictor: &'b Predictor,
    pub chosen: &'b [Vec<i16>; PLANES],
    pub gains: &'b LevelGains,
}

impl Source for Writer<'_, '_> {
    const LOOKS_AT_ALL: bool = true;

    fn next(&mut self, due: &Due) -> Option<i16> {
        let context = due.context;
        let value = self.chosen[context.plane][due.index()];
        let predictor = self.predictor;
        let first = First::of(predictor, due);
        let magnitude = i32::from(value).abs();
        self.encoder.put(magnitude > 0, predictor.chances.one(first.logit));
        if magnitude == 0 {
            return Some(0);
        }
        let logits = first.all(predictor, due);
        for k in 1..magnitude.min(UNARY) {
            self.encoder.put(true, predictor.chances.one(logit_of(&logits, k)));
        }
        if magnitude < UNARY {
            self.encoder.put(false, predictor.chances.one(logit_of(&logits, magnitude)));
        } else {
            self.put_golomb((magnitude - UNARY + 1) as u32);
        }
        let sign = predictor.sign(&context.bias, &due.sign_inputs());
        self.encoder.put(value < 0, predictor.chances.one(sign));
        Some(value)
    }

    fn gains(&mut self, zeros: &[BandContext; 3], _: &Quantised) -> Option<Gains> {
        let level = zeros[0].band.level;
        let gains = self.gains[level];
        gains.write(level, &mut self.encoder);
        Some(gains)
    }
}

impl Writer<'_, '_> {
    /// A number of one or more, by Elias' gamma code.
    fn put_golomb(&mut self, number: u32) {
        let bits = number.ilog2();
        for _ in 0..bits {
            self.encoder.put(true, EVEN);
        }
        self.encoder.put(false, EVEN);
        for bit in (0..bits).rev() {
            self.encoder.put(number >> bit & 1 > 0, EVEN);
        }
    }
}

pub struct Reader<'a, 'b> {
    pub decoder: RangeDecoder<'a>,
    pub predictor: &'b Predictor,
}

impl Source for Reader<'_, '_> {
    const LOOKS_AT_ALL: bool = true;

    fn next(&mut self, due: &Due) -> Option<i16> {
        let (predictor, context) = (self.predictor, due.context);
        let first = First::of(predictor, due);
        if !self.decoder.get(predictor.chances.one(first.logit))? {
            return Some(0);
        }
        let logits = first.all(predictor, due);
        let mut magnitude = 1;
        while magnitude < UNARY
            && self.decoder.get(predictor.chances.one(logit_of(&logits, magnitude)))?
        {
            magnitude += 1;
        }
        if magnitude == UNARY {
            magnitude += self.golomb()? as i32 - 1;
        }
        let sign = predictor.sign(&context.bias, &due.sign_inputs());
        let negative = self.decoder.get(predictor.chances.one(sign))?;
        let magnitude = magnitude.min(LARGEST_MAGNITUDE) as i16;
        Some(if negative { -magnitude } else { magnitude })
    }

    fn gains(&mut self, zeros: &[BandContext; 3], _: &Quantised) -> Option<Gains> {
        Gains::read(zeros[0].band.level, &mut self.decoder)
    }
}

impl Reader<'_, '_> {
    fn golomb(&mut self) -> Option<u32> {
        let mut bits = 0;
        while bits < GOLOMB && self.decoder.get(EVEN)? {
            bits += 1;
        }
        let mut number = 1;
        for _ in 0..bits {
            number = number << 1 | u32::from(self.decoder.get(EVEN)?);
        }
        Some(number)
    }
}
