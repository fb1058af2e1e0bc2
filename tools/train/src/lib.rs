//! Makes priors ([`mapper`], [`mapping`]), and reduces them, within a tolerance, to what a mission's views need ([`trim`]). The
//! library itself leaves out what no view needs: [`nvsprior::prior::analysis`].

pub mod coder_tables;
pub mod mapper;
pub mod mapping;
mod posed_picture;
pub mod samples;
pub mod trim;

pub use posed_picture::PosedPicture;
