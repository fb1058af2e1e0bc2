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
        options.refine.masks = false;
        options.refine.lost_renders = 0;
        options.refine.gauss_newton.warm = schedule;
        options.refine.gauss_newton.cold = schedule;
        Ok(Search { encoder: context.encoder(options)? })
    }

    fn from(&mut self, shot: &Shot, start: &Pose) -> anyhow::Result<Best> {
        self.encoder.reset();
        self.encoder.set_camera(&shot.camera)?;
        let encoded = self.encoder.encode(&shot.picture, Some(*start));
        let encoded = encoded.with_context(|| format!("looking for the best of {}", shot.file))?;
        Ok(Best { pose: encoded.pose, psnr: encoded.stats.render_psnr })
    }
}

/// All ways to search, one after another.
pub struct Searches {
    first: Search,
    last: [Search; 2],
}

impl Searches {
    pub fn new(context: &Context) -> anyhow::Result<Searches> {
        let new = |jacobian, schedule| Search::new(context, jacobian, schedule);
        let first = new(Jacobian::Flow, CAREFUL)?;
        Ok(Searches { first, last: [new(Jacobian::Flow, LAST)?, new(Jacobian::Exact, LAST)?] })
    }

    /// The best pose of a frame: from each of some starts, then, with both Jacobians, from what was
    /// found.
    pub fn best(&mut self, shot: &Shot, starts: &[Pose]) -> anyhow::Result<Best> {
        let mut best: Option<Best> = None;
        for start in starts {
            best = Some(better(best, self.first.from(shot, start)?));
        }
        let none = || format!("{}: no pose to look for the best one from", shot.file);
        let found = best.with_context(none)?;
        let mut best = found;
        for search in &mut self.last {
            best = better(Some(best), search.from(shot, &found.pose)?);
        }
        Ok(best)
    }
}

/// Looks for the best pose of every frame: from the camera file's pose, if there is one, and from the
/// best of the frame before.
pub fn find(context: &mut Context, done: impl Fn()) -> anyhow::Result<()> {
    let mut searches = Searches::new(context)?;
    for shot in &context.shots {
        let before = context.best.last().map(|best| best.pose);
        let starts: Vec<Pose> =
            [shot.known.or(shot.external), before].into_iter().flatten().collect();
        context.best.push(searches.best(shot, &starts)?);
        done();
    }
    Ok(())
}

/// The one of higher PSNR.
fn better(best: Option<Best>, found: Best) -> Best {
    best.filter(|best| best.psnr >= found.psnr).unwrap_or(found)
}
