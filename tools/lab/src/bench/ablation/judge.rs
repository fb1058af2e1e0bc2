//! What a pose is worth: the same for every method.

use anyhow::Context as _;
use nvsprior::image::psnr_of_mse;
use nvsprior::render::{Plan, Renderer};
use nvsprior::{Camera, Picture, Pose, Rate};
use nvsprior_paper::WebpEncoder;

use super::super::context::{Best, Context, Shot};
use super::method::{Attempt, Method};

/// Quality of the difference picture.
const QUALITY: Rate = Rate::Quality(10.0);

/// The render at a pose against the frame.
#[derive(Clone, Copy, Debug)]
pub struct Verdict {
    /// Energy of the difference: mean squared error, values in [0, 1] (the paper's eq. mse, averaged
    /// over channels too).
    pub energy: f64,
    /// Of the difference, as WebP at quality 10.
    pub bytes: usize,
}

impl Verdict {
    /// Of the render, dB.
    pub fn psnr(&self) -> f64 {
        psnr_of_mse(self.energy)
    }
}

/// What a method made of a frame.
pub struct Judged {
    pub shot: usize,
    pub method: Method,
    pub attempt: Attempt,
    pub verdict: Verdict,
}

/// Renders poses and codes the differences.
#[derive(Default)]
pub struct Judge {
    tools: Option<Tools>,
}

struct Tools {
    camera: Camera,
    renderer: Renderer,
    webp: WebpEncoder,
    render: Picture,
}

impl Judge {
    /// Judges what a method made of a frame. If its pose is better than the best known one, it is that from then on.
    pub fn judge(
        &mut self,
        context: &mut Context,
        shot: usize,
        method: Method,
        attempt: Attempt,
    ) -> anyhow::Result<Judged> {
        let verdict = self.verdict(context, shot, &attempt.pose)?;
        let best = &mut context.best[shot];
        if verdict.psnr() > best.psnr {
            *best = Best { pose: attempt.pose, psnr: verdict.psnr() };
        }
        Ok(Judged { shot, method, attempt, verdict })
    }

    fn verdict(&mut self, context: &Context, shot: usize, pose: &Pose) -> anyhow::Result<Verdict> {
        let Shot { file, camera, picture, .. } = &context.shots[shot];
        let Tools { renderer, webp, render, .. } = self.tools(context, camera)?;
        renderer.picture(pose, render)?;
        let energy = render.mse(picture);
        let coded = webp.encode(picture, render, QUALITY, 0);
        let coded = coded.with_context(|| format!("coding the difference from {file}"))?;
        Ok(Verdict { energy, bytes: coded.payload.map_or(0, |payload| payload.bytes.len()) })
    }

    fn tools(&mut self, context: &Context, camera: &Camera) -> anyhow::Result<&mut Tools> {
        let tools = match self.tools.take() {
            Some(tools) if tools.camera == *camera => tools,
            _ => Tools {
                camera: *camera,
                renderer: context.engine.renderer(&context.scene, camera, Plan::picture())?,
                webp: WebpEncoder::new(camera.width, camera.height),
                render: Picture::new(camera.width, camera.height),
            },
        };
        Ok(self.tools.insert(tools))
    }
}
