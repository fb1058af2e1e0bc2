//! The prior: a trained 3D Gaussian Splatting scene that vehicle and topside share.

pub mod analysis;
mod beside;
pub mod blocked;
mod check;
mod claims;
pub mod compact;
#[cfg(feature = "formats")]
mod compressed_ply;
mod coordinate_frame;
mod doubt;
mod error;
mod fault;
mod file;
mod file_content;
pub mod filter_file;
#[cfg(feature = "formats")]
mod gltf;
mod id;
mod identity;
mod key_frames;
mod limits;
mod options;
mod orientation;
mod part_source;
pub mod ply;
mod ply_header;
mod ply_row;
#[allow(clippy::module_inception)]
mod prior;
mod replace;
mod report;
#[cfg(feature = "formats")]
mod sh_rotation;
#[cfg(feature = "formats")]
mod sog;
mod splats;
#[cfg(feature = "formats")]
mod spz;
pub mod tables_file;
pub mod update;

pub use check::Dropped;
pub use claims::PriorClaims;
pub use coordinate_frame::CoordinateFrame;
pub use doubt::Doubt;
pub use error::PriorError;
pub use fault::{Fault, INFINITE_LOGIT, MAX_COEFFICIENT, MAX_LOG_SCALE};
pub use file_content::PriorFile;
pub use id::PriorId;
pub use key_frames::KeyFrames;
pub use options::{RenderOptions, RenderOverrides};
pub use part_source::PartSource;
pub use ply_row::PlyRow;
pub use prior::Prior;
pub use replace::replace_file;
pub use report::{LoadReport, PriorFormat};
pub use splats::Splats;
pub use update::{
    ChainRead, Change, Fade, Learnt, LearntSplat, NewSplat, StateId, Update, UpdateChain,
    UpdateError, UpdateGrid,
};

#[cfg(test)]
pub(crate) mod tests;
