//! The unit of run time: one forward render at full resolution, on the same device, just before the measurement.

use std::sync::Arc;
use std::time::Instant;

use nvsprior::render::{Plan, Renderer, Scene};
use nvsprior::{Camera, Engine, Picture, Pose};

use nvsprior_inputs::statistics::median;

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

    /// The render at a pose; not timed.
    pub fn picture(&mut self, camera: &Camera, pose: &Pose) -> anyhow::Result<&Picture> {
        let (renderer, picture) = self.ready(camera, pose)?;
        renderer.picture(pose, picture)?;
        Ok(picture)
    }

    /// Milliseconds of a render now.
    pub fn measure(&mut self, camera: &Camera, pose: &Pose) -> anyhow::Result<f64> {
        let (renderer, picture) = self.ready(camera, pose)?;
        let mut times = [0.0; RENDERS];
        for time in &mut times {
            (_, *time) = timed(|| Ok(renderer.picture(pose, picture)?))?;
        }
        let time = median(times);
        self.times.push(time);
        Ok(time)
    }

    /// The renderer of a camera, and a picture of its size.
    fn ready(
        &mut self,
        camera: &Camera,
        pose: &Pose,
    ) -> anyhow::Result<(&mut Renderer, &mut Picture)> {
        let picture = &mut self.picture;
        let ready = match self.renderer.take().filter(|(kept, _)| kept == camera) {
            Some(kept) => kept,
            None => {
                let mut renderer = self.engine.renderer(&self.scene, camera, Plan::picture())?;
                picture.resize(camera.width, camera.height);
                // Not counted: drivers finish their work at first use.
                renderer.picture(pose, picture)?;
                (*camera, renderer)
            }
        };
        Ok((&mut self.renderer.insert(ready).1, picture))
    }
}

/// Milliseconds that something takes, and what it gives.
pub fn timed<T>(work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<(T, f64)> {
    let (value, ms) = timed_value(work);
    Ok((value?, ms))
}

/// As [`timed`], for what cannot fail.
pub fn timed_value<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let since = Instant::now();
    let value = work();
    (value, since.elapsed().as_secs_f64() * 1e3)
}
