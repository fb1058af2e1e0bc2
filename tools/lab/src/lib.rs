//! Measuring the engine: run time and error ([`mod@bench`]), numbers at their extremes ([`stability`]), whether a
//! device draws what every other one draws ([`verify_device`]), what a device can do at best ([`ceilings`]), and what
//! each stage should take of that ([`cost`]).

pub mod bench;
pub mod ceilings;
pub mod cost;
pub mod stability;
pub mod verify_device;
