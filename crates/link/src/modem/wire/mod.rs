//! Modem frames as bytes.

pub mod code;
pub mod contents;
pub mod layout;
pub mod plain;
pub mod share;
pub mod travelling;
