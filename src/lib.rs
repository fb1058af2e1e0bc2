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
//! The rooms from low to high, each of which knows only those before it: `docs/architecture.md`.

#![deny(unsafe_code)]
// Of the coders' parts a decoder calls some.
#![cfg_attr(not(feature = "encode"), allow(dead_code, unused_imports))]

pub mod coder_tables;
pub mod filter_weights;
pub mod geometry;
pub mod image;
pub mod packet;
pub mod prior;
pub mod random;
pub mod render;
pub mod residual;
#[cfg(feature = "encode")]
pub mod tracking;
pub mod truth;
#[allow(unsafe_code)]
// The only place; each block says why it is sound.
pub mod vulkan;

mod adaptive_numbers;
mod decoder;
mod doubt_view;
#[cfg(feature = "encode")]
mod encoded;
#[cfg(feature = "encode")]
mod encoder;
mod engine;
mod error;
mod error_kind;
#[cfg(feature = "encode")]
mod frame_time;
#[cfg(feature = "encode")]
#[allow(missing_docs)] // Of the crates of this repository.
mod frame_work;
#[cfg(feature = "encode")]
mod pipeline;
#[allow(missing_docs)] // As above.
mod queue;
mod range_coder;

/// What the other crates of this repository take apart. No promise.
#[doc(hidden)]
pub mod parts {
    #[cfg(feature = "encode")]
    pub use crate::frame_work::{Coder, FrameWork};
    pub use crate::prior::ply_header::{
        Comments, check_length, clean, read_header, rest_properties,
    };
    pub use crate::queue::{Body, Interrupt, Lost, Queue, Spawn, Worker};
    pub use crate::render::binning;
    pub use crate::render::frame::Bytes;
    pub use crate::render::kernels::{self, TrainingKernels};
    pub use crate::render::levels::{LevelBuffers, Pass, posed, prototype};
    pub use crate::render::radix::{self, Sort};
    pub use crate::render::splat_buffers::{DrawnSplats, SplatBuffers};
    pub use crate::render::stages::{self, CameraPose, Channels, Stages};
    pub use crate::render::workspace::Workspace;
    pub use crate::search::{PAPER as FREE, PoseCode};
    pub use crate::vulkan::FloatEnvironment;
}

// What tests of all kinds share, which name the library as others do.
#[cfg(test)]
extern crate self as nvsprior;
#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;
#[cfg(test)]
#[path = "../tests/scene/mod.rs"]
mod scene;

use nvsprior_kernels::{block_table, filter, portable, search, shared};

pub use decoder::{Decoded, Decoder, Trust};
pub use doubt_view::{DoubtLevel, DoubtMap, DoubtView};
#[cfg(feature = "encode")]
pub use encoded::{Encoded, FrameStats};
#[cfg(feature = "encode")]
pub use encoder::{Encoder, EncoderOptions, RenderChecks};
pub use engine::Engine;
pub use error::Error;
pub use error_kind::ErrorKind;
pub use geometry::{Camera, Pose};
pub use image::Picture;
pub use packet::Packet;
#[cfg(feature = "encode")]
pub use pipeline::Pipeline;
pub use prior::{Prior, PriorId, RenderOptions, RenderOverrides};
pub use queue::QueueError;
pub use residual::{Mode, Rate, Structure, packet_bound};
#[cfg(feature = "encode")]
pub use tracking::{FrameInfo, Hint};
