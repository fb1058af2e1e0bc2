//! What splats look like, as bits: sizes against those before, turns as they are, colours against up to four that came
//! up before.

use super::splat::{NewSplat, idle_axis};
use crate::adaptive_numbers::{Chance, Signed};
use crate::range_coder::Bits;
use crate::range_coder::EVEN;

/// What is known of the splats before.
pub struct Attributes {
    sizes: [Signed; 2],
    turns: [Signed; 2],
    opacities: Signed,
    colours: Colours,
    /// All scales so far.
    scales: Mean<1>,
}

/// What a scale is thought to be before one is known: the logarithm −3, in steps.
const USUAL_SCALE: i32 = -12;
/// The same for an opacity: a logit of 1.6.
const USUAL_OPACITY: i32 = 2;

impl Attributes {
    pub fn new() -> Attributes {
        Attributes {
            sizes: [Signed::new(3), Signed::new(2)],
            turns: [Signed::new(3), Signed::new(1)],
            opacities: Signed::new(2),
            colours: Colours::new(),
            scales: Mean::NONE,
        }
    }

    /// Codes all of a splat but its position. `None` if a number read is none that a splat can have.
    pub fn code(&mut self, coder: &mut impl Bits, splat: &NewSplat) -> Option<NewSplat> {
        let log_scale = self.log_scale(coder, splat.log_scale.map(i32::from));
        let rotation = self.rotation(coder, log_scale, splat.rotation.map(i32::from));
        let opacity = self.opacity(coder, splat.opacity);
        let colour = self.colour(coder, splat.colour.map(i32::from))?;
        Some(NewSplat {
            position: splat.position,
            log_scale: small(log_scale)?,
            rotation: small(rotation)?,
            opacity: i8::try_from(opacity).ok()?,
            colour: small(colour)?,
        })
    }

    /// The first scale against the mean of all before, the others also against those of the same splat.
    fn log_scale(&mut self, coder: &mut impl Bits, [a, b, c]: [i32; 3]) -> [i32; 3] {
        let mean = self.scales.value().map_or(USUAL_SCALE, |[mean]| mean);
        let mut code = |model: usize, known: i32, guess: i64| {
            let guess = guess as i32;
            self.sizes[model].code(coder, known.wrapping_sub(guess)).wrapping_add(guess)
        };
        let wide = i64::from;
        let a = code(0, a, wide(mean));
        let b = code(1, b, (wide(mean) + wide(a)).div_euclid(2));
        let c = code(1, c, (wide(mean) + wide(a) + wide(b) + 1).div_euclid(3));
        for scale in [a, b, c] {
            self.scales.add([scale]);
        }
        [a, b, c]
    }

    /// Turns that show nothing are rare in what [`NewSplat::nearest`] makes; a round splat has none at all.
    fn rotation(&mut self, coder: &mut impl Bits, scales: [i32; 3], turn: [i32; 3]) -> [i32; 3] {
        let [a, b, c] = scales;
        if a == b && b == c {
            return [0; 3];
        }
        let idle = idle_axis(scales);
        [0, 1, 2].map(|axis| {
            let model = usize::from(idle == Some(axis));
            self.turns[model].code(coder, turn[axis])
        })
    }

    fn opacity(&mut self, coder: &mut impl Bits, steps: i8) -> i32 {
        let off = i32::from(steps) - USUAL_OPACITY;
        self.opacities.code(coder, off).wrapping_add(USUAL_OPACITY)
    }

    /// Green, then red and blue less green: most colours differ in light more than in hue.
    fn colour(&mut self, coder: &mut impl Bits, [r, g, b]: [i32; 3]) -> Option<[i32; 3]> {
        let [g, red, blue] = self.colours.code(coder, [g, r - g, b - g])?;
        Some([g.checked_add(red)?, g, g.checked_add(blue)?])
    }
}

fn small(values: [i32; 3]) -> Option<[i8; 3]> {
    let [a, b, c] = values.map(|value| i8::try_from(value).ok());
    Some([a?, b?, c?])
}

/// Colours that are kept apart. An object has a few; each splat says which one it has, then how far it is off.
struct Colours {
    means: Vec<Mean<3>>,
    /// By the choice of the splat before: whether the choice lies beyond each one.
    beyond: [[Chance; Colours::MOST]; Colours::MOST],
    last: usize,
    off: [Signed; 3],
    fresh: [Signed; 3],
}

impl Colours {
    /// Measured on objects of three colours: a distance of 6 to 14 costs about the same, and six colours cost more.
    const MOST: usize = 4;
    /// A colour this far from all known ones is a new one, steps of all three numbers together.
    const FAR: u64 = 10;

    fn new() -> Colours {
        let fresh = || Signed::new(5);
        Colours {
            means: Vec::new(),
            beyond: [[Chance::of(EVEN, 0); Colours::MOST]; Colours::MOST],
            last: 0,
            off: [Signed::new(2), Signed::new(1), Signed::new(1)],
            fresh: [fresh(), fresh(), fresh()],
        }
    }

    fn code(&mut self, coder: &mut impl Bits, colour: [i32; 3]) -> Option<[i32; 3]> {
        let choice = self.choice(coder, colour);
        let is_fresh = choice == self.means.len();
        if is_fresh {
            self.means.push(Mean::NONE);
        }
        let models = if is_fresh { &mut self.fresh } else { &mut self.off };
        let base = if is_fresh { &self.means[0] } else { &self.means[choice] };
        let base = base.value().unwrap_or_default();
        let mut read = [0_i32; 3];
        for (channel, model) in models.iter_mut().enumerate() {
            let off = model.code(coder, colour[channel].wrapping_sub(base[channel]));
            read[channel] = base[channel].checked_add(off)?;
        }
        self.means[choice].add(read);
        self.last = choice;
        Some(read)
    }

    /// Codes which colour it is: one before, or the next.
    fn choice(&mut self, coder: &mut impl Bits, colour: [i32; 3]) -> usize {
        let distance = |mean: &Mean<3>| {
            let mean = mean.value().unwrap_or_default();
            (0..3).map(|channel| u64::from(mean[channel].abs_diff(colour[channel]))).sum::<u64>()
        };
        let nearest = (0..self.means.len()).min_by_key(|known| distance(&self.means[*known]));
        let is_near = |known: &usize| distance(&self.means[*known]) <= Colours::FAR;
        let full = self.means.len() == Colours::MOST;
        let wanted = nearest.filter(|known| full || is_near(known)).unwrap_or(self.means.len());
        let last = self.means.len().min(Colours::MOST - 1);
        let chances = &mut self.beyond[self.last];
        let mut choice = 0;
        while choice < last && chances[choice].code(coder, wanted > choice) {
            choice += 1;
        }
        choice
    }
}

/// A mean of whole numbers, rounded.
struct Mean<const N: usize> {
    sums: [i64; N],
    count: i64,
}

impl<const N: usize> Mean<N> {
    const NONE: Mean<N> = Mean { sums: [0; N], count: 0 };

    /// Numbers of 32 bits: their sums stay far within 64.
    fn add(&mut self, values: [i32; N]) {
        for (sum, value) in self.sums.iter_mut().zip(values) {
            *sum += i64::from(value);
        }
        self.count += 1;
    }

    /// `None` if there was no number yet.
    fn value(&self) -> Option<[i32; N]> {
        let count = self.count;
        let round = |sum: i64| (2 * sum + count).div_euclid(2 * count) as i32;
        (count > 0).then(|| self.sums.map(round))
    }
}

#[cfg(test)]
mod figures;
