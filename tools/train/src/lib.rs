//! Making priors ([`mapper`], [`mapping`]), and reducing them to what a mission's views need, within a tolerance ([`trim`]). What no
//! view at all needs, the library leaves out itself: [`nvsprior::prior::analysis`].

pub mod coder_tables;
pub mod mapper;
pub mod mapping;
pub mod samples;
pub mod trim;
