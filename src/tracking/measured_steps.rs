//! Measures how long the steps of a search take on a device.

use std::time::Duration;

use crate::Pose;
use crate::search::COMPACT;
use crate::vulkan::Error;

use super::budget::{COARSE, LEAST, Room, SearchSteps};
use super::gauss_newton;
use super::schedule::Schedule;
use super::{Clock, GaussNewtonOptions, Objective, Relocaliser, StepTime};

/// How often steps are timed at a pose. The shortest time counts: the driver compiles, and other programs disturb.
const ROUNDS: usize = 3;

/// Measures the steps of a search at some poses. The driver compiles then, and in no frame.
pub(crate) fn measured_steps(
    clock: &Clock,
    objective: &mut Objective,
    poses: &[Pose],
) -> Result<SearchSteps, Error> {
    let GaussNewtonOptions { cold, damping, .. } = GaussNewtonOptions::default();
    let once = Schedule { first_level: 0, follow_level: 0, renders: 1, leap: 0.0, ..cold };
    let mut relocaliser = Relocaliser::new(objective, &[]);
    objective.set_flat_frame();
    let search = |objective: &mut Objective, pose: &Pose, schedule: &Schedule| {
        gauss_newton::search(objective, &[*pose], schedule, damping, COMPACT, &Room::ALL)
    };
    let steps = SearchSteps { coarse: StepTime::new(clock), look: StepTime::new(clock) };
    for pose in poses {
        search(objective, pose, &cold)?;
        let mut shortest = [Duration::MAX; 2];
        for _ in 0..ROUNDS {
            let begun = clock.now();
            search(objective, pose, &once)?;
            let searched = clock.now();
            relocaliser.approach(objective, pose, 1)?;
            let taken = [
                searched.saturating_sub(begun) / (COARSE * LEAST),
                clock.now().saturating_sub(searched),
            ];
            shortest = std::array::from_fn(|i| shortest[i].min(taken[i]));
        }
        steps.coarse.add(shortest[0]);
        steps.look.add(shortest[1]);
    }
    Ok(steps)
}
