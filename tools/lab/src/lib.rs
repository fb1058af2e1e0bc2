//! Measures the engine: run time and error ([`mod@bench`]), numbers at their extremes ([`stability`]), whether a device
//! is portable ([`verify_device`]), what a device can do at best ([`ceilings`]), and how much of that each stage should
//! take ([`cost`]).

pub mod bench;
pub mod ceilings;
pub mod cost;
pub mod stability;
pub mod verify_device;
