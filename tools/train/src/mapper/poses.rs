//! Poses that fit the pictures better than the given ones: those of navigation or of a reconstruction are off by
//! pixels.
//!
//! A Gauss–Newton step per picture, by the engine's own normal equations against the splats as they are. A step is kept
//! if it makes the picture's error smaller.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector6};
use nvsprior::render::{Jacobian, Plan, Scene};
use nvsprior::tracking::Objective;
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Camera, Engine, Picture, Pose, Prior};

use crate::PosedPicture;

/// The diagonal of the normal equations grows by this share, so that a poor view moves little.
const DAMPING: f64 = 0.01;

/// Steps to better poses against one state of the splats.
pub struct PoseSteps<'a> {
    engine: &'a Engine,
    scene: Arc<Scene>,
    /// One per camera: most runs have one.
    objectives: Vec<(Camera, Objective)>,
}

impl<'a> PoseSteps<'a> {
    /// Against a prior.
    pub fn new(engine: &'a Engine, prior: &Prior) -> Result<PoseSteps<'a>, DeviceError> {
        Ok(PoseSteps { engine, scene: engine.upload(prior)?, objectives: Vec::new() })
    }

    /// A better pose of a view, or the one it has. `picture`: the view's, in the scene's light.
    pub fn step(
        &mut self,
        view: &PosedPicture,
        picture: &Picture,
        pose: &Pose,
    ) -> Result<Pose, DeviceError> {
        let objective = self.objective(&view.camera)?;
        let frame = counted(view, picture, objective, pose)?;
        objective.set_frame(&frame);
        let here = objective.evaluate(0, Jacobian::Exact, pose)?;
        let mut jtj = Matrix6::from_fn(|row, column| here.jtj[row][column]);
        for k in 0..6 {
            jtj[(k, k)] *= 1.0 + DAMPING;
        }
        let Some(factor) = jtj.cholesky() else { return Ok(*pose) };
        let step = factor.solve(&-Vector6::from(here.jtr));
        let moved = pose.stepped(&step.into());
        let there = objective.evaluate(0, Jacobian::Exact, &moved)?;
        Ok(if there.square < here.square { moved } else { *pose })
    }

    fn objective(&mut self, camera: &Camera) -> Result<&mut Objective, DeviceError> {
        let known = self.objectives.iter().position(|(own, _)| own == camera);
        let place = match known {
            Some(place) => place,
            None => {
                let plan = Plan { jacobians: vec![Jacobian::Exact], ..Plan::picture() };
                let renderer = self.engine.renderer(&self.scene, camera, plan)?;
                self.objectives.push((*camera, Objective::new(renderer)));
                self.objectives.len() - 1
            }
        };
        Ok(&mut self.objectives[place].1)
    }
}

/// The picture, with the render in the place of pixels that do not count: they pull nowhere.
fn counted(
    view: &PosedPicture,
    picture: &Picture,
    objective: &mut Objective,
    pose: &Pose,
) -> Result<Picture, DeviceError> {
    let mut frame = picture.clone();
    if view.mask.is_none() {
        return Ok(frame);
    }
    let mut render = Picture::new(frame.width, frame.height);
    objective.renderer().picture(pose, &mut render)?;
    for pixel in (0..view.camera.pixels()).filter(|pixel| !view.counts(*pixel)) {
        let place = 3 * pixel..3 * pixel + 3;
        frame.data[place.clone()].copy_from_slice(&render.data[place]);
    }
    Ok(frame)
}
