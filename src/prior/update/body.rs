//! The coded part of an update: one function for both ways, see [`Bits`].

use super::attributes::Attributes;
use super::change::Change;
use super::changes::{self, code_ordinal};
use super::fade::Fade;
use super::grid::UpdateGrid;
use super::limits::{EXPONENTS, MAX_FADES, MAX_LEARNT};
use super::places;
use super::splat::NewSplat;
use crate::adaptive_numbers::{Magnitude, plain};
use crate::range_coder::Bits;

/// What is coded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Body {
    /// Bits of the origin.
    pub origin: [u32; 3],
    pub exponent: i8,
    pub frames: [u32; 2],
    /// In the order of the format.
    pub splats: Vec<NewSplat>,
    pub removed: Vec<u16>,
    pub changed: Vec<Change>,
    pub fades: Vec<Fade>,
}

impl Body {
    pub fn grid(&self) -> UpdateGrid {
        UpdateGrid { origin: self.origin.map(f32::from_bits), exponent: self.exponent }
    }

    /// Codes it, and returns it. What is read has no more parts than the limits allow, but is not checked otherwise;
    /// the reason, if it cannot be read.
    pub fn code(&self, coder: &mut impl Bits) -> Result<Body, String> {
        let origin = self.origin.map(|bits| plain(coder, 32, bits));
        let least = *EXPONENTS.start();
        let exponent = plain(coder, 7, u32::from(self.exponent.wrapping_sub(least) as u8));
        let exponent = (exponent as i8).wrapping_add(least);
        let first = plain(coder, FRAME_BITS, self.frames[0]);
        let length = self.frames[1].wrapping_sub(first) & FRAME_MASK;
        let length = Magnitude::new().code(coder, length);
        let frames = [first, first.wrapping_add(length) & FRAME_MASK];
        let splats = count(coder, self.splats.len(), MAX_LEARNT, "splats")?;
        let removed = count(coder, self.removed.len(), MAX_LEARNT, "removed splats")?;
        let changed = count(coder, self.changed.len(), MAX_LEARNT, "changed splats")?;
        let fades = count(coder, self.fades.len(), MAX_FADES, "fades")?;
        let splats = code_splats(coder, &self.splats, splats)?;
        let removed = code_removed(coder, &self.removed, removed)?;
        let changed = changes::code(coder, &self.changed, changed)?;
        let fades = code_fades(coder, &self.fades, fades);
        Ok(Body { origin, exponent, frames, splats, removed, changed, fades })
    }
}

const FRAME_BITS: u32 = 24;
const FRAME_MASK: u32 = (1 << FRAME_BITS) - 1;

fn count(coder: &mut impl Bits, known: usize, most: usize, what: &str) -> Result<usize, String> {
    let read = Magnitude::new().code(coder, known as u32) as usize;
    if read <= most { Ok(read) } else { Err(format!("{read} {what}: at most {most}")) }
}

fn code_splats(
    coder: &mut impl Bits,
    known: &[NewSplat],
    count: usize,
) -> Result<Vec<NewSplat>, String> {
    let mut positions: Vec<[i32; 3]> = known.iter().map(|splat| splat.position).collect();
    positions.resize(count, [0; 3]);
    places::code(coder, &mut positions);
    let mut attributes = Attributes::new();
    let mut splats = Vec::new();
    for (index, position) in positions.into_iter().enumerate() {
        let splat = known.get(index).copied().unwrap_or_default();
        let read = attributes.code(coder, &NewSplat { position, ..splat });
        splats.push(read.ok_or_else(|| format!("splat {index} has a number of too many steps"))?);
    }
    Ok(splats)
}

/// Codes how many learnt splats stay between those that are taken back.
fn code_removed(coder: &mut impl Bits, known: &[u16], count: usize) -> Result<Vec<u16>, String> {
    let (mut gaps, mut removed) = (Magnitude::new(), Vec::new());
    let mut due = 0;
    for index in 0..count {
        let ordinal = known.get(index).copied().unwrap_or_default();
        let ordinal = code_ordinal(coder, &mut gaps, due, ordinal);
        let ordinal = ordinal.ok_or_else(|| format!("removed splat {index} lies too far"))?;
        removed.push(ordinal);
        due = ordinal + 1;
    }
    Ok(removed)
}

fn code_fades(coder: &mut impl Bits, known: &[Fade], count: usize) -> Vec<Fade> {
    let (mut places, mut sizes) = (Magnitude::new(), Magnitude::new());
    let (mut fades, mut last) = (Vec::new(), [0_i32; 3]);
    for index in 0..count {
        let fade = known.get(index).copied().unwrap_or_default();
        let (mut min, mut max) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            let off = places::fold(fade.min[axis].wrapping_sub(last[axis]));
            min[axis] = last[axis].wrapping_add(places::unfold(places.code(coder, off)));
            let size = fade.max[axis].wrapping_sub(min[axis]) as u32;
            max[axis] = min[axis].wrapping_add(sizes.code(coder, size) as i32);
        }
        let factor = plain(coder, 8, fade.factor.into()) as u8;
        fades.push(Fade { min, max, factor });
        last = min;
    }
    fades
}
