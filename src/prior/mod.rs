//! The prior: a trained 3D Gaussian Splatting scene that vehicle and topside share.

pub mod analysis;
mod beside;
mod besides;
pub mod blocked;
mod check;
mod claims;
pub mod compact;
mod container;
mod coordinate_frame;
mod cut_view;
mod error;
mod extras;
pub mod extras_file;
mod fault;
mod field;
mod file;
mod file_content;
mod id;
mod identity;
mod key_frames;
mod limits;
mod near_plane;
mod options;
mod orientation;
mod plausible;
pub mod ply;
#[allow(missing_docs)] // Of the crates of this repository.
pub(crate) mod ply_header;
mod ply_layout;
mod ply_row;
mod pose_trials;
#[allow(clippy::module_inception)]
mod prior;
mod replace;
mod report;
mod rewrite;
mod splats;
mod warning;

pub use besides::Besides;
pub use check::Dropped;
pub use claims::PriorClaims;
pub use coordinate_frame::{CoordinateFrame, origin_of};
pub use error::PriorError;
pub use extras::Extras;
pub use fault::{Fault, INFINITE_LOGIT, MAX_COEFFICIENT, MAX_LOG_SCALE};
pub use field::{Field, FieldUse, passed_over};
pub use file_content::PriorFile;
pub use id::PriorId;
pub use key_frames::KeyFrames;
pub use options::{RenderOptions, RenderOverrides};
pub use ply_row::PlyRow;
pub use pose_trials::{PoseTrial, PoseTrials};
pub use prior::Prior;
pub use replace::replace_file;
pub use report::{LoadReport, PriorFormat};
pub use rewrite::{with_coder_tables, with_extras};
pub use splats::Splats;
pub use warning::PriorWarning;

#[cfg(test)]
pub(crate) mod tests;
