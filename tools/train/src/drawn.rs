//! A prior that is drawn for some cameras, one at a time.

use std::sync::Arc;

use nvsprior::render::{Plan, Renderer, Scene};
use nvsprior::vulkan::Error;
use nvsprior::{Camera, Engine, Pose, Prior};

pub struct Drawn {
    engine: Engine,
    scene: Arc<Scene>,
    renderer: Option<Renderer>,
}

impl Drawn {
    pub fn new(engine: &Engine, prior: &Prior) -> Result<Drawn, Error> {
        Ok(Drawn { engine: engine.clone(), scene: engine.upload(prior)?, renderer: None })
    }

    /// Red, green, blue, depth Σ wᵢ zᵢ and transmittance of each pixel.
    pub fn draw(&mut self, camera: &Camera, pose: &Pose) -> Result<&[[f32; 5]], Error> {
        let kept = self.renderer.take().filter(|kept| kept.camera(0) == camera);
        let renderer = self.renderer.insert(match kept {
            Some(kept) => kept,
            None => self.engine.renderer(&self.scene, camera, Plan::picture())?,
        });
        Ok(renderer.draw(pose)?.as_chunks::<5>().0)
    }
}
