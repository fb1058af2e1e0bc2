//! Measuring the engine: run time and error ([`bench`]), numbers at their extremes ([`stability`]), and what a device can
//! do at best ([`ceilings`]).

pub mod bench;
pub mod ceilings;
pub mod stability;
