//! The best known pose of each frame: the best of several careful searches.

use anyhow::Context as _;
use nvsprior::refine::Schedule;
use nvsprior::render::Jacobian;
use nvsprior::{Encoder, EncoderOptions, Pose};

use super::context::{Best, Context, Shot};

/// Goes on as long as there is anything to be gained.
const CAREFUL: Schedule = Schedule {
    first_level: 2,
    follow_level: 2,
    levels: 0b0111,
    follow_renders: 16,
    coarse_renders: 32,
    renders: 48,
    near: 1.0,
    far_level: 0,
    coarse_leap: 0.0,
    leap: 0.0,
    coarse_tolerance: 1e-6,
    tolerance: 1e-6,
};

/// The same at full resolution alone.
const LAST: Schedule = Schedule { first_level: 0, follow_level: 0, levels: 0b0001, ..CAREFUL };

/// A way to search.
struct Search {
    encoder: Encoder,
}

impl Search {
    fn new(context: &Context, jacobian: Jacobian, schedule: Schedule) -> anyhow::Result<Search> {
        let mut options = EncoderOptions { rate: None, ..context.options() };
        options.refine.jacobian = jacobian;
        options.refine.gauss_newton.warm = schedule;
        options.refine.gauss_newton.cold = schedule;
        Ok(Search { encoder: context.encoder(options)? })
    }

    fn from(&mut self, context: &Context, shot: usize, start: &Pose) -> anyhow::Result<Best> {
        let shot = &context.shots[shot];
        self.encoder.reset();
        self.encoder.set_camera(&shot.camera)?;
        let encoded = self.encoder.encode(&shot.picture, Some(*start));
        let encoded = encoded.with_context(|| format!("looking for the best of {}", shot.file))?;
        Ok(Best { pose: encoded.pose, psnr: encoded.stats.render_psnr })
    }
}

/// Looks for the best pose of every frame: from the camera file's pose, where there is one, and
/// from the best of the frame before; then, with both Jacobians, from what was found.
pub fn find(context: &mut Context, done: impl Fn()) -> anyhow::Result<()> {
    let mut first = Search::new(context, Jacobian::Flow, CAREFUL)?;
    let mut last = [Jacobian::Flow, Jacobian::Exact]
        .map(|jacobian| Search::new(context, jacobian, LAST))
        .into_iter()
        .collect::<anyhow::Result<Vec<Search>>>()?;
    for shot in 0..context.shots.len() {
        let before = context.best.last().map(|best| best.pose);
        let Shot { file, known, external, .. } = &context.shots[shot];
        let mut best: Option<Best> = None;
        for start in [known.or(*external), before].into_iter().flatten() {
            best = better(best, first.from(context, shot, &start)?);
        }
        let found =
            best.with_context(|| format!("{file}: no pose to look for the best one from"))?;
        for search in &mut last {
            best = better(best, search.from(context, shot, &found.pose)?);
        }
        context.best.extend(best);
        done();
    }
    Ok(())
}

fn better(best: Option<Best>, found: Best) -> Option<Best> {
    Some(best.filter(|best| best.psnr >= found.psnr).unwrap_or(found))
}
