//! Which blocks of the picture are predicted from the render.
//!
//! If a new object hides what the prior shows, or the pose is lost, the render's details are worth less than
//! nothing there: they would have to be taken away again.

use super::block_cost::{cost, visit_details, visit_low};
use super::fixed::ONE;
use super::frame::Frame;
use super::geometry::{Geometry, Planes};
use super::render::RenderBands;

/// The render must cost so many bits more, and one part in [`PART`].
const BITS: i64 = 8;
const PART: i64 = 16;

/// Chooses blocks of 64×64 pixels, and makes the difference that of what is predicted.
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
