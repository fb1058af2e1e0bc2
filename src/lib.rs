//! Pictures through an acoustic modem.
//!
//! A vehicle and its topside hold the same trained 3D Gaussian Splatting scene, the [`Prior`]. For
//! each camera frame the [`Encoder`] finds the [`Pose`] at which the prior looks most like the
//! frame. It packs that pose with a coded difference picture. The [`Decoder`] renders the prior at
//! the pose and adds the difference. Everything that touches pixels runs as Vulkan compute.
//!
//! ```no_run
//! # fn main() -> Result<(), nvsprior::Error> {
//! # let (camera, frame, start) = todo!();
//! use nvsprior::{Decoder, Encoder, EncoderOptions, Engine, Prior};
//!
//! let engine = Engine::new(&Default::default())?;
//! let prior = Prior::open("prior.ply".as_ref(), &Default::default())?;
//! let scene = engine.upload(&prior)?;
//! let mut encoder = Encoder::new(&engine, &scene, &camera, EncoderOptions::default())?;
//! let encoded = encoder.encode(&frame, Some(start))?;
//!
//! let mut decoder = Decoder::new(&engine, &scene);
//! let decoded = decoder.decode(&encoded.packet)?;
//! assert_eq!(decoded.picture, encoded.picture);
//! # Ok(()) }
//! ```
//!
//! The rooms from low to high; each knows only those before it: [`random`], [`geometry`], [`keys`], `queue` and
//! `range_coder`; [`image`]; [`vulkan`]; [`coder_tables`] and [`filter_weights`]; [`prior`]; [`render`]; [`packet`];
//! [`residual`]; `error`; [`tracking`]; `engine` and [`modem`]; `encoder` and `decoder`; `pipeline`;
//! [`link`]; [`capi`]. `scripts/arrows.py` checks it.

#![deny(unsafe_code)]

#[cfg(feature = "capi")]
#[allow(unsafe_code)]
// With `vulkan` and `residual::webp` the only places; each block says why it is sound.
pub mod capi;
pub mod coder_tables;
pub mod filter_weights;
pub mod geometry;
pub mod image;
pub mod keys;
pub mod link;
pub mod modem;
pub mod packet;
pub mod prior;
pub mod random;
pub mod render;
pub mod residual;
pub mod tracking;
pub mod truth;
#[allow(unsafe_code)]
pub mod vulkan;

mod adaptive_numbers;
mod decoder;
mod doubt_view;
mod encoded;
mod encoder;
mod engine;
mod error;
mod error_kind;
mod frame_time;
mod frame_work;
mod pipeline;
mod queue;
mod range_coder;

// What tests of all kinds share, which name the library as others do.
#[cfg(test)]
extern crate self as nvsprior;
#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;
#[cfg(test)]
#[path = "../tests/scene/mod.rs"]
mod scene;

#[cfg(feature = "training")]
use nvsprior_kernels::training;
use nvsprior_kernels::{block_table, filter, portable, search, shared};

pub use decoder::{Decoded, Decoder, Trust};
pub use doubt_view::{DoubtLevel, DoubtMap, DoubtView};
pub use encoded::{Encoded, FrameStats, packet_bound};
pub use encoder::{Encoder, EncoderOptions, RenderChecks};
pub use engine::Engine;
pub use error::Error;
pub use error_kind::ErrorKind;
pub use geometry::{Camera, Pose};
pub use image::Picture;
pub use packet::Packet;
pub use pipeline::Pipeline;
pub use prior::{Prior, PriorId, RenderOptions, RenderOverrides};
pub use queue::QueueError;
pub use residual::{Mode, Rate, Structure};
pub use tracking::{FrameInfo, Hint};
