//! The vehicle's choice of small blocks: by bits and error at the step in use.

use super::fixed::{ONE, log2};
use super::frame::Frame;
use super::geometry::{Band, Geometry, Orientation, Planes};
use super::small_blocks::{FULL, GRIDS, Grid, left_out};

/// Coefficients nearer to zero than this are not coded, features: their error costs less than their bits.
const CODED: u32 = 60;
/// Bits that the squared error of a coefficient of one step is worth, 16ths: those of [`super::fineness::LAMBDA`].
const ERROR: i64 = 123;
/// Bits of a coefficient of one step that is coded, with what its error is worth; as a feature.
const FIRST: i64 = 433;
/// A plain block must save so much, and as much again for each block beside it that is of the other kind more than
/// there are of its own, features.
const PLAIN: i64 = ONE as i64;
const EDGE: i64 = 3 * ONE as i64;
/// All of the plain blocks must save so many bits.
const LEAST: i64 = 8 * ONE as i64;
/// Rounds in which blocks look at those beside them.
const ROUNDS: usize = 4;

/// Chooses small blocks, in memory of its own.
pub struct BlockChooser {
    /// What a block costs more if it is plain, by grid.
    costs: [Vec<i64>; GRIDS],
    plain: [Vec<bool>; GRIDS],
}

impl BlockChooser {
    pub fn new(grids: &[Grid; GRIDS]) -> BlockChooser {
        BlockChooser {
            costs: grids.map(|grid| vec![0; grid.len()]),
            plain: grids.map(|grid| vec![false; grid.len()]),
        }
    }

    /// Chooses at the frame's step, and makes the difference that of what is predicted. In place of what was chosen
    /// before.
    pub fn choose(&mut self, frame: &mut Frame, difference: &mut Planes) {
        take_back(frame, difference);
        self.measure(frame, difference);
        frame.low_predicted = is_low_useful(frame, difference);
        let mut best = (LEAST, None);
        for grid in 0..GRIDS {
            let size = frame.small_blocks.grids[grid];
            settle(size, &self.costs[grid], &mut self.plain[grid]);
            if !self.plain[grid].contains(&true) {
                continue;
            }
            let saved = self.saved(frame, difference, grid);
            if saved > best.0 {
                best = (saved, Some(grid));
            }
        }
        frame.small_blocks.in_use = best.1.is_some();
        if let Some(grid) = best.1 {
            frame.small_blocks.set(grid, &self.plain[grid]);
        }
        frame.weigh();
        leave_out(frame, difference, i32::wrapping_add);
    }

    /// What each block costs more if it is plain: its details up to the grid's level.
    fn measure(&mut self, frame: &Frame, difference: &Planes) {
        self.costs.iter_mut().for_each(|costs| costs.fill(0));
        let grids = &frame.small_blocks.grids;
        for band in frame.geometry.bands().filter(|band| band.level <= grids[GRIDS - 1].level) {
            if band.orientation == Orientation::Low {
                continue;
            }
            visit(frame, difference, &band, |(x, y), _, costs| {
                for (grid, to) in grids.iter().zip(&mut self.costs) {
                    if band.level <= grid.level {
                        to[grid.block(band.level, x, y)] += costs.plain - costs.detailed;
                    }
                }
            });
        }
    }

    /// What a grid's blocks save, less what they take to say.
    fn saved(&self, frame: &mut Frame, difference: &Planes, grid: usize) -> i64 {
        frame.small_blocks.set(grid, &self.plain[grid]);
        frame.small_blocks.in_use = true;
        frame.weigh();
        let plain = self.costs[grid].iter().zip(&self.plain[grid]).filter(|(_, plain)| **plain);
        let mut saved = -plain.map(|(cost, _)| cost).sum::<i64>();
        let level = frame.small_blocks.grids[grid].level;
        for band in frame.geometry.bands().filter(|band| band.level > level) {
            if band.orientation != Orientation::Low {
                visit(frame, difference, &band, |_, mixed, costs| saved += costs.detailed - mixed);
            }
        }
        saved - (frame.small_blocks.bits() * f64::from(ONE)) as i64
    }
}

/// What a coefficient of each plane together costs: predicted from the render, and if it is plain.
struct Costs {
    detailed: i64,
    plain: i64,
}

/// Visits the coefficients of a band: place, cost at the weight as it is, and costs at both ends.
fn visit(
    frame: &Frame,
    difference: &Planes,
    band: &Band,
    mut call: impl FnMut((usize, usize), i64, Costs),
) {
    let scale = frame.step.per_unit(frame.geometry.norm(band));
    for (y, row) in band.rows(&frame.geometry).enumerate() {
        for (x, index) in row.enumerate() {
            let mut costs = Costs { detailed: 0, plain: 0 };
            let mut mixed = 0;
            let weight = frame.weights[index];
            for (difference, render) in difference.iter().zip(&frame.render.planes) {
                let (value, render) = (difference[index], render[index]);
                costs.detailed += cost(value, scale);
                costs.plain += cost(value.wrapping_add(render), scale);
                if weight != FULL && weight != 0 {
                    mixed += cost(value.wrapping_add(left_out(render, weight)), scale);
                }
            }
            match weight {
                FULL => mixed = costs.detailed,
                0 => mixed = costs.plain,
                _ => {}
            }
            call((x, y), mixed, costs);
        }
    }
}

/// Bits of a coefficient, or what its error is worth if it is not coded; as a feature.
pub fn cost(lifted: i32, scale: i64) -> i64 {
    let size = ((i64::from(lifted) * scale) >> 16).unsigned_abs().min(1 << 24) as u32;
    if size < CODED {
        (i64::from(size * size) * ERROR) >> 10
    } else {
        FIRST + 3 * i64::from(log2(size)) / 2
    }
}

/// Whether the coarsest low band costs less beside the render's.
fn is_low_useful(frame: &Frame, difference: &Planes) -> bool {
    let geometry: &Geometry = &frame.geometry;
    let low = geometry.band(geometry.levels, Orientation::Low);
    let (mut with, mut without) = (0, 0);
    visit(frame, difference, &low, |_, _, costs| {
        with += costs.detailed;
        without += costs.plain;
    });
    with <= without + LEAST
}

/// Finds which blocks are plain, so that few edges lie between both kinds.
fn settle(grid: Grid, costs: &[i64], plain: &mut [bool]) {
    for (plain, cost) in plain.iter_mut().zip(costs) {
        *plain = *cost < -PLAIN;
    }
    for _ in 0..ROUNDS {
        for at in 0..plain.len() {
            let beside = grid.beside(at).into_iter().flatten();
            let edges: i64 = beside.map(|other| if plain[other] { -EDGE } else { EDGE }).sum();
            plain[at] = costs[at] + PLAIN + edges < 0;
        }
    }
}

/// Predicts all from the render again. Returns whether that changes anything.
pub fn take_back(frame: &mut Frame, difference: &mut Planes) -> bool {
    let changes = !frame.is_all_predicted();
    if changes {
        leave_out(frame, difference, i32::wrapping_sub);
        frame.predict_all();
    }
    changes
}

/// Adds to the difference what of the render is not predicted, or takes it away.
fn leave_out(frame: &Frame, difference: &mut Planes, operation: fn(i32, i32) -> i32) {
    if frame.is_all_predicted() {
        return;
    }
    for (difference, render) in difference.iter_mut().zip(&frame.render.planes) {
        let values = difference.iter_mut().zip(render).zip(&frame.weights);
        for ((to, render), weight) in values.filter(|(_, weight)| **weight != FULL) {
            *to = operation(*to, left_out(*render, *weight));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fineness::LAMBDA;
    use super::super::step::Step;
    use super::*;
    use crate::Picture;

    #[test]
    fn costs_are_those_of_the_worth_of_a_bit() {
        let scale = Step::new(40).per_unit(1.0);
        let step = Step::new(40).value() * 64.0;
        let bits = |steps: f64| cost((steps * step) as i32, scale) as f64 / f64::from(ONE);
        for steps in [0.1, 0.5, 0.9] {
            let due = steps * steps / f64::from(LAMBDA);
            assert!((bits(steps) - due).abs() < 0.15, "{steps}: {} {due}", bits(steps));
        }
        // It never falls.
        let mut last = 0.0;
        for tenth in 0..200 {
            let bits = bits(f64::from(tenth) / 10.0);
            assert!(bits >= last - 0.05, "{tenth}: {bits} after {last}");
            last = bits;
        }
    }

    /// A textured render; in the frame a smooth object hides a part of it.
    fn pair() -> (Picture, Picture) {
        let mut render = Picture::new(128, 96);
        for (i, value) in render.data.iter_mut().enumerate() {
            let (x, y) = (i / 3 % 128, i / 3 / 128);
            *value = if (x / 3 + y / 4) % 2 == 0 { 70 } else { 160 };
        }
        let mut frame = render.clone();
        for (i, value) in frame.data.iter_mut().enumerate() {
            let (x, y) = (i / 3 % 128, i / 3 / 128);
            if (48..80).contains(&x) && (32..64).contains(&y) {
                *value = 120;
            }
        }
        (frame, render)
    }

    #[test]
    fn an_object_that_hides_texture_is_plain() {
        let (picture, render) = pair();
        let mut frame = Frame::new(128, 96);
        frame.step = Step::new(36);
        frame.set_render(&render);
        let mut shown = Frame::new(128, 96);
        shown.set_render(&picture);
        let planes = |frame: &Frame| frame.render.planes.clone();
        let (render, seen) = (planes(&frame), planes(&shown));
        let before: Planes = std::array::from_fn(|plane| {
            seen[plane].iter().zip(&render[plane]).map(|(a, b)| a - b).collect()
        });
        let mut difference = before.clone();
        let mut chooser = BlockChooser::new(&frame.small_blocks.grids);
        chooser.choose(&mut frame, &mut difference);
        assert!(frame.small_blocks.in_use);
        let finest = frame.geometry.band(1, Orientation::Horizontal);
        let weight = |x: usize, y: usize| {
            frame.weights[finest.offset + y / 2 * frame.geometry.width + x / 2]
        };
        assert!(weight(56, 44) <= 1 && weight(70, 52) <= 1);
        assert_eq!((weight(8, 8), weight(110, 80), weight(20, 50)), (FULL, FULL, FULL));
        // Another step first takes back what was chosen; so does who wants none.
        let chosen = difference.clone();
        chooser.choose(&mut frame, &mut difference);
        assert!(difference == chosen);
        assert!(take_back(&mut frame, &mut difference));
        assert!(difference == before && !take_back(&mut frame, &mut difference));
        // If nothing is new, all is predicted.
        let mut none: Planes = std::array::from_fn(|_| vec![0; frame.geometry.len()]);
        chooser.choose(&mut frame, &mut none);
        assert!(frame.is_all_predicted() && none.iter().flatten().all(|value| *value == 0));
    }
}
