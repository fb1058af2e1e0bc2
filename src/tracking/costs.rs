//! What the steps of a search take on a device.

use std::time::Duration;

use crate::search::COMPACT;
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::gauss_newton;
use super::schedule::Schedule;
use super::schedule_limit::Room;
use super::{Clock, GaussNewtonOptions, Objective, Relocaliser};

/// What the steps of a search take on a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Costs {
    /// The picture at a pose, at full resolution.
    pub picture: Duration,
    /// An evaluation of the normal equations there.
    pub evaluation: Duration,
    /// The same at half the size.
    pub coarse: Duration,
    /// One render with its corners taken.
    pub look: Duration,
}

/// How often each step is timed; the first time, in which the driver compiles, does not count.
const ROUNDS: usize = 3;

impl Costs {
    /// Measures at some poses; of each the shortest time, and of these the longest. No later frame is then the first
    /// for which the driver compiles.
    pub fn measure(
        objective: &mut Objective,
        clock: &Clock,
        poses: &[Pose],
    ) -> Result<Costs, Error> {
        let mut relocaliser = Relocaliser::new(objective, &[]);
        let camera = objective.camera(0);
        let mut flat = Picture::new(camera.width, camera.height);
        flat.data.fill(128);
        objective.set_frame(&flat);
        let mut most = Costs::default();
        for pose in poses {
            let mut least: Option<Costs> = None;
            for round in 0..ROUNDS {
                let once = Costs::once(objective, &mut relocaliser, clock, pose)?;
                if round > 0 {
                    least = Some(least.map_or(once, |least| least.each(&once, Duration::min)));
                }
            }
            most = most.each(&least.unwrap_or_default(), Duration::max);
        }
        Ok(most)
    }

    /// Measures once at a pose.
    fn once(
        objective: &mut Objective,
        relocaliser: &mut Relocaliser,
        clock: &Clock,
        pose: &Pose,
    ) -> Result<Costs, Error> {
        let GaussNewtonOptions { cold, damping, .. } = GaussNewtonOptions::default();
        let search = |objective: &mut Objective, schedule: &Schedule| {
            gauss_newton::search(objective, &[*pose], schedule, damping, COMPACT, &Room::ALL)
        };
        let once = Schedule { first_level: 0, follow_level: 0, renders: 1, leap: 0.0, ..cold };
        let half = Schedule { first_level: 1, follow_level: 1, coarse_renders: 1, ..once };
        let camera = objective.camera(0);
        let mut shown = Picture::new(camera.width, camera.height);
        // It visits the coarse levels, too.
        search(objective, &cold)?;
        let begun = clock.now();
        objective.renderer().picture(pose, &mut shown)?;
        let drawn = clock.now();
        search(objective, &once)?;
        let full = clock.now();
        search(objective, &half)?;
        let searched = clock.now();
        relocaliser.approach(objective, pose, 1)?;
        let picture = drawn.saturating_sub(begun);
        let evaluation = full.saturating_sub(drawn).saturating_sub(picture);
        let coarse = searched.saturating_sub(full).saturating_sub(full.saturating_sub(drawn));
        Ok(Costs { picture, evaluation, coarse, look: clock.now().saturating_sub(searched) })
    }

    /// Chooses each of two times.
    fn each(&self, other: &Costs, choice: fn(Duration, Duration) -> Duration) -> Costs {
        Costs {
            picture: choice(self.picture, other.picture),
            evaluation: choice(self.evaluation, other.evaluation),
            coarse: choice(self.coarse, other.coarse),
            look: choice(self.look, other.look),
        }
    }
}
