//! The unit of run time: one forward render at full resolution, on the same device, just before the measurement.

use std::sync::Arc;
use std::time::Instant;

use nvsprior::render::{Plan, Renderer, Scene};
use nvsprior::{Camera, Engine, Picture, Pose};

use super::statistics::median;

/// Renders; their median counts.
const RENDERS: usize = 3;

/// A renderer of 8-bit pictures at full resolution, and all its times.
pub struct Forward {
    engine: Engine,
    scene: Arc<Scene>,
    renderer: Option<(Camera, Renderer)>,
    picture: Picture,
    /// Milliseconds, submission and wait included.
    pub times: Vec<f64>,
}

impl Forward {
    pub fn new(engine: &Engine, scene: &Arc<Scene>) -> Forward {
        let (engine, scene) = (engine.clone(), scene.clone());
        Forward { engine, scene, renderer: None, picture: Picture::default(), times: Vec::new() }
    }

    /// The render at a pose.
    pub fn picture(&mut self, camera: &Camera, pose: &Pose) -> anyhow::Result<&Picture> {
        self.measure(camera, pose)?;
        Ok(&self.picture)
    }

    /// Milliseconds of a render now.
    pub fn measure(&mut self, camera: &Camera, pose: &Pose) -> anyhow::Result<f64> {
        let renderer = match &mut self.renderer {
            Some((kept, renderer)) if kept == camera => renderer,
            slot => {
                let mut renderer = self.engine.renderer(&self.scene, camera, Plan::picture())?;
                self.picture.resize(camera.width, camera.height);
                // Not counted: drivers finish their work at first use.
                renderer.picture(pose, &mut self.picture)?;
                &mut slot.insert((*camera, renderer)).1
            }
        };
        let mut times = [0.0; RENDERS];
        for time in &mut times {
            let since = Instant::now();
            renderer.picture(pose, &mut self.picture)?;
            *time = since.elapsed().as_secs_f64() * 1e3;
        }
        let time = median(times);
        self.times.push(time);
        Ok(time)
    }
}
