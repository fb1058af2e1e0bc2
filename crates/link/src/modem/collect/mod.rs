//! The topside's end: modem frames to packets.

pub mod collected;
pub mod collector;
pub mod layers;
pub mod plain;
pub mod slot;
pub mod stream;
pub mod waiting;
