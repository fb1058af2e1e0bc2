//! Tracks the pose from frame to frame: where to start, how to search, and when to search afresh.

mod afresh;
mod follow;
mod judgement;
mod state;

pub use state::Tracker;
