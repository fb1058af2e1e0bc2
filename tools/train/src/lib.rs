//! Makes priors ([`mapper`]), and reduces them, within a tolerance, to what a mission's views need ([`trim`]). The
//! library itself leaves out what no view needs: [`nvsprior::prior::analysis`].

pub mod coder_tables;
pub mod mapper;
mod posed_picture;
mod refit;
pub mod samples;
pub mod trim;

pub use posed_picture::PosedPicture;
