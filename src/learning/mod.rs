//! Learning while diving: what the camera sees and the prior does not show becomes splats of an [`Update`].
//!
//! An episode goes through four phases, a slice per frame:
//!
//! 1. *Collect*: certain frames are kept until the camera has moved enough to tell depths apart.
//! 2. *Start*: cells of the picture that differ from the render get a splat each, at the depth at which the other frames
//!    show the same (plane sweep, Collins 1996).
//! 3. *Refine*: these splats alone are trained on the kept frames, rounded as the update will hold them.
//! 4. *Judge*: frames that were not learnt from are coded with and without the splats. The update is given out if it
//!    pays for its bytes within a stated number of frames.
//!
//! Moving light, snow and fish differ too, but what was learnt of them saves nothing on later frames. So phase 4 keeps
//! them out, whatever phase 2 took them for.
//!
//! The same frames give the same updates on one device: budgets are counted in steps, not in time.
//!
//! [`Update`]: crate::prior::Update

mod blur;
mod cells;
mod harm;
mod held_out;
mod judge;
mod key_frame;
mod learner;
mod options;
mod refine;
mod sweep;

pub(crate) use learner::Found;
pub(crate) use learner::Learner;
pub use learner::LearnerStats;
pub use options::LearnOptions;
