//! How to learn.

/// How a [`Learner`](super::Learner) learns.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnOptions {
    /// Steps of training per frame. A step takes about as long as two to three forward renders.
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
    /// Frames within which an update must save the bytes that it takes.
    pub horizon: u32,
    /// Frames that an update is judged by, none of which it was learnt from.
    pub judged: usize,
}

impl Default for LearnOptions {
    fn default() -> LearnOptions {
        LearnOptions {
            steps_per_frame: 30,
            steps: 60,
            frames: 8,
            fewest_frames: 6,
            parallax: 4.0,
            splats: 100,
            horizon: 15,
            judged: 2,
        }
    }
}
