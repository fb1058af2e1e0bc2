//! Training the splats of an update, and only these.

use glam::{DQuat, DVec3};

use crate::prior::update::{COLOUR_STEP, LOG_SCALE_STEP, LOGIT_STEP, ROTATION_STEPS};
use crate::prior::{LearntSplat, UpdateGrid};
use crate::random::Random;
use crate::render::training::{FADING, SH_0, Training, TrainingState, UNUSED};
use crate::shared::sh_coefficients;
use crate::training::{LOG_SCALE, OPACITY, POSITION, ROTATION, SH, planes};

use super::cells::Start;

/// Logit of the opacity of a first splat.
const FIRST_LOGIT: f32 = 3.0;
/// Splats of a lower opacity than this logit's are left out of the update.
const FAINT: f32 = -2.8;
/// Share of the steps that are taken with splats as they are, before they are rounded.
const FREE: f64 = 0.6;
/// Share of the rates that is left at the end.
const LAST: f64 = 0.1;
/// Rates at the start: of positions, in median distances; log scales, rotations, opacities, colours.
const RATES: [f32; 5] = [8e-4, 0.04, 0.02, 0.1, 0.04];
/// Pull of opacities towards 0, per splat: a splat stays if it lowers the loss by more. On run T2 of the demo a splat
/// that lowers it by this spares about the bytes that it takes, over a dozen frames.
const OPACITY_PULL: f32 = 1.5e-5;
/// Errors below it count by their squares, of 1.
const KNEE: f32 = 0.1;

/// How the splats of an update are trained.
#[derive(Clone, Debug)]
pub struct Course {
    pub steps: u32,
    /// Median distance of the splats from the camera, the prior's unit.
    pub distance: f64,
    /// Step of positions.
    pub grid: UpdateGrid,
    pub sh_degree: u32,
    pub pixels: usize,
    /// Splats that there is room for.
    pub room: usize,
    /// What positions are relative to.
    pub centre: DVec3,
}

impl Course {
    /// The parameters that training starts from: new splats, then learnt ones.
    pub fn state(
        &self,
        starts: &[Start],
        learnt: &[LearntSplat],
        random: &mut Random,
    ) -> TrainingState {
        let room = self.room;
        let mut parameters = vec![0.0; room * planes(self.sh_degree) as usize];
        let mut set = |plane: u32, i: usize, value: f32| {
            parameters[plane as usize * room + i] = value;
        };
        for i in 0..room {
            set(OPACITY, i, UNUSED);
            set(ROTATION, i, 1.0);
        }
        for (i, start) in starts.iter().enumerate() {
            let position = (start.position - self.centre).as_vec3().to_array();
            for k in 0..3 {
                set(POSITION + k, i, position[k as usize]);
                let size = start.sizes[usize::from(k == 2)];
                set(LOG_SCALE + k, i, size.ln() as f32);
                set(SH + k, i, (start.colour[k as usize] - 0.5) / SH_0);
            }
            let turn = DQuat::from_rotation_arc(DVec3::Z, start.ray);
            let turn = [turn.w, turn.x, turn.y, turn.z];
            let near = turn.map(|v| v as f32 + random.within(-0.05, 0.05));
            (0..4).for_each(|k| set(ROTATION + k, i, near[k as usize]));
            set(OPACITY, i, FIRST_LOGIT);
        }
        for (i, splat) in (starts.len()..).zip(learnt) {
            let position = (splat.centre() - self.centre).as_vec3();
            for k in 0..3 {
                set(POSITION + k, i, position[k as usize]);
                set(LOG_SCALE + k, i, splat.log_scale[k as usize]);
                set(SH + k, i, splat.colour[k as usize]);
            }
            (0..4).for_each(|k| set(ROTATION + k, i, splat.rotation[k as usize]));
            set(OPACITY, i, splat.logit);
        }
        let zero = vec![0.0; parameters.len()];
        TrainingState { parameters, first: zero.clone(), second: zero }
    }

    /// What step `step` is told. `shown`: the share of the splats that its picture shows.
    pub fn at(&self, step: u32, shown: f64) -> Training {
        let share = f64::from(step) / f64::from(self.steps);
        let fall = LAST.powf(share) as f32;
        let unbias = |fading: f32| 1.0 / (1.0 - f64::from(fading).powf(f64::from(step) + 1.0));
        let [position, log_scale, rotation, opacity, colour] = RATES.map(|rate| rate * fall);
        let coefficients = sh_coefficients(self.sh_degree);
        let rounding = [
            self.grid.step() as f32,
            LOG_SCALE_STEP,
            1.0 / f32::from(ROTATION_STEPS),
            LOGIT_STEP,
            COLOUR_STEP,
        ];
        Training {
            sh_coefficients: coefficients,
            sh_trained: coefficients,
            step,
            rates: [position * self.distance as f32, log_scale, rotation, opacity, colour, 0.0],
            unbias: FADING.map(|fading| unbias(fading) as f32),
            per_value: 1.0 / (3 * self.pixels) as f32,
            knee: KNEE,
            opacity_pull: OPACITY_PULL * shown as f32,
            rounding: if share >= FREE { rounding } else { [0.0; 5] },
            ..Training::default()
        }
    }

    /// The first `count` splats as they were trained; `None` for those that are too faint.
    pub fn splats(&self, state: &TrainingState, count: usize) -> Vec<Option<LearntSplat>> {
        let at = |plane: u32, i: usize| state.parameters[plane as usize * self.room + i];
        let triple = |plane: u32, i: usize| [0, 1, 2].map(|k| at(plane + k, i));
        let splat = |i: usize| {
            let position = DVec3::from(triple(POSITION, i).map(f64::from)) + self.centre;
            LearntSplat {
                position: position.as_vec3().to_array(),
                log_scale: triple(LOG_SCALE, i),
                rotation: [0, 1, 2, 3].map(|k| at(ROTATION + k, i)),
                logit: at(OPACITY, i),
                colour: triple(SH, i),
            }
        };
        (0..count).map(|i| (at(OPACITY, i) > FAINT).then(|| splat(i))).collect()
    }
}

/// How different a learnt splat looks after training: from 1 on as different as a new one.
pub fn change(before: &LearntSplat, after: &LearntSplat) -> f64 {
    let far = |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt();
    let size = before.log_scale.iter().sum::<f32>() / 3.0;
    let moved = far(before.position, after.position) / size.exp();
    let grown = far(before.log_scale, after.log_scale);
    let opacity = |logit: f32| 1.0 / (1.0 + (-logit).exp());
    let fainter = (opacity(before.logit) - opacity(after.logit)).abs();
    let recoloured = SH_0 * far(before.colour, after.colour);
    f64::from(moved + grown + 2.0 * fainter + 4.0 * recoloured)
}
