//! How to learn.

/// How a vehicle learns. Numbers that make no sense are taken as the nearest that does.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnOptions {
    /// Steps of training per frame. A step looks at a quarter of a picture. It takes about as long as a forward render.
    pub steps_per_frame: u32,
    /// Steps of an episode.
    pub steps: u32,
    /// Frames that an episode learns from, at most.
    pub frames: usize,
    /// At least.
    pub fewest_frames: usize,
    /// How far points at the picture's median depth must have moved between two of them, pixels.
    pub parallax: f64,
    /// Most splats of an update, at most 256.
    pub splats: usize,
    /// Within so many key frames, and the frames between them, an update must save the bytes that it takes. Key frames
    /// are frames between which the camera has moved by [`parallax`](LearnOptions::parallax).
    pub horizon: u32,
    /// Frames that an update is judged by, none of which it was learnt from.
    pub judged: usize,
}

impl LearnOptions {
    /// With all numbers in their ranges.
    pub(super) fn in_range(&self) -> LearnOptions {
        let frames = self.frames.clamp(3, 64);
        LearnOptions {
            steps_per_frame: self.steps_per_frame.max(1),
            steps: self.steps.max(1),
            frames,
            fewest_frames: self.fewest_frames.clamp(3, frames),
            splats: self.splats.min(256),
            judged: self.judged.clamp(2, 64),
            ..self.clone()
        }
    }
}

impl Default for LearnOptions {
    fn default() -> LearnOptions {
        LearnOptions {
            steps_per_frame: 60,
            steps: 240,
            frames: 8,
            fewest_frames: 5,
            parallax: 4.0,
            splats: 100,
            horizon: 15,
            judged: 2,
        }
    }
}
