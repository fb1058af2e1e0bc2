//! The objective: a frame against the prior's renders, with its derivatives.

use std::sync::Arc;
use std::time::Instant;

use crate::image::Mask;
use crate::render::{Correction, FlatField, Jacobian, NormalEquations, Renderer};
use crate::search::LEVELS;
#[cfg(doc)]
use crate::search::Program;
use crate::vulkan::Error;
use crate::{Camera, Picture, Pose};

use super::Observability;

/// One evaluation, for reports of error against run time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// Level of the pyramid; 0 is the full picture.
    pub level: usize,
    /// Mean squared error there.
    pub mse: f64,
    /// Since the frame was set, milliseconds.
    pub milliseconds: f64,
}

/// Evaluations of a frame, in order.
pub(super) struct Trace(Vec<Evaluation>);

/// Evaluations that a trace has room for. Later ones are not traced.
const TRACE: usize = 4096;

impl Trace {
    pub fn note(&mut self, evaluation: Evaluation) {
        if self.0.len() < TRACE {
            self.0.push(evaluation);
        }
    }
}

/// A frame against a renderer of the prior.
pub struct Objective {
    renderer: Renderer,
    trace: Trace,
    since: Instant,
    /// Whether the device holds the frame at all levels. A search on the device makes them itself.
    reduced: bool,
    /// Observability of the last evaluation at full resolution that the host asked for.
    observability: Observability,
    picture: Picture,
    correction: Correction,
    field: FlatField,
    mask: Option<Arc<Mask>>,
}

impl Objective {
    /// Wraps a renderer whose plan knows frames.
    pub fn new(renderer: Renderer) -> Objective {
        let trace = Trace(Vec::with_capacity(TRACE));
        let observability = Observability::default();
        let camera = renderer.camera(0);
        Objective {
            picture: Picture::new(camera.width, camera.height),
            field: FlatField::new(camera.width as usize, camera.height as usize),
            renderer,
            trace,
            since: Instant::now(),
            reduced: false,
            observability,
            correction: Correction::NONE,
            mask: None,
        }
    }

    /// Sets the frame to match and begins a new trace.
    ///
    /// # Panics
    /// If it has not the size of level 0.
    pub fn set_frame(&mut self, frame: &Picture) {
        self.trace.0.clear();
        self.since = Instant::now();
        self.renderer.set_picture(frame);
        self.picture.clone_from(frame);
        (self.reduced, self.observability) = (false, Observability::default());
    }

    /// Sets a frame that shows nothing.
    pub(super) fn set_flat_frame(&mut self) {
        let camera = self.camera(0);
        let mut flat = Picture::new(camera.width, camera.height);
        flat.data.fill(128);
        self.set_frame(&flat);
    }

    /// Sets which pixels of frames count from here on; `None`: all do.
    ///
    /// # Panics
    /// If it has not the size of level 0.
    pub fn set_mask(&mut self, mask: Option<Arc<Mask>>) {
        self.renderer.set_mask(mask.as_deref());
        self.mask = mask;
        self.reduced = false;
    }

    /// The bytes of the frame, and of the 8-bit picture drawn last.
    pub(super) fn pictures(&self) -> (&[u8], &[u8]) {
        (&self.picture.data, self.renderer.rendered())
    }

    /// Corrects the light of this frame and of those to come. A flat field is switched off.
    pub fn set_correction(&mut self, correction: &Correction) {
        if *correction != self.correction || self.field.is_on() {
            self.correction = *correction;
            self.field.switch_off();
            self.light_changed();
        }
    }

    /// Changes the flat field of this frame and of those to come.
    pub fn set_field(&mut self, change: impl FnOnce(&mut FlatField)) {
        change(&mut self.field);
        self.light_changed();
    }

    fn light_changed(&mut self) {
        self.renderer.set_light(&self.correction, &self.field);
        self.reduced = false;
    }

    /// How the frame's light is corrected everywhere.
    pub fn correction(&self) -> &Correction {
        &self.correction
    }

    /// How it is corrected from place to place, and what counts.
    pub fn field(&self) -> &FlatField {
        &self.field
    }

    /// Mean squared error of the 8-bit picture drawn last, values in [0, 1]: of all pixels, and of those that a sparse
    /// evaluation draws. The frame's light is corrected, and masked pixels add nothing.
    pub(super) fn errors(&self) -> [f64; 2] {
        let rows = self.picture.height;
        let mut sums = [0.0; 2];
        for (y, sum) in (0..rows).map(|y| (y, self.square_of_row(y))) {
            sums[0] += sum;
            sums[1] += if self.renderer.draws_sparsely(0, y) { sum } else { 0.0 };
        }
        let counted = self.renderer.counted(0).map(|count| (count.max(1) * 3) as f64);
        [sums[0] / counted[0], sums[1] / counted[1]]
    }

    /// Mean squared error of all pixels: see [`errors`](Self::errors).
    pub(super) fn error(&self) -> f64 {
        self.errors()[0]
    }

    /// Sum of squares of a row of pixels.
    fn square_of_row(&self, y: u32) -> f64 {
        let mask = self.mask.as_deref();
        let width = self.picture.width as usize;
        let bytes = y as usize * width * 3..(y as usize + 1) * width * 3;
        if self.correction == Correction::NONE && !self.field.is_on() && mask.is_none() {
            return square(&self.renderer.difference()[bytes]);
        }
        let frame = self.picture.data[bytes.clone()].chunks_exact(3);
        let pixels = frame.zip(self.renderer.rendered()[bytes].chunks_exact(3));
        let square = |(x, (frame, render)): (usize, (&[u8], &[u8]))| -> f64 {
            if mask.is_some_and(|mask| !mask.data[y as usize * width + x]) {
                return 0.0;
            }
            let lit = |c: usize| self.correction.of(c, f32::from(frame[c]) / 255.0);
            let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
            let Some(rgb) = self.field.of([lit(0), lit(1), lit(2)], x, y) else { return 0.0 };
            let off = |c: usize| f64::from(rgb[c] - f32::from(render[c]) / 255.0);
            (0..3).map(|c| off(c).powi(2)).sum()
        };
        pixels.enumerate().map(square).sum()
    }

    /// The normal equations at a pose. If the pose is not finite, or the device returns a value
    /// that is no number, the error is infinite, so that no optimiser steps there.
    pub fn evaluate(
        &mut self,
        level: usize,
        jacobian: Jacobian,
        pose: &Pose,
    ) -> Result<NormalEquations, Error> {
        if !self.reduced {
            self.renderer.reduce_picture()?;
            self.reduced = true;
        }
        let mut equations = self.renderer.normal_equations(level, jacobian, pose)?;
        let finite = equations.jtj.iter().flatten().chain(&equations.jtr).all(|v| v.is_finite());
        if !(pose.is_finite() && finite && equations.square.is_finite()) {
            equations = NormalEquations {
                jtj: [[0.0; 6]; 6],
                jtr: [0.0; 6],
                square: f64::INFINITY,
                ..equations
            };
        }
        if level == 0 {
            self.observability = Observability::of(&equations);
        }
        let (mse, milliseconds) = (equations.mse(), self.milliseconds());
        self.trace.note(Evaluation { level, mse, milliseconds });
        Ok(equations)
    }

    /// Since the frame was set.
    pub(super) fn milliseconds(&self) -> f64 {
        self.since.elapsed().as_secs_f64() * 1e3
    }

    /// Those of some levels whose sparse evaluations draw enough of the pixels that count.
    pub(super) fn sparse_levels(&self, levels: u32) -> u32 {
        let enough = |level: &usize| {
            let [all, drawn] = self.renderer.counted(*level);
            8 * drawn >= all
        };
        let enough = (0..self.levels()).filter(enough);
        levels & enough.map(|level| 1 << level).sum::<u32>()
    }

    /// Number of residuals of an evaluation of each level. `sparse`: see [`Program::sparse`].
    pub(super) fn residuals(&self, sparse: u32) -> [f64; LEVELS] {
        let of = |level: usize| (sparse >> level & 1) as usize;
        let count = |level| (self.renderer.counted(level)[of(level)].max(1) * 3) as f64;
        std::array::from_fn(|level| if level < self.levels() { count(level) } else { 1.0 })
    }

    /// The observability of the last evaluation at full resolution that the host asked for.
    pub fn observability(&self) -> &Observability {
        &self.observability
    }

    /// The renderer, and the trace.
    pub(super) fn parts(&mut self) -> (&mut Renderer, &mut Trace) {
        (&mut self.renderer, &mut self.trace)
    }

    /// Evaluations since the frame was set, in order.
    pub fn trace(&self) -> &[Evaluation] {
        &self.trace.0
    }

    /// The renderer, to draw with.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// The camera of a level.
    pub fn camera(&self, level: usize) -> Camera {
        *self.renderer.camera(level)
    }

    /// Reduction factor of a level.
    pub fn factor(&self, level: usize) -> u32 {
        self.renderer.factor(level)
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.renderer.levels()
    }
}

/// Sum of squares, values in [0, 1], of a part of a difference picture.
fn square(difference: &[u8]) -> f64 {
    let square = |v: &u8| u64::from(v.abs_diff(128)).pow(2);
    difference.iter().map(square).sum::<u64>() as f64 / (255.0 * 255.0)
}
