//! Where Rust and C meet. With `vulkan`, the only place with `unsafe` code.

pub(crate) mod libwebp;
