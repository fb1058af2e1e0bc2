//! The best known pose of each frame: the best of several careful searches.

use anyhow::Context as _;
use nvsprior::render::Jacobian;
use nvsprior::tracking::Schedule;
use nvsprior::{Encoder, EncoderOptions, Pose};

use super::context::{Best, Context, Shot};
use nvsprior_inputs::args::progress;

/// Goes on as long as there is anything to be gained.
const CAREFUL: Schedule = Schedule {
    first_level: 2,
    follow_level: 2,
    levels: 0b0111,
    sparse: 0,
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

/// The options for a search at full resolution alone.
const LAST: Schedule = Schedule { first_level: 0, follow_level: 0, levels: 0b0001, ..CAREFUL };

/// How far from the camera file's pose the best known one may lie: the scene's motion in the picture, radians.
const FARTHEST: f64 = 0.1;

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

    fn from(&mut self, shot: &Shot, start: &Pose) -> anyhow::Result<(Best, f64)> {
        self.encoder.reset();
        self.encoder.set_camera(&shot.camera)?;
        let encoded = self.encoder.encode(&shot.picture, Some(*start));
        let encoded = encoded.with_context(|| format!("looking for the best of {}", shot.file))?;
        let best = Best { pose: encoded.pose, psnr: encoded.stats.render_psnr };
        Ok((best, encoded.stats.observability.length))
    }
}

/// All ways to search, one after another.
struct Searches {
    first: Search,
    last: [Search; 2],
}

impl Searches {
    fn new(context: &Context) -> anyhow::Result<Searches> {
        let new = |jacobian, schedule| Search::new(context, jacobian, schedule);
        let first = new(Jacobian::Flow, CAREFUL)?;
        Ok(Searches { first, last: [new(Jacobian::Flow, LAST)?, new(Jacobian::Exact, LAST)?] })
    }

    /// The best pose of a frame: searches from each start, then, with both Jacobians, from the best
    /// pose found. Also returns the depth of the scene there.
    fn best(&mut self, shot: &Shot, starts: &[Pose]) -> anyhow::Result<(Best, f64)> {
        let mut best: Option<(Best, f64)> = None;
        for start in starts {
            best = Some(better(best, self.first.from(shot, start)?));
        }
        let none = || format!("{}: no pose to look for the best one from", shot.file);
        let found = best.with_context(none)?;
        let mut best = found;
        for search in &mut self.last {
            best = better(Some(best), search.from(shot, &found.0.pose)?);
        }
        Ok(best)
    }
}

/// Looks for the best pose of every frame: from the camera file's pose, if there is one, and from the best pose of the
/// frame before. In another light than the prior's a wrong pose may look more like the frame. So if the pose found is
/// too far from the camera file's, the camera file's is taken.
pub fn find(context: &mut Context) -> anyhow::Result<()> {
    let bar = progress(context.shots.len(), "best poses");
    let mut searches = Searches::new(context)?;
    for shot in &context.shots {
        let before = context.best.last().map(|best| best.pose);
        let starts: Vec<Pose> =
            [shot.known.or(shot.external), before].into_iter().flatten().collect();
        let (mut best, depth) = searches.best(shot, &starts)?;
        if let Some(known) = shot.known
            && beyond(&known, &best.pose, depth)
        {
            let render = context.forward.picture(&shot.camera, &known)?;
            best = Best { pose: known, psnr: shot.picture.psnr(render) };
        }
        context.best.push(best);
        bar.inc(1);
    }
    Ok(())
}

/// The one of higher PSNR.
fn better(best: Option<(Best, f64)>, found: (Best, f64)) -> (Best, f64) {
    best.filter(|(best, _)| best.psnr >= found.0.psnr).unwrap_or(found)
}

/// Whether things at a depth move in the picture by more than [`FARTHEST`] from one pose to another. The depth is 0 if
/// the picture does not show translations.
pub fn beyond(known: &Pose, found: &Pose, depth: f64) -> bool {
    let distance = (known.centre() - found.centre()).length();
    let shift = if depth > 0.0 { distance / depth } else { 0.0 };
    !(known.angle_to(found) + shift <= FARTHEST)
}
