//! What of a prior a mission's views do not need, within a tolerance ([`trim`], with the feature `mapping`). What no
//! view at all needs: [`crate::prior::analysis`].

pub mod samples;
#[cfg(feature = "mapping")]
pub mod trim;
