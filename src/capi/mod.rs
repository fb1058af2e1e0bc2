//! Where Rust and C meet: the C library that vendors link, whose contract is `include/nvsprior.h`,
//! and the one C library that is linked here.
//!
//! With `vulkan`, the only place with `unsafe` code. Every exported function checks its arguments,
//! then does its work on safe types behind a fence: errors become status codes with a text, panics are
//! caught, and nothing is written unless all of it succeeded.

pub(crate) mod libwebp;

#[cfg(feature = "capi")]
mod exports;
