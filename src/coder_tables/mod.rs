//! Coder tables: the weights of the wavelet coder's networks.
//!
//! The coder itself is [`residual::wavelet`](crate::residual::wavelet). The tables are a room of their own, since a
//! prior may bring tables of its scene.

pub mod networks;
mod tables;

pub use tables::{MAGNITUDES, Offsets, PLANES, RANKS, Tables, TablesError};
