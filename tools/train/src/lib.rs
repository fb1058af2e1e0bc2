//! Makes priors ([`mapper`]), and reduces them, within a tolerance, to what a mission's views need ([`trim`]). The
//! library itself leaves out what no view needs: [`nvsprior::prior::analysis`].

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

mod blending;
pub mod coder_tables;
pub mod coverage;
pub mod doubt;
mod drawn;
pub mod filter;
mod fit;
pub mod key_frames;
pub mod mapper;
pub mod parallax;
pub mod parts;
pub mod pose_trials;
mod posed_picture;
pub mod removal;
pub mod samples;
pub mod trainer;
pub mod trim;

pub use fit::FitError;
pub use posed_picture::PosedPicture;
