//! Learning while diving: what the camera sees and the prior does not show becomes splats of an [`Update`].
//!
//! An episode goes through four phases, a slice per frame:
//!
//! 1. *Collect*: certain frames are kept until the camera has moved enough to tell depths apart.
//! 2. *Start*: cells of the picture that differ from the render get a splat each, at the depth at which the other
//!    frames show the same (plane sweep, Collins 1996). Learnt splats beside which the newest frames look worse than
//!    without are taken back.
//! 3. *Refine*: these splats, and the learnt ones in view, are trained on parts of the kept frames and of some older
//!    ones. They are rounded as the update will hold them. The prior's own splats stay.
//! 4. *Judge*: splats and changes that spare a frame too little, one that was not learnt from, are left out. More such
//!    frames are coded with the update and without. It is given out if it pays for its bytes while the camera moves by
//!    a stated number of key frames.
//!
//! An update that is given out is not drawn with at once: the topside must hold it first. Until the encoder adopts or
//! drops it, the learner collects frames and begins no episode.
//!
//! Moving light, snow and fish differ too, but what was learnt of them saves nothing on later frames. So phase 4 keeps
//! them out, whatever phase 2 took them for.
//!
//! The same frames give the same updates on one device: budgets are counted in steps, not in time.
//!
//! [`Update`]: crate::prior::Update

mod beside;
mod blur;
mod cells;
mod crop;
mod draft;
mod harm;
mod held_out;
mod judge;
mod key_frame;
mod learner;
mod options;
mod refine;
mod sweep;
mod trial;
mod worth;

pub(crate) use beside::Beside;
pub use learner::LearnerStats;
pub(crate) use learner::{Found, Learner};
pub use options::LearnOptions;
pub(crate) use trial::Proven;
