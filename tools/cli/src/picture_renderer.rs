//! Pictures of priors, and how long they take.

use std::sync::Arc;
use std::time::Instant;

use nvsprior::render::{Plan, Renderer, Scene};
use nvsprior::{Camera, Engine, Picture, Pose, Prior};
use nvsprior_inputs::statistics::median;

/// Draws a prior's 8-bit pictures, for any camera.
pub struct PictureRenderer {
    engine: Engine,
    scene: Arc<Scene>,
    renderer: Option<(Camera, Renderer)>,
    picture: Picture,
}

impl PictureRenderer {
    pub fn new(engine: &Engine, prior: &Prior) -> anyhow::Result<PictureRenderer> {
        Ok(PictureRenderer::of(engine, engine.upload(prior)?))
    }

    /// Renders an uploaded prior.
    pub fn of(engine: &Engine, scene: Arc<Scene>) -> PictureRenderer {
        PictureRenderer {
            engine: engine.clone(),
            scene,
            renderer: None,
            picture: Picture::default(),
        }
    }

    pub fn render(&mut self, camera: &Camera, pose: &Pose) -> anyhow::Result<&Picture> {
        if self.renderer.as_ref().is_none_or(|(kept, _)| kept != camera) {
            let renderer = self.engine.renderer(&self.scene, camera, Plan::picture())?;
            self.renderer = Some((*camera, renderer));
            self.picture.resize(camera.width, camera.height);
        }
        if let Some((_, renderer)) = &mut self.renderer {
            renderer.picture(pose, &mut self.picture)?;
        }
        Ok(&self.picture)
    }

    pub fn render_all(&mut self, places: &[(Camera, Pose)]) -> anyhow::Result<Vec<Picture>> {
        places.iter().map(|(camera, pose)| self.render(camera, pose).cloned()).collect()
    }
}

/// Milliseconds of a picture by each of two renderers, and the median of their ratios. The two render in turn; times
/// are medians over the views.
pub struct Times {
    pub first: f64,
    pub second: f64,
    /// First over second.
    pub ratio: f64,
}

/// Renders of each at every view; the first is not counted.
const TURNS: usize = 6;

/// Times two priors' pictures, turn by turn.
pub fn compare_times(
    first: &mut PictureRenderer,
    second: &mut PictureRenderer,
    places: &[(Camera, Pose)],
) -> anyhow::Result<Times> {
    let (mut a, mut b, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for (camera, pose) in places {
        for turn in 0..TURNS {
            let (ta, tb) = (timed(first, camera, pose)?, timed(second, camera, pose)?);
            if turn > 0 {
                a.push(ta);
                b.push(tb);
                ratios.push(ta / tb);
            }
        }
    }
    Ok(Times { first: median(a), second: median(b), ratio: median(ratios) })
}

/// Milliseconds of a picture.
pub fn timed(renderer: &mut PictureRenderer, camera: &Camera, pose: &Pose) -> anyhow::Result<f64> {
    let since = Instant::now();
    renderer.render(camera, pose)?;
    Ok(since.elapsed().as_secs_f64() * 1e3)
}
