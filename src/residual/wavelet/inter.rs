//! What is predicted from an earlier frame's difference picture.
//!
//! That picture comes warped to this view. Each of its coefficients is multiplied by a factor that depends on its band
//! and on the *age* of the reference: the light moves on, and fine details of it first. The encoder chooses the age
//! that fits, and blocks in which nothing is predicted: what the frame shows there was hidden before, or has changed.

use super::block_cost;
use super::displaced::{DisplacedBlocks, Earlier};
use super::geometry::{Geometry, Orientation, Planes};
use super::lifting::{self, Scratch};
use super::render::{box_mean, mean_room};
use super::step::Step;
use crate::Picture;
use crate::coder_tables::PLANES;
use crate::coder_tables::RANKS;
use crate::range_coder::{EVEN, Probability, RangeDecoder, RangeEncoder};

/// Ages that are told apart.
const AGES: usize = 8;
/// Binary places of a factor.
const PLACES: u32 = 8;

/// Factors by distance to the reference, plane and rank of the band.
const FACTORS: [[[u8; RANKS]; PLANES]; AGES] = ages();

/// Factors of a reference one frame old at 15 fps, fitted on the reef's training frames: 1024ths.
const ONE_FRAME: [[u32; RANKS]; PLANES] = [
    [962, 903, 842, 684, 680, 772, 854],
    [1016, 571, 797, 877, 821, 889, 922],
    [938, 459, 587, 691, 817, 899, 898],
];
/// The ages, in quarters of that.
const QUARTERS: [u32; AGES] = [1, 2, 4, 6, 9, 14, 22, 36];

/// A factor fades as a power of the age.
const fn ages() -> [[[u8; RANKS]; PLANES]; AGES] {
    let mut factors = [[[0; RANKS]; PLANES]; AGES];
    let mut age = 0;
    while age < AGES {
        let mut plane = 0;
        while plane < PLANES {
            let mut rank = 0;
            while rank < RANKS {
                let root = root(root((ONE_FRAME[plane][rank] as u64) << 10));
                let (mut power, mut quarter) = (1 << 20, 0);
                while quarter < QUARTERS[age] {
                    power = (power * root) >> 20;
                    quarter += 1;
                }
                let places = 20 - PLACES;
                let factor = (power + (1 << (places - 1))) >> places;
                factors[age][plane][rank] = if factor > 255 { 255 } else { factor as u8 };
                rank += 1;
            }
            plane += 1;
        }
        age += 1;
    }
    factors
}

/// Square root of a number below one, in 20 binary places.
const fn root(value: u64) -> u64 {
    let square = value << 20;
    let (mut low, mut high) = (0, 1 << 20);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if middle * middle <= square { low = middle } else { high = middle }
    }
    low
}

/// What a payload says of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Says {
    age: usize,
    /// The coarsest low band is predicted.
    low: bool,
}

/// Whether a prediction pays, as far as the coefficients tell: they do not tell how much of the difference the render
/// would have told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pays {
    /// It does not.
    No,
    /// It may.
    Perhaps,
    /// It should.
    Yes,
}

impl Pays {
    /// Compares the costs without it and with it. Why in doubt both are coded: docs/decisions.md, 19.
    fn of(plain: i64, left: i64) -> Pays {
        let saved = plain - left;
        if saved * 64 < plain {
            Pays::No
        } else if saved * 8 < plain {
            Pays::Perhaps
        } else {
            Pays::Yes
        }
    }
}

/// A prediction, and what it is made of.
pub struct Inter {
    /// Which blocks are predicted from what.
    pub displaced: DisplacedBlocks,
    /// Coefficients of the warped and the displaced reference.
    reference: Planes,
    predicted: Planes,
    /// Mean magnitude over a coefficient and its eight neighbours, of the same band or not.
    energy: Planes,
    picture: Planes,
    says: Says,
    /// Whether the details of each block are predicted.
    blocks: Vec<bool>,
    rows: Vec<i32>,
}

/// Energies of a band: of the difference, of the reference, and their product.
#[derive(Clone, Copy, Default)]
struct Energies {
    difference: f64,
    product: f64,
    reference: f64,
    count: f64,
}

impl Energies {
    /// About how many bits the band takes, at a factor.
    fn bits(&self, factor: f64) -> f64 {
        let left = self.difference - factor * (2.0 * self.product - factor * self.reference);
        0.5 * self.count * libm::log2(1.0 + left.max(0.0) / self.count.max(1.0))
    }
}

/// Chance that the low band is not predicted, and that some blocks are not.
const LOW_PLAIN: Probability = 1 << 12;
const SOME_BLOCKS: Probability = 1 << 13;

impl Inter {
    /// For pictures of a size.
    pub fn new(geometry: &Geometry) -> Inter {
        let planes = || std::array::from_fn(|_| vec![0; geometry.len()]);
        let (columns, rows) = geometry.sizes[geometry.levels];
        let blocks = vec![true; columns * rows];
        let (reference, predicted, energy, picture) = (planes(), planes(), planes(), planes());
        let (says, rows) = (Says::default(), vec![0; mean_room(geometry)]);
        let displaced = DisplacedBlocks::new(geometry.width, geometry.height);
        Inter { displaced, reference, predicted, energy, picture, says, blocks, rows }
    }

    /// The prediction's picture, to be added to what is decoded.
    pub fn picture(&self) -> &Planes {
        &self.picture
    }

    /// A coefficient of the prediction, and the mean magnitude around it.
    pub fn around(&self, plane: usize, index: usize) -> (i32, i32) {
        (self.predicted[plane][index], self.energy[plane][index])
    }

    /// Takes an earlier frame, as the displaced blocks say. `render`: of this frame.
    pub fn set(
        &mut self,
        geometry: &Geometry,
        earlier: &Earlier,
        render: &Picture,
        scratch: &mut Scratch,
    ) {
        let Inter { displaced, reference, .. } = self;
        displaced.compose(earlier, render, reference);
        for plane in reference {
            (0..geometry.levels).for_each(|level| {
                lifting::forward(plane, geometry.width, geometry.sizes[level], scratch)
            });
        }
    }

    /// Takes the reference of another prediction of this size.
    pub fn set_as(&mut self, other: &Inter) {
        for (own, other) in self.reference.iter_mut().zip(&other.reference) {
            own.copy_from_slice(other);
        }
    }

    /// Chooses what to predict of a difference, and takes it out, unless it surely does not pay.
    pub fn choose(
        &mut self,
        geometry: &Geometry,
        difference: &mut Planes,
        scratch: &mut Scratch,
    ) -> Pays {
        self.says = Says { age: self.best_age(geometry, difference), low: true };
        self.blocks.fill(true);
        self.predict(geometry);
        let pays = self.choose_blocks(geometry, difference);
        if pays == Pays::No {
            return pays;
        }
        for (difference, predicted) in difference.iter_mut().zip(&self.predicted) {
            for (to, predicted) in difference.iter_mut().zip(predicted) {
                *to = to.wrapping_sub(*predicted);
            }
        }
        self.finish(geometry, scratch);
        pays
    }

    /// The age at which least is left.
    fn best_age(&self, geometry: &Geometry, difference: &Planes) -> usize {
        let energies = self.energies(geometry, difference);
        let bits = |age: usize| {
            let factors = FACTORS[age].iter().flatten();
            let of = |(energies, factor): (&Energies, &u8)| {
                energies.bits(f64::from(*factor) / f64::from(1 << PLACES))
            };
            energies.iter().flatten().zip(factors).map(of).sum::<f64>()
        };
        (0..AGES).min_by(|a, b| bits(*a).total_cmp(&bits(*b))).unwrap_or(0)
    }

    /// Energies by plane and rank, in steps.
    fn energies(&self, geometry: &Geometry, difference: &Planes) -> [[Energies; RANKS]; PLANES] {
        let mut energies = [[Energies::default(); RANKS]; PLANES];
        for band in geometry.bands() {
            let scale = Step::new(block_cost::COMPARED_AT).per_unit(geometry.norm(&band));
            let scale = scale as f64 / f64::from(1u32 << 22);
            for plane in 0..PLANES {
                let energies = &mut energies[plane][band.rank()];
                for row in band.rows(geometry) {
                    let pairs =
                        difference[plane][row.clone()].iter().zip(&self.reference[plane][row]);
                    for (difference, reference) in pairs {
                        let [d, r] = [difference, reference].map(|v| f64::from(*v) * scale);
                        energies.difference += d * d;
                        energies.product += d * r;
                        energies.reference += r * r;
                    }
                }
                energies.count += (band.width * band.height) as f64;
            }
        }
        energies
    }

    /// Multiplies the reference's coefficients by the factors of the age.
    fn predict(&mut self, geometry: &Geometry) {
        let planes = self.reference.iter().zip(&mut self.predicted).zip(&FACTORS[self.says.age]);
        for ((warped, predicted), factors) in planes {
            for band in geometry.bands() {
                let factor = i32::from(factors[band.rank()]);
                for row in band.rows(geometry) {
                    let from = &warped[row.clone()];
                    for (to, value) in predicted[row].iter_mut().zip(from) {
                        *to = (value * factor + (1 << (PLACES - 1))) >> PLACES;
                    }
                }
            }
        }
    }

    /// Drops the prediction of blocks that it makes no cheaper. Whether all in all it pays.
    fn choose_blocks(&mut self, geometry: &Geometry, difference: &Planes) -> Pays {
        let (columns, rows) = geometry.sizes[geometry.levels];
        let predicted = &self.predicted;
        let add = |costs: &mut (i64, i64), plane: usize, index: usize, scale: i64| {
            let (value, predicted) = (difference[plane][index], predicted[plane][index]);
            costs.0 += block_cost::cost(value, scale);
            costs.1 += block_cost::cost(value.wrapping_sub(predicted), scale);
        };
        let mut low = (0, 0);
        block_cost::visit_low(geometry, &mut |plane, i, scale| add(&mut low, plane, i, scale));
        let (plain, left) = low;
        self.says.low = left <= plain;
        let (mut all, mut min) = (plain, plain.min(left));
        for by in 0..rows {
            for bx in 0..columns {
                let mut costs = (0, 0);
                let add = |plane, i, scale| add(&mut costs, plane, i, scale);
                block_cost::visit_details(geometry, (bx, by), add);
                let (plain, left) = costs;
                self.blocks[by * columns + bx] = left <= plain;
                (all, min) = (all + plain, min + plain.min(left));
            }
        }
        self.drop_blocks(geometry);
        Pays::of(all, min)
    }

    /// Zeroes the prediction where there is to be none.
    fn drop_blocks(&mut self, geometry: &Geometry) {
        if self.says.low && !self.blocks.contains(&false) {
            return;
        }
        for band in geometry.bands() {
            for (y, row) in band.rows(geometry).enumerate() {
                for (x, index) in row.enumerate() {
                    let keeps = match band.orientation {
                        Orientation::Low => self.says.low,
                        _ => self.blocks[geometry.block(&band, x, y)],
                    };
                    if !keeps {
                        self.predicted.iter_mut().for_each(|plane| plane[index] = 0);
                    }
                }
            }
        }
    }

    /// Makes what contexts look at, and the picture.
    fn finish(&mut self, geometry: &Geometry, scratch: &mut Scratch) {
        let Inter { predicted, energy, picture, rows, .. } = self;
        for ((predicted, energy), picture) in predicted.iter().zip(energy).zip(picture) {
            box_mean(predicted, geometry, rows, energy);
            picture.copy_from_slice(predicted);
            for level in (0..geometry.levels).rev() {
                lifting::inverse(picture, geometry.width, geometry.sizes[level], scratch);
            }
        }
    }

    pub fn write(&self, encoder: &mut RangeEncoder) {
        for bit in (0..AGES.ilog2()).rev() {
            encoder.put(self.says.age >> bit & 1 > 0, EVEN);
        }
        encoder.put(!self.says.low, LOW_PLAIN);
        let some = self.blocks.contains(&false);
        encoder.put(some, SOME_BLOCKS);
        if some {
            super::header::write_blocks(&self.blocks, encoder);
        }
    }

    /// Reads it, and makes the prediction's picture from the reference that was set.
    pub fn read(
        &mut self,
        geometry: &Geometry,
        decoder: &mut RangeDecoder,
        scratch: &mut Scratch,
    ) -> Option<()> {
        let mut age = 0;
        for _ in 0..AGES.ilog2() {
            age = age << 1 | usize::from(decoder.get(EVEN)?);
        }
        let low = !decoder.get(LOW_PLAIN)?;
        self.blocks.fill(true);
        if decoder.get(SOME_BLOCKS)? {
            super::header::read_blocks(&mut self.blocks, decoder)?;
        }
        self.says = Says { age, low };
        self.predict(geometry);
        self.drop_blocks(geometry);
        self.finish(geometry, scratch);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_fade() {
        for age in 0..AGES {
            for plane in 0..PLANES {
                for rank in 0..RANKS {
                    let one = f64::from(ONE_FRAME[plane][rank]) / 1024.0;
                    let due = 256.0 * one.powf(f64::from(QUARTERS[age]) / 4.0);
                    let found = f64::from(FACTORS[age][plane][rank]);
                    assert!(
                        (found - due.min(255.0)).abs() < 1.0,
                        "{age} {plane} {rank}: {found} {due}"
                    );
                }
            }
        }
    }
}
