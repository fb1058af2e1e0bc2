//! Starts of a frame of which only a rough pose is known.

use crate::shared::PIXEL;
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::phase_correlation::PhaseCorrelation;
use super::{Objective, Pyramid};

/// Level of the pyramid at which frame and render are compared as wholes.
const LEVEL: usize = 2;

/// Proposes starts near a rough one.
pub(super) struct ColdStart {
    pyramid: Pyramid,
    correlation: PhaseCorrelation,
    level: usize,
    starts: Vec<Pose>,
}

impl ColdStart {
    pub fn new(objective: &Objective) -> ColdStart {
        let level = LEVEL.min(objective.levels() - 1);
        let camera = objective.camera(level);
        ColdStart {
            pyramid: Pyramid::new(&objective.camera(0), &[objective.factor(level)]),
            correlation: PhaseCorrelation::new(camera.width as usize, camera.height as usize),
            level,
            starts: Vec::with_capacity(8),
        }
    }

    /// The start itself, and the start turned so that the render lies over the frame as a whole.
    pub fn starts(
        &mut self,
        objective: &mut Objective,
        frame: &Picture,
        start: &Pose,
    ) -> Result<Vec<Pose>, Error> {
        self.starts.clear();
        self.starts.push(*start);
        self.pyramid.set(frame);
        let camera = objective.camera(self.level);
        let mut turned = *start;
        for _ in 0..2 {
            let render = objective.renderer().draw_level(self.level, &turned)?;
            let render = render.chunks_exact(PIXEL as usize);
            let frame = self.pyramid.level(0).chunks_exact(3);
            let [dx, dy] = self.correlation.shift(frame.map(luma), render.map(luma));
            if dx == 0.0 && dy == 0.0 {
                break;
            }
            let (x, y) = (f64::from(-dy / camera.fy), f64::from(dx / camera.fx));
            turned = turned.stepped(&[0.0, 0.0, 0.0, x, y, 0.0]);
            self.starts.push(turned);
        }
        Ok(self.starts.clone())
    }
}

/// Luma of a pixel that begins with R, G, B (ITU-R BT.601).
fn luma(pixel: &[f32]) -> f32 {
    0.299 * pixel[0] + 0.587 * pixel[1] + 0.114 * pixel[2]
}
