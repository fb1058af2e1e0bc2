//! The objective: a frame against the prior's renders, with its derivatives.

use std::time::Instant;

use crate::render::{Jacobian, NormalEquations, Renderer};
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::Pyramid;

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

/// A frame against a renderer of the prior.
pub struct Objective {
    renderer: Renderer,
    pyramid: Pyramid,
    trace: Vec<Evaluation>,
    since: Instant,
}

/// Evaluations that a trace has room for; the rest of a longer search is not traced.
const TRACE: usize = 4096;

impl Objective {
    /// Wraps a renderer whose plan has the factors of `pyramid`.
    pub fn new(renderer: Renderer, pyramid: Pyramid) -> Objective {
        Objective { renderer, pyramid, trace: Vec::with_capacity(TRACE), since: Instant::now() }
    }

    /// Sets the frame to match and begins a new trace.
    pub fn set_frame(&mut self, frame: &Picture) {
        self.trace.clear();
        self.since = Instant::now();
        self.pyramid.set(frame);
        for level in 0..self.renderer.levels() {
            self.renderer.set_frame(level, self.pyramid.level(level));
        }
    }

    /// The normal equations at a pose. Where the pose is not finite, or the device returns something
    /// that is not a number, the error is infinite: no optimiser steps there.
    pub fn evaluate(
        &mut self,
        level: usize,
        jacobian: Jacobian,
        pose: &Pose,
    ) -> Result<NormalEquations, Error> {
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
        if self.trace.len() < TRACE {
            let milliseconds = self.since.elapsed().as_secs_f64() * 1e3;
            self.trace.push(Evaluation { level, mse: equations.mse(), milliseconds });
        }
        Ok(equations)
    }

    /// Evaluations since the frame was set, in order.
    pub fn trace(&self) -> &[Evaluation] {
        &self.trace
    }

    /// The renderer, to draw with.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.renderer.levels()
    }
}
