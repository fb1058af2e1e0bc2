//! Frames that came after those that an update is learnt from.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::Picture;

use super::key_frame::KeyFrame;

/// A frame, and the scene's render at its pose without the update.
pub struct HeldOut {
    pub frame: Arc<KeyFrame>,
    pub render: Picture,
}

/// The newest ones, the oldest first.
#[derive(Default)]
pub struct HeldOuts(VecDeque<HeldOut>);

impl HeldOuts {
    /// Adds a frame; keeps at most `most`.
    pub fn push(&mut self, frame: HeldOut, most: usize) {
        while self.0.len() >= most.max(1) {
            self.0.pop_front();
        }
        self.0.push_back(frame);
    }

    pub fn pop(&mut self) -> Option<HeldOut> {
        self.0.pop_front()
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }
}
