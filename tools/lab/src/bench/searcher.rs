//! What finds poses and encodes: the engine, or the paper's system.

use nvsprior::tracking::Evaluation;
use nvsprior::{Camera, Encoded, FrameInfo, Picture};

/// Finds the poses of frames, and encodes them.
pub trait Searcher {
    fn set_camera(&mut self, camera: &Camera) -> anyhow::Result<()>;
    fn encode(&mut self, frame: &Picture, info: FrameInfo) -> anyhow::Result<Encoded>;
    /// Forgets all earlier frames.
    fn reset(&mut self);
    /// Evaluations of the last search.
    fn trace(&self) -> &[Evaluation];
}

impl Searcher for nvsprior::Encoder {
    fn set_camera(&mut self, camera: &Camera) -> anyhow::Result<()> {
        Ok(self.set_camera(camera)?)
    }

    fn encode(&mut self, frame: &Picture, info: FrameInfo) -> anyhow::Result<Encoded> {
        Ok(self.encode(frame, info)?)
    }

    fn reset(&mut self) {
        self.reset();
    }

    fn trace(&self) -> &[Evaluation] {
        self.trace()
    }
}

impl Searcher for nvsprior_paper::Encoder {
    fn set_camera(&mut self, camera: &Camera) -> anyhow::Result<()> {
        Ok(self.set_camera(camera)?)
    }

    fn encode(&mut self, frame: &Picture, info: FrameInfo) -> anyhow::Result<Encoded> {
        Ok(self.encode(frame, info)?)
    }

    fn reset(&mut self) {
        self.reset();
    }

    fn trace(&self) -> &[Evaluation] {
        self.trace()
    }
}
