//! What the C library exports. In the order in which it stands in the header.

mod handle;
mod worker;

mod status;

mod structs;

mod version;

mod log;

mod engine;

mod prior;

mod image;

mod frame;

mod encoder;

mod decoder;

mod modem;
