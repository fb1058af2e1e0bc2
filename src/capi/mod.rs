//! The C library that vendors link. Its contract is `include/nvsprior.h`. `scripts/header.sh` names the files in the
//! header's order.
//!
//! Every exported function checks its arguments, then does its work on safe types behind a fence: errors become
//! status codes with a text, panics are caught, and nothing is written unless all of it succeeded.

mod allocator;
mod collector;
mod decoder;
mod device;
mod dmabuf;
mod encoder;
mod encoding;
mod engine;
mod frame;
mod handle;
mod image;
mod lens;
mod limits;
mod log;
mod memory;
mod modifier;
mod prior;
mod sender;
mod slices;
mod status;
mod structs;
mod thread;
mod version;
mod vulkan;
