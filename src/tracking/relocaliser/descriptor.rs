//! Descriptors of a picture's patches that hold for any roll, gain and offset. They are histograms of the gradient's
//! directions around a point, turned with the patch, as in SIFT (Lowe, IJCV 2004). Only comparisons of the histograms
//! are kept, one bit each, as in BIG-OH (Baber et al., 2014). So two descriptors are compared by counting bits.

use std::f32::consts::TAU;

/// Comparisons of a patch's histograms, one bit each.
pub type Descriptor = [u64; 4];

/// Number of bits in which two descriptors differ.
pub fn distance(a: &Descriptor, b: &Descriptor) -> u32 {
    (0..4).map(|i| (a[i] ^ b[i]).count_ones()).sum()
}

/// Half the side of a patch, pixels.
pub const RADIUS: usize = 15;
const DIRECTIONS: usize = 8;
/// Histograms along a side of the patch.
const SIDE: usize = 4;
/// Distance of the histograms' middles, pixels.
const STEP: f32 = 7.0;
/// Deviation of the pixels' weights in the histograms, pixels.
const SPREAD: f32 = 12.0;
/// Directions that a patch's own is chosen among.
const TURNS: usize = 36;
/// Deviation of the pixels' weights when the patch's direction is chosen, pixels. Pixels within twice this distance
/// count.
const TURN_SPREAD: f32 = 6.0;
/// How often the histogram of that choice is smoothed.
const SMOOTHED: usize = 4;
/// For each histogram the one that it is compared with: its neighbour clockwise around the patch's middle.
const NEIGHBOUR: [usize; SIDE * SIDE] = [1, 2, 3, 7, 0, 6, 10, 11, 4, 5, 9, 15, 8, 12, 13, 14];

type Histogram = [f32; DIRECTIONS];

/// A pixel of a patch.
struct PatchPixel {
    dx: i32,
    dy: i32,
    /// In the histograms.
    weight: f32,
    /// In the choice of the patch's direction.
    turn_weight: f32,
}

/// The gradient of a picture, and what its patches are described with.
pub struct Describer {
    places: Vec<PatchPixel>,
    width: usize,
    /// For each pixel the gradient's direction, in [`TURNS`], and its length.
    polar: Vec<[f32; 2]>,
}

impl Describer {
    /// Makes one for pictures of up to `pixels` pixels.
    pub fn new(pixels: usize) -> Describer {
        let radius = RADIUS as i32;
        let square = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy)));
        // Every other pixel is enough: the picture is smooth.
        let inside =
            square.filter(|(dx, dy)| (dx + dy) % 2 == 0 && dx * dx + dy * dy <= radius * radius);
        let place = |(dx, dy): (i32, i32)| {
            let away = (dx * dx + dy * dy) as f32;
            let weight = |spread: f32| (-away / (2.0 * spread * spread)).exp();
            let near = away <= 4.0 * TURN_SPREAD * TURN_SPREAD;
            let turn_weight = if near { weight(TURN_SPREAD) } else { 0.0 };
            PatchPixel { dx, dy, weight: weight(SPREAD), turn_weight }
        };
        Describer { places: inside.map(place).collect(), width: 0, polar: vec![[0.0; 2]; pixels] }
    }

    /// Takes the gradient of a picture, row by row.
    pub fn set(&mut self, picture: &[f32], width: usize) {
        self.width = width;
        let count = picture.len();
        self.polar[..count].fill([0.0; 2]);
        for at in width..count.saturating_sub(width) {
            if at % width == 0 || at % width == width - 1 {
                continue;
            }
            let x = picture[at + 1] - picture[at - 1];
            let y = picture[at + width] - picture[at - width];
            self.polar[at] = [turns(x, y), (x * x + y * y).sqrt()];
        }
    }

    /// Describes the patch around a pixel that lies more than [`RADIUS`] from the picture's edges.
    pub fn describe(&self, at: usize) -> Descriptor {
        let direction = self.direction(at);
        let (sin, cos) = direction.sin_cos();
        // Directions are relative to the patch's own; one full turn is added to keep them positive.
        let turned = DIRECTIONS as f32 * (1.0 - (direction / TAU).rem_euclid(1.0));
        let mut histograms = [[0.0; DIRECTIONS]; (SIDE + 1) * (SIDE + 1)];
        for place in &self.places {
            let (dx, dy) = (place.dx as f32, place.dy as f32);
            let middle = 0.5 * (SIDE as f32 - 1.0);
            // One row and column more than there are, for what lies before the first.
            let u = (cos * dx + sin * dy) / STEP + middle + 1.0;
            let v = (cos * dy - sin * dx) / STEP + middle + 1.0;
            let [turn, length] = self.polar[self.index(at, place)];
            let turn = turn * (DIRECTIONS as f32 / TURNS as f32) + turned;
            let (first, after) = split(turn);
            let parts = [
                (first % DIRECTIONS, place.weight * length * (1.0 - after)),
                ((first + 1) % DIRECTIONS, place.weight * length * after),
            ];
            let (column, row) = (u as usize, v as usize);
            let (across, down) = (u - column as f32, v - row as f32);
            for (row, share) in [(row, 1.0 - down), (row + 1, down)] {
                for (column, share) in
                    [(column, share * (1.0 - across)), (column + 1, share * across)]
                {
                    if row <= SIDE && column <= SIDE {
                        let histogram = &mut histograms[row * (SIDE + 1) + column];
                        parts.iter().for_each(|(d, part)| histogram[*d] += share * part);
                    }
                }
            }
        }
        compared(|cell| &histograms[(cell / SIDE + 1) * (SIDE + 1) + cell % SIDE + 1])
    }

    /// The direction in which the patch's gradient points most, radians.
    fn direction(&self, at: usize) -> f32 {
        let mut histogram = [0.0_f32; TURNS];
        for place in self.places.iter().filter(|place| place.turn_weight > 0.0) {
            let [turn, length] = self.polar[self.index(at, place)];
            let (first, share) = split(turn);
            let first = first % TURNS;
            let weight = length * place.turn_weight;
            histogram[first] += weight * (1.0 - share);
            histogram[(first + 1) % TURNS] += weight * share;
        }
        for _ in 0..SMOOTHED {
            let old = histogram;
            for (i, to) in histogram.iter_mut().enumerate() {
                *to = (old[(i + TURNS - 1) % TURNS] + old[i] + old[(i + 1) % TURNS]) / 3.0;
            }
        }
        let mut peak = 0;
        for i in 1..TURNS {
            if histogram[i] > histogram[peak] {
                peak = i;
            }
        }
        // The top of the parabola through the peak and its neighbours.
        let [before, top, after] =
            [TURNS - 1, 0, 1].map(|offset| histogram[(peak + offset) % TURNS]);
        let bend = before - 2.0 * top + after;
        let off = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
        (peak as f32 + off) * (TAU / TURNS as f32)
    }

    fn index(&self, at: usize, place: &PatchPixel) -> usize {
        (at as i32 + place.dy * self.width as i32 + place.dx) as usize
    }
}

/// A positive number's whole part and the rest. (`fract` would call into the C library.)
fn split(value: f32) -> (usize, f32) {
    let whole = value as usize;
    (whole, value - whole as f32)
}

/// Each histogram compared with itself, turned by a direction, and with its neighbour.
fn compared<'a>(histogram: impl Fn(usize) -> &'a Histogram) -> Descriptor {
    let mut descriptor = Descriptor::default();
    for (cell, neighbour) in NEIGHBOUR.iter().enumerate() {
        let (own, other) = (histogram(cell), histogram(*neighbour));
        for direction in 0..DIRECTIONS {
            let bits = [own[(direction + 1) % DIRECTIONS], other[direction]];
            for (half, than) in bits.into_iter().enumerate() {
                let bit = (2 * cell + half) * DIRECTIONS + direction;
                descriptor[bit / 64] |= u64::from(own[direction] > than) << (bit % 64);
            }
        }
    }
    descriptor
}

/// The direction of a vector, in [0, [`TURNS`]), by a polynomial; exact to a tenth of a degree.
fn turns(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (min, max) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let t = if max > 0.0 { min / max } else { 0.0 };
    // Abramowitz & Stegun 4.4.47, shortened.
    let octant = t
        * (0.999_866
            + t * t
                * (-0.330_299_5
                    + t * t * (0.180_141 + t * t * (-0.085_133 + t * t * 0.020_835_1))));
    let quarter = if ax < ay { 0.25 * TAU - octant } else { octant };
    let half = if x < 0.0 { 0.5 * TAU - quarter } else { quarter };
    let angle = if y < 0.0 { TAU - half } else { half };
    angle * (TURNS as f32 / TAU)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_those_of_the_arc_tangent() {
        for degrees in 0..3600 {
            let angle = (0.1 * degrees as f32).to_radians();
            let off = turns(3.0 * angle.cos(), 3.0 * angle.sin()) * TAU / TURNS as f32 - angle;
            let off = (off + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
            assert!(off.abs() < 2e-3, "{degrees}: {off}");
        }
        assert_eq!(turns(0.0, 0.0), 0.0);
    }

    #[test]
    fn every_histogram_is_compared_with_one_beside_it() {
        let mut seen = [false; SIDE * SIDE];
        for (cell, neighbour) in NEIGHBOUR.iter().enumerate() {
            let apart = |of: fn(usize) -> usize| of(cell).abs_diff(of(*neighbour));
            assert!(apart(|c| c % SIDE) + apart(|c| c / SIDE) <= 2, "{cell}");
            seen[*neighbour] = true;
        }
        assert_eq!(seen, [true; SIDE * SIDE]);
    }

    #[test]
    fn a_flat_patch_has_no_bits() {
        let mut describer = Describer::new(40 * 40);
        describer.set(&[0.5; 1600], 40);
        assert_eq!(describer.describe(20 * 40 + 20), [0; 4]);
    }
}
