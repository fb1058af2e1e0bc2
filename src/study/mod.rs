//! What a scene does not need: exactly, whatever the camera ([`Needs`]), or within a tolerance at a
//! mission's views ([`trim`], with the feature `mapping`).

mod needs;
pub mod samples;
#[cfg(feature = "mapping")]
pub mod trim;

pub use needs::{Finding, Kind, Needs, key_bits, splat_bytes};
