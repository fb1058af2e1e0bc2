//! Which blocks of the picture are predicted from the render.
//!
//! If a new object hides what the prior shows, or the pose is lost, the render's details are worth less than
//! nothing there: they would have to be taken away again.

use super::fixed::{ONE, log_size};
use super::frame::Frame;
use super::geometry::{Geometry, Orientation, Planes};
use super::render::RenderBands;
use super::step::Step;
use crate::coder_tables::PLANES;

/// The step at which both ways are compared: amid those in use.
pub const COMPARED_AT: u8 = 36;
/// Coefficients below this cost nothing, as features.
const DEAD: i32 = 45;
/// The render must cost so many bits more, and one part in [`PART`].
const BITS: i64 = 8;
const PART: i64 = 16;

/// Chooses, and makes the difference that of what is predicted.
pub fn choose(frame: &mut Frame, difference: &mut Planes) {
    let (columns, rows) = frame.geometry.sizes[frame.geometry.levels];
    for by in 0..rows {
        for bx in 0..columns {
            let block = (bx, by);
            let predicted = is_useful(frame, difference, |geometry, call| {
                visit_details(geometry, block, call);
            });
            frame.predicted[by * columns + bx] = predicted;
            if !predicted {
                let Frame { geometry, render, .. } = &*frame;
                visit_details(geometry, block, |plane, i, _| add(difference, render, plane, i));
            }
        }
    }
    frame.low_predicted = is_useful(frame, difference, visit_low);
    if !frame.low_predicted {
        let Frame { geometry, render, .. } = &*frame;
        visit_low(geometry, &mut |plane, i, _| add(difference, render, plane, i));
    }
}

/// Takes back what [`choose`] did, so that all is predicted from the render. Returns whether a block changes.
pub fn predict_all(frame: &mut Frame, difference: &mut Planes) -> bool {
    let columns = frame.geometry.sizes[frame.geometry.levels].0;
    let Frame { geometry, render, predicted, low_predicted, .. } = frame;
    let changes = !*low_predicted || predicted.contains(&false);
    for (at, predicted) in predicted.iter_mut().enumerate().filter(|(_, predicted)| !**predicted) {
        *predicted = true;
        let block = (at % columns, at / columns);
        visit_details(geometry, block, &mut |plane, i, _| take_away(difference, render, plane, i));
    }
    if !*low_predicted {
        *low_predicted = true;
        visit_low(geometry, &mut |plane, i, _| take_away(difference, render, plane, i));
    }
    changes
}

fn take_away(difference: &mut Planes, render: &RenderBands, plane: usize, index: usize) {
    let value = &mut difference[plane][index];
    *value = value.wrapping_sub(render.planes[plane][index]);
}

fn add(difference: &mut Planes, render: &RenderBands, plane: usize, index: usize) {
    let value = &mut difference[plane][index];
    *value = value.wrapping_add(render.planes[plane][index]);
}

/// Whether coefficients cost less beside the render than without it.
fn is_useful(
    frame: &Frame,
    difference: &Planes,
    visit: impl FnOnce(&Geometry, &mut dyn FnMut(usize, usize, i64)),
) -> bool {
    let (mut with, mut without) = (0, 0);
    visit(&frame.geometry, &mut |plane, index, scale| {
        let value = difference[plane][index];
        with += cost(value, scale);
        without += cost(value.wrapping_add(frame.render.planes[plane][index]), scale);
    });
    with <= without + without / PART + BITS * i64::from(ONE)
}

/// Bits of a coefficient, as a feature.
pub fn cost(lifted: i32, scale: i64) -> i64 {
    let size = ((i64::from(lifted) * scale) >> 16).abs().min(1 << 24) as i32;
    if size < DEAD { 0 } else { i64::from(log_size(size) + 3 * ONE) }
}

/// Calls with every coefficient of the coarsest low band: plane, index, and [`Step::per_unit`].
pub fn visit_low(geometry: &Geometry, call: &mut dyn FnMut(usize, usize, i64)) {
    let band = geometry.band(geometry.levels, Orientation::Low);
    let scale = Step::new(COMPARED_AT).per_unit(geometry.norm(&band));
    for index in band.rows(geometry).flatten() {
        (0..PLANES).for_each(|plane| call(plane, index, scale));
    }
}

/// Calls with every detail coefficient of a block: plane, index, and [`Step::per_unit`].
pub fn visit_details(
    geometry: &Geometry,
    (bx, by): (usize, usize),
    mut call: impl FnMut(usize, usize, i64),
) {
    let (columns, rows) = geometry.sizes[geometry.levels];
    let step = Step::new(COMPARED_AT);
    for band in geometry.bands().filter(|band| band.orientation != Orientation::Low) {
        let scale = step.per_unit(geometry.norm(&band));
        let shift = geometry.levels - band.level;
        let range = |block: usize, blocks: usize, len: usize| {
            let end = if block + 1 == blocks { len } else { ((block + 1) << shift).min(len) };
            (block << shift).min(end)..end
        };
        for y in range(by, rows, band.height) {
            for x in range(bx, columns, band.width) {
                let index = band.offset + y * geometry.width + x;
                (0..PLANES).for_each(|plane| call(plane, index, scale));
            }
        }
    }
}
