//! The vehicle's end: packets to modem frames.

pub mod division;
pub mod history;
pub mod interleaver;
pub mod keyed;
pub mod loss;
pub mod rate_control;
pub mod sender;
pub mod sharer;
pub mod sharing;
pub mod unprotected;
