//! The frames of a run, each drawn when asked for, and what may disturb them.

use std::ops::Range;

use nvsprior::{Picture, Pose};

/// What may make a frame differ from the still scene.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Height of the moving caustics relative to the direct light.
    pub caustics: f32,
    /// Specks of marine snow in each frame.
    pub snow: u32,
    /// Standard deviation of the sensor's noise, in steps of the 8-bit picture.
    pub noise: f32,
}

impl Conditions {
    /// Calm water with little in it.
    pub const CALM: Conditions = Conditions { caustics: 0.10, snow: 6, noise: 1.0 };
}

#[derive(Clone, Debug)]
pub struct DemoFrame {
    /// File name without folder, such as `0001.png`.
    pub name: String,
    /// What the camera saw.
    pub picture: Picture,
    /// Where the camera truly was.
    pub pose: Pose,
    /// Seconds since the run began.
    pub time: f64,
}

/// Draws a frame by its index. Each is asked for once at most, in their order.
pub type DrawFrame = Box<dyn FnMut(usize) -> DemoFrame>;

/// Frames by their index. Those that are passed over (`skip`, `nth`) are not drawn.
pub struct Frames {
    indices: Range<usize>,
    draw: DrawFrame,
}

pub fn drawn(frames: usize, draw: DrawFrame) -> Frames {
    Frames { indices: 0..frames, draw }
}

impl Iterator for Frames {
    type Item = DemoFrame;

    fn next(&mut self) -> Option<DemoFrame> {
        self.nth(0)
    }

    fn nth(&mut self, n: usize) -> Option<DemoFrame> {
        self.indices.nth(n).map(&mut self.draw)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.indices.size_hint()
    }
}

impl ExactSizeIterator for Frames {}
