//! A second, shorter training without some stretches of the mapping run: what a prior of it is worth for finding poses.
//!
//! Single pictures that are held out lie between two others that look alike, and hide what a dive meets. So whole
//! stretches and the run's ends are held out; the prior that is delivered is trained with them. Those pictures lie on
//! the run's own track. A run along the line of sight leaves depths open, and that shows beside its track only. So the
//! delivered prior is drawn from there, too, and looked for in the other one: what two trainings do not agree in, the
//! run does not determine.

use std::time::{Duration, Instant};

use glam::DVec3;
use nvsprior::prior::{Extras, Splats};
use nvsprior::{Camera, Engine, Pose, Prior};
use nvsprior_inputs::args::progress;
use nvsprior_train::PosedPicture;
use nvsprior_train::key_frames::{ANGLE, Sample, Thinned};
use nvsprior_train::mapper::{ColouredPoint, MapOptions, Mapper};
use nvsprior_train::parallax::orbited;
use nvsprior_train::pose_trials::try_poses;

use crate::picture_renderer::PictureRenderer;

use super::budget::Budget;
use super::course::Course;
use super::report::Report;
use super::worth::Worth;

/// Fewer pictures give no stretches to hold out.
const LEAST: usize = 12;
/// Pictures of which one is held out at each end, and in each of two stretches.
const END: usize = 24;
const STRETCH: usize = 16;
/// Most pictures that are looked for, of those that were held out and of those from beside the run.
const TRIED: usize = 16;
/// How far beside the run they are drawn from: axes of the camera, and turns
/// about them around what the picture shows, degrees.
const BESIDE: [(DVec3, f64); 4] =
    [(DVec3::Y, 10.0), (DVec3::X, 8.0), (DVec3::Y, -10.0), (DVec3::X, -8.0)];

pub struct Rehearsal<'a> {
    pub engine: &'a Engine,
    pub options: &'a MapOptions,
    /// `None`: none is wanted.
    pub budget: Option<Budget>,
}

impl Rehearsal<'_> {
    /// Trains and tries. `mapper`: the training that is delivered, as `delivered`; `points`: those that it began with.
    /// `None`: none is wanted, or the run is too short.
    pub fn run(
        &self,
        delivered: &Prior,
        mapper: &Mapper,
        points: &[ColouredPoint],
    ) -> anyhow::Result<Option<Worth>> {
        let pictures = mapper.pictures();
        let Some(budget) = self.budget.filter(|_| pictures >= LEAST) else {
            tell!("how far off poses will be on a dive is not measured");
            return Ok(None);
        };
        let since = Instant::now();
        tell!("rehearsal: without stretches of the run, to learn how far off poses will be");
        let posed = mapper.views()[..pictures].iter().zip(mapper.poses());
        let posed = posed.map(|(view, pose)| PosedPicture { pose: *pose, ..view.clone() });
        let (held_out, seen): (Vec<_>, Vec<_>) =
            posed.enumerate().partition(|(index, _)| is_held_out(*index, pictures));
        let seen: Vec<PosedPicture> = seen.into_iter().map(|(_, view)| view).collect();
        let views: Vec<_> = seen.iter().map(|view| (view.camera, view.pose)).collect();
        let splats = self.train(seen, points, budget)?;
        let sample = Sample::of(&splats, self.options.render.near);
        let Some(thinned) = Thinned::of(&sample, &views, None, ANGLE)? else { return Ok(None) };
        let extras = Extras { key_frames: thinned.key_frames, ..Extras::default() };
        let prior = Prior::from_splats(splats, self.options.render)?.with_extras(extras)?;
        let every = held_out.len().div_ceil(TRIED);
        let held_out: Vec<_> = held_out.into_iter().step_by(every).map(|(_, view)| view).collect();
        let beside = self.beside(delivered, &views, thinned.range)?;
        let bar = progress(held_out.len() + beside.len(), "poses");
        let try_all = |pictures: &[PosedPicture]| {
            let told = &mut || bar.inc(1);
            try_poses(self.engine, &prior, pictures, thinned.range, told)
        };
        let (tried, beside) = (try_all(&held_out)?, try_all(&beside)?);
        bar.finish_and_clear();
        let seconds = since.elapsed().as_secs_f64();
        let worth = Worth { tried, beside, depth: thinned.range, seconds };
        worth.print();
        Ok(Some(worth))
    }

    fn train(
        &self,
        pictures: Vec<PosedPicture>,
        points: &[ColouredPoint],
        budget: Budget,
    ) -> anyhow::Result<Splats> {
        // Another training in all that is random, too.
        let options =
            MapOptions { seed: self.options.seed.wrapping_add(1), ..self.options.clone() };
        let mut mapper = Mapper::new(self.engine, pictures, points, &options)?;
        let save = |_: &Mapper| Ok(());
        let course = Course { budget, save: &save, save_every: Duration::MAX };
        course.run(&mut mapper, &mut Report::default())?;
        Ok(mapper.splats()?)
    }

    /// Pictures of the delivered prior from beside the run.
    fn beside(
        &self,
        delivered: &Prior,
        views: &[(Camera, Pose)],
        depth: f64,
    ) -> anyhow::Result<Vec<PosedPicture>> {
        let mut renderer = PictureRenderer::new(self.engine, delivered)?;
        let every = views.len().div_ceil(TRIED);
        let seen = DVec3::new(0.0, 0.0, depth);
        let draw = |((camera, pose), (axis, degrees)): (&(Camera, Pose), &(DVec3, f64))| {
            let pose = orbited(pose, seen, *axis, degrees.to_radians());
            let picture = renderer.render(camera, &pose)?.clone();
            Ok(PosedPicture::new(*camera, pose, picture))
        };
        views.iter().step_by(every).zip(BESIDE.iter().cycle()).map(draw).collect()
    }
}

/// Whether a picture of so many is held out of a rehearsal: at the run's ends, and in two stretches.
fn is_held_out(index: usize, pictures: usize) -> bool {
    let (end, stretch) = ((pictures / END).max(1), (pictures / STRETCH).max(2));
    let in_stretch = |from: usize| (from..from + stretch).contains(&index);
    index < end
        || index >= pictures - end
        || in_stretch(pictures / 3 - stretch / 2)
        || in_stretch(2 * pictures / 3 - stretch / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orbiting_camera_looks_at_the_same_point_from_the_same_distance() {
        let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, -2.0, 3.0]).unwrap();
        let looked_at = pose.inverse().rotation * DVec3::new(0.0, 0.0, 2.5) + pose.centre();
        for (axis, degrees) in BESIDE {
            let other = orbited(&pose, DVec3::new(0.0, 0.0, 2.5), axis, degrees.to_radians());
            let seen = other.rotation * looked_at + other.translation;
            assert!((seen - DVec3::new(0.0, 0.0, 2.5)).length() < 1e-9);
            let wanted = 2.0 * 2.5 * degrees.to_radians().abs().sin() / 2.0;
            let moved = (other.centre() - pose.centre()).length();
            assert!((moved / wanted - 1.0).abs() < 0.01, "{moved} {wanted}");
        }
    }

    #[test]
    fn ends_and_two_stretches_are_held_out() {
        let held = |pictures: usize| -> Vec<usize> {
            (0..pictures).filter(|index| is_held_out(*index, pictures)).collect()
        };
        assert_eq!(held(12), [0, 3, 4, 7, 8, 11]);
        assert_eq!(held(15), [0, 4, 5, 9, 10, 14]);
        assert_eq!(
            held(96),
            [0, 1, 2, 3, 29, 30, 31, 32, 33, 34, 61, 62, 63, 64, 65, 66, 92, 93, 94, 95]
        );
        assert!((LEAST..500).all(|n| (n / 10..=n / 2).contains(&held(n).len())));
    }
}
