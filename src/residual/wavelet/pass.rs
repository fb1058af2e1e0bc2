//! The coding order, and what is decoded along it.
//!
//! From coarse to fine: the low band, then level by level; within a level by orientation, within that by plane.
//! After each level the decoded picture of the next one is known, which contexts look at.

use std::ops::Range;

use super::coarser::Coarser;
use super::colour;
use super::context::BandContext;
use super::frame::Frame;
use super::gains::Gains;
use super::geometry::{Band, Finest, Geometry, Orientation, Planes};
use super::lifting::{self, Scratch};
use super::predictor::{MagnitudeInputs, Predictor, QuietInputs, SignInputs};
use super::quantised::{Quantised, is_any};
use super::small_blocks::left_out;
use crate::coder_tables::PLANES;
use crate::coder_tables::networks::FEATURE_PLACES;

/// Coefficients of a row whose contexts see the pictures together, or that are zero together.
const TOGETHER: usize = 64;

/// The coefficient that is due.
pub struct Due<'a> {
    pub context: &'a BandContext<'a>,
    quantised: &'a Quantised,
    x: usize,
    y: usize,
    /// What the context sees of both pictures, if all are asked for.
    seen: Option<&'a QuietInputs>,
}

impl Due<'_> {
    /// Place in a transformed plane.
    pub fn index(&self) -> usize {
        self.context.index(self.x, self.y)
    }

    /// Whether nothing near, above or beside was coded as anything but zero.
    pub fn is_quiet(&self) -> bool {
        self.quantised.is_quiet(self.context.own, self.x, self.y)
    }

    /// Inputs of the network for magnitudes.
    pub fn magnitude_inputs(&self) -> MagnitudeInputs {
        self.context.magnitude_inputs(self.quantised, self.x, self.y, &self.quiet_inputs())
    }

    /// Inputs of the network for quiet contexts.
    pub fn quiet_inputs(&self) -> QuietInputs {
        if let Some(seen) = self.seen {
            return *seen;
        }
        let mut seen = [[[0; 2]; _]];
        self.context.see(self.x..self.x + 1, self.y, &mut seen);
        let [seen] = seen;
        seen
    }

    /// Inputs of the network for signs.
    pub fn sign_inputs(&self) -> SignInputs {
        self.context.sign_inputs(self.quantised, self.x, self.y)
    }
}

/// Tells the coefficients of a frame, in order.
pub trait Source {
    /// It looks at the contexts of all coefficients.
    const LOOKS_AT_ALL: bool;

    /// The next coefficient; `None`: this one and all that follow are not known.
    fn next(&mut self, due: &Due) -> Option<i16>;

    /// Whether all coefficients at such places of a transformed plane are surely zero: they are not asked for then.
    fn are_zeros(&self, _plane: usize, _places: Range<usize>) -> bool {
        false
    }

    /// The gains of a level, after its coefficients. `zeros` are the contexts of its first plane.
    fn gains(&mut self, zeros: &[BandContext; 3], quantised: &Quantised) -> Option<Gains>;
}

/// What a pass is about.
struct Run<'a, S> {
    frame: &'a Frame,
    predictor: &'a Predictor,
    finest: Finest,
    source: &'a mut S,
    /// The rest is not known.
    ended: bool,
}

/// Room for a pass, and its outcome.
pub struct Pass {
    pub quantised: Quantised,
    /// Decoded planes of the difference between picture and render.
    decoded: [Vec<i32>; PLANES],
    /// What contexts look at of them.
    coarser: Coarser,
    /// The gains of the finest level, until it is decoded.
    unfinished: Option<Gains>,
    /// What of the render is taken out, by plane.
    taken: Planes,
    /// It is the frame's.
    is_taken: bool,
    scratch: Scratch,
}

impl Pass {
    /// For pictures of a size.
    pub fn new(geometry: &Geometry) -> Pass {
        Pass {
            quantised: Quantised::new(geometry),
            decoded: std::array::from_fn(|_| vec![0; geometry.len()]),
            coarser: Coarser::new(geometry),
            unfinished: None,
            taken: std::array::from_fn(|_| vec![0; geometry.len()]),
            is_taken: false,
            scratch: Scratch::new(geometry.width, geometry.height),
        }
    }

    /// Asks for all coefficients, and makes the planes of the difference but for the finest level: see
    /// [`Pass::finish`].
    pub fn run(
        &mut self,
        frame: &Frame,
        predictor: &Predictor,
        finest: Finest,
        source: &mut impl Source,
    ) {
        let geometry = &frame.geometry;
        let mut run = Run { frame, predictor, finest, source, ended: false };
        self.quantised.clear();
        let low = geometry.band(geometry.levels, Orientation::Low);
        self.code(&mut run, low);
        self.dequantise(frame, predictor, low, Gains::default());
        let mut gains = Gains::default();
        for level in (1..=geometry.levels).rev() {
            if level < geometry.levels {
                self.join(frame, predictor, level + 1, gains);
            }
            self.look(&run, level);
            let bands = Orientation::DETAILS.map(|orientation| geometry.band(level, orientation));
            for band in bands {
                self.code(&mut run, band);
            }
            gains = self.gains(&mut run, bands);
        }
        self.unfinished = Some(gains);
    }

    /// Makes the planes of the difference, if they are not there yet. No context looks at them.
    pub fn finish(&mut self, frame: &Frame, predictor: &Predictor) {
        let Some(gains) = self.unfinished.take() else { return };
        if frame.geometry.levels > 0 {
            self.join(frame, predictor, 1, gains);
        }
        if !frame.is_all_predicted() {
            self.take_out_render(frame);
        }
    }

    /// Decodes a level's bands, and joins them to the low band of the next finer one.
    fn join(&mut self, frame: &Frame, predictor: &Predictor, level: usize, gains: Gains) {
        for orientation in Orientation::DETAILS {
            let band = frame.geometry.band(level, orientation);
            self.dequantise(frame, predictor, band, gains);
        }
        for plane in &mut self.decoded {
            let geometry = &frame.geometry;
            lifting::inverse(plane, geometry.width, geometry.sizes[level - 1], &mut self.scratch);
        }
    }

    /// Makes what the contexts of a level look at.
    fn look(&mut self, run: &Run<impl Source>, level: usize) {
        let Pass { coarser, decoded, .. } = self;
        if run.frame.sees_render {
            coarser.set_light(run.frame, &decoded[0], level);
        }
        for (plane, (decoded, finest)) in decoded.iter().zip(run.finest).enumerate() {
            if level >= finest && !run.ended {
                coarser.set_low(run.frame, decoded, level, plane);
            }
        }
    }

    /// Asks for the coefficients of a band, plane by plane.
    fn code(&mut self, run: &mut Run<impl Source>, band: Band) {
        for plane in 0..PLANES {
            if band.level >= run.finest[plane] && !run.ended {
                run.ended = self.code_plane(run, band, plane).is_none();
            }
        }
    }

    fn code_plane<S: Source>(&mut self, run: &mut Run<S>, band: Band, plane: usize) -> Option<()> {
        let Pass { quantised, coarser, .. } = self;
        let mut seen: [QuietInputs; TOGETHER] = [[[0; 2]; _]; _];
        let context = BandContext::new(run.frame, run.predictor, quantised, coarser, band, plane);
        for y in 0..band.height {
            for first in (0..band.width).step_by(TOGETHER) {
                let xs = first..(first + TOGETHER).min(band.width);
                if run.source.are_zeros(plane, context.index(first, y)..context.index(xs.end, y)) {
                    continue;
                }
                if S::LOOKS_AT_ALL {
                    context.see(xs.clone(), y, &mut seen);
                }
                for (x, seen) in xs.zip(&seen) {
                    let seen = S::LOOKS_AT_ALL.then_some(seen);
                    let due = Due { context: &context, quantised, x, y, seen };
                    let value = run.source.next(&due)?;
                    if value != 0 {
                        quantised.set(plane, &band, x, y, value);
                    }
                }
            }
        }
        Some(())
    }

    /// Asks for the gains of a level.
    fn gains(&mut self, run: &mut Run<impl Source>, bands: [Band; 3]) -> Gains {
        if run.ended || !run.frame.sees_render {
            return Gains::default();
        }
        let Pass { quantised, coarser, .. } = self;
        let context =
            |band| BandContext::new(run.frame, run.predictor, quantised, coarser, band, 0);
        let gains = run.source.gains(&bands.map(context), quantised);
        run.ended = gains.is_none();
        gains.unwrap_or_default()
    }

    /// Writes a band's decoded coefficients to their places in the planes.
    fn dequantise(&mut self, frame: &Frame, predictor: &Predictor, band: Band, gains: Gains) {
        let units = frame.step.units(frame.geometry.norm(&band));
        for plane in 0..PLANES {
            let offsets = &predictor.offsets[plane][band.rank()];
            for (y, place) in band.rows(&frame.geometry).enumerate() {
                let row = self.quantised.row(plane, &band, y);
                let decoded = &mut self.decoded[plane][place];
                if !is_any(row) {
                    decoded.fill(0);
                    continue;
                }
                for (to, value) in decoded.iter_mut().zip(row) {
                    *to = dequantised(*value, offsets, units);
                }
            }
        }
        if !gains.is_zero() {
            self.fill_zeros(frame, predictor, band, gains, units);
        }
    }

    /// Decodes the zeros of the first plane.
    fn fill_zeros(
        &mut self,
        frame: &Frame,
        predictor: &Predictor,
        band: Band,
        gains: Gains,
        units: i64,
    ) {
        let Pass { quantised, coarser, decoded, .. } = self;
        let context = BandContext::new(frame, predictor, quantised, coarser, band, 0);
        let [decoded, ..] = decoded;
        context.zeros(quantised, |index, seen| {
            let value = i64::from(gains.value(seen));
            decoded[index] = ((value * units) >> (16 + FEATURE_PLACES)) as i32;
        });
    }

    /// Takes out of the decoded planes what of the render nothing is predicted from. Only here: contexts look at the
    /// decoded planes, and may not see the render in them.
    fn take_out_render(&mut self, frame: &Frame) {
        let Pass { decoded, taken, is_taken, scratch, .. } = self;
        if !std::mem::replace(is_taken, true) {
            let Frame { geometry, render, weights, .. } = frame;
            for (taken, render) in taken.iter_mut().zip(&render.planes) {
                for (to, (render, weight)) in taken.iter_mut().zip(render.iter().zip(weights)) {
                    *to = left_out(*render, *weight);
                }
                for level in (0..geometry.levels).rev() {
                    lifting::inverse(taken, geometry.width, geometry.sizes[level], scratch);
                }
            }
        }
        for (decoded, taken) in decoded.iter_mut().zip(taken) {
            for (to, taken) in decoded.iter_mut().zip(taken) {
                *to = to.wrapping_sub(*taken);
            }
        }
    }

    /// To be called whenever the render or its weights change.
    pub fn forget_render(&mut self) {
        self.is_taken = false;
    }

    /// Adds the decoded difference to a render, once it is finished, and what was predicted of it from a reference.
    pub fn add_to(&self, inter: Option<&Planes>, render: &mut [u8]) {
        let planes = self.decoded.each_ref().map(|plane| plane.chunks(AT_ONCE));
        let [a, b, c] = planes;
        for (i, (pixels, ((a, b), c))) in
            render.chunks_mut(3 * AT_ONCE).zip(a.zip(b).zip(c)).enumerate()
        {
            let mut planes = [[0; AT_ONCE]; PLANES];
            for (to, from) in planes.iter_mut().zip([a, b, c]) {
                to[..from.len()].copy_from_slice(from);
            }
            for (to, inter) in planes.iter_mut().zip(inter.into_iter().flatten()) {
                for (to, inter) in to.iter_mut().zip(&inter[i * AT_ONCE..]) {
                    *to = to.wrapping_add(*inter);
                }
            }
            add(&planes, pixels);
        }
    }
}

/// Pixels that are added at once.
const AT_ONCE: usize = 16;

/// Adds planes to pixels.
fn add(planes: &[[i32; AT_ONCE]; PLANES], pixels: &mut [u8]) {
    let difference = colour::to_rgb(planes);
    for (i, pixel) in pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        for (to, difference) in pixel.iter_mut().zip(&difference) {
            *to = (i32::from(*to) + difference[i]).clamp(0, 255) as u8;
        }
    }
}

/// A lifted coefficient of a quantised one.
fn dequantised(value: i16, offsets: &[i8; 3], units: i64) -> i32 {
    if value == 0 {
        return 0;
    }
    let magnitude = i32::from(value).abs();
    let offset = offsets[magnitude.min(3) as usize - 1];
    let parts = i64::from((magnitude << 8) - i32::from(offset));
    let lifted = ((parts * units) >> 24) as i32;
    if value < 0 { -lifted } else { lifted }
}

#[cfg(test)]
mod tests {
    use super::super::{Step, WaveletEncoder};
    use super::*;
    use crate::Picture;
    use crate::coder_tables::Tables;
    use crate::coder_tables::networks::COUNT_INPUTS;

    /// A picture of few or many details.
    fn picture(width: u32, height: u32, every: usize) -> Picture {
        let mut picture = Picture::new(width, height);
        for (i, value) in picture.data.iter_mut().enumerate() {
            *value = if i / 3 % every == 0 { (i * i % 251) as u8 } else { 100 };
        }
        picture
    }

    #[test]
    fn contexts_are_quiet_if_they_see_zeros_alone() {
        for (width, height) in [(1, 1), (1, 9), (7, 2), (33, 17), (65, 43), (96, 54)] {
            for (every, step) in [(1, 30), (97, 20), (997, 4)] {
                let mut encoder = WaveletEncoder::new(width, height, &Tables::generic());
                encoder.set(&picture(width, height, every), &Picture::new(width, height), true);
                encoder.choose(Step::new(step), 0.1);
                encoder.show(|due, _, _| {
                    let mut counts = [0; COUNT_INPUTS];
                    due.context.counts(due.quantised, due.x, due.y, &mut counts);
                    let Due { x, y, .. } = due;
                    assert_eq!(due.is_quiet(), counts == [0; _], "{:?} {x} {y}", due.context.band);
                });
            }
        }
    }
}
