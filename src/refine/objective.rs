//! The objective: a frame against the prior's renders, with its derivatives.

use std::time::Instant;

use crate::render::{Jacobian, NormalEquations, Renderer};
use crate::shared::PIXEL;
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::Pyramid;
use super::phase_correlation::PhaseCorrelation;

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
    correlation: PhaseCorrelation,
    trace: Vec<Evaluation>,
    since: Instant,
}

/// Level at which phase correlation compares.
const CORRELATION_LEVEL: usize = 2;

/// Evaluations that a trace has room for; the rest of a longer search is not traced.
const TRACE: usize = 4096;

impl Objective {
    /// Wraps a renderer whose plan has the factors of `pyramid`.
    pub fn new(renderer: Renderer, pyramid: Pyramid) -> Objective {
        let level = CORRELATION_LEVEL.min(renderer.levels() - 1);
        let camera = renderer.camera(level);
        let correlation = PhaseCorrelation::new(camera.width as usize, camera.height as usize);
        let (trace, since) = (Vec::with_capacity(TRACE), Instant::now());
        Objective { renderer, pyramid, correlation, trace, since }
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

    /// The pose turned so that the render lies over the frame as a whole, by phase correlation of
    /// their luma; the same pose where they already do to a pixel. Roll is what it does not see.
    pub fn turned(&mut self, pose: &Pose) -> Result<Pose, Error> {
        let level = CORRELATION_LEVEL.min(self.levels() - 1);
        let camera = *self.renderer.camera(level);
        let render = self.renderer.draw_level(level, pose)?.chunks_exact(PIXEL as usize);
        let frame = self.pyramid.level(level).chunks_exact(3);
        let [dx, dy] = self.correlation.shift(frame.map(luma), render.map(luma));
        if dx == 0.0 && dy == 0.0 {
            return Ok(*pose);
        }
        Ok(pose.stepped(&[
            0.0,
            0.0,
            0.0,
            f64::from(-dy / camera.fy),
            f64::from(dx / camera.fx),
            0.0,
        ]))
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

/// Luma of a pixel that begins with R, G, B (ITU-R BT.601).
fn luma(pixel: &[f32]) -> f32 {
    0.299 * pixel[0] + 0.587 * pixel[1] + 0.114 * pixel[2]
}
