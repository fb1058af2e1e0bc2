//! What a scene does not need, whatever the camera: [`Needs`].

mod needs;
pub mod samples;

pub use needs::{Finding, Kind, Needs, key_bits, splat_bytes};
