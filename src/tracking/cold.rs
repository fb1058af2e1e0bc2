//! Starts of a frame if only a rough pose is known.

use crate::image::Mask;
use crate::render::Correction;
use crate::shared::PIXEL;
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::{Hypotheses, Objective, Pyramid};

/// Level of the pyramid at which whole frame and whole render are compared.
const LEVEL: usize = 2;

/// Proposes starts near a rough one, from one render there.
pub(super) struct ColdStart {
    pyramid: Pyramid,
    hypotheses: Hypotheses,
    level: usize,
    /// Which pixels of the level count; `None`: all do.
    mask: Option<Mask>,
    starts: Vec<Pose>,
    /// See [`ColdStart::error`].
    error: f64,
}

impl ColdStart {
    pub fn new(objective: &Objective) -> ColdStart {
        let level = LEVEL.min(objective.levels() - 1);
        ColdStart {
            pyramid: Pyramid::new(&objective.camera(0), &[objective.factor(level)]),
            hypotheses: Hypotheses::new(&objective.camera(level)),
            level,
            mask: None,
            starts: Vec::with_capacity(Hypotheses::MAX + 1),
            error: f64::NAN,
        }
    }

    /// Sets which pixels of frames count from here on. The frames themselves must be level where none does.
    pub fn set_mask(&mut self, objective: &Objective, mask: Option<&Mask>) {
        self.mask = mask.map(|mask| mask.reduced(objective.factor(self.level)));
    }

    /// The best hypotheses, at most `max`. The start itself is ranked among them.
    pub fn starts(
        &mut self,
        objective: &mut Objective,
        frame: &Picture,
        start: &Pose,
        max: usize,
    ) -> Result<&[Pose], Error> {
        self.pyramid.set(frame);
        let correction = *objective.correction();
        let render = objective.renderer().draw_level(self.level, start)?;
        let render = &render[..render.len() / PIXEL as usize * PIXEL as usize];
        self.error = mse(render, self.pyramid.level(0), &correction, self.mask.as_ref());
        let proposals = self.hypotheses.propose(self.pyramid.level(0), render, start);
        self.starts.clear();
        self.starts.extend(proposals.iter().take(max).map(|proposal| proposal.pose));
        Ok(&self.starts)
    }

    /// Mean squared error of the rough start itself, at the level of the last proposals.
    pub fn error(&self) -> f64 {
        self.error
    }
}

/// Mean squared error of a render, five floats per pixel, against a frame, three floats per pixel, whose light is
/// corrected. Only pixels that count.
fn mse(render: &[f32], frame: &[f32], correction: &Correction, mask: Option<&Mask>) -> f64 {
    let pixels = render.chunks_exact(PIXEL as usize).zip(frame.chunks_exact(3));
    let square = |(r, f): (&[f32], &[f32])| -> f64 {
        (0..3).map(|c| f64::from(r[c] - correction.of(c, f[c])).powi(2)).sum()
    };
    let Some(mask) = mask else { return pixels.map(square).sum::<f64>() / frame.len() as f64 };
    let counted = pixels.zip(&mask.data).filter(|(_, counts)| **counts);
    counted.map(|(pixel, _)| square(pixel)).sum::<f64>() / (3 * mask.count().max(1)) as f64
}
