//! Modem frames as bytes.

pub mod code;
pub mod contents;
pub mod continuation;
pub mod layout;
pub mod piece;
pub mod share;
