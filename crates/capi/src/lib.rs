//! The C library that vendors link. Its contract are the headers in `include/`. `scripts/header.py` names the files in
//! their order.
//!
//! Every exported function checks its arguments, then does its work on safe types behind a fence: errors become
//! status codes with a text, panics are caught, and nothing is written unless all of it succeeded.

#![allow(non_camel_case_types)] // C's names.

mod allocator;
mod decoder;
mod device;
mod dmabuf;
mod encoder;
mod encoding;
mod engine;
mod event;
mod frame;
mod handle;
mod image;
mod keys;
mod lens;
mod limits;
mod log;
mod memory;
mod modifier;
mod prior;
mod slices;
mod stack;
mod statistics;
mod status;
mod structs;
mod thread;
mod topside;
mod truth;
mod vehicle;
mod version;
mod vulkan;
