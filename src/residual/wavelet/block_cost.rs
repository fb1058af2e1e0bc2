//! What a block's coefficients cost, about, by which ways to predict it are compared.

use super::fixed::{ONE, log_size};
use super::geometry::{Geometry, Orientation};
use super::step::Step;
use crate::coder_tables::PLANES;

/// The step at which both ways are compared: amid those in use.
pub const COMPARED_AT: u8 = 36;
/// Coefficients below this cost nothing, as features.
const DEAD: i32 = 45;

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
