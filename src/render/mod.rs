//! Rendering the prior on the device. `stages.rs` records the stages of a frame in their order; the shaders and their
//! f64 twins have the same names.

pub(crate) mod arithmetic;
mod binning;
mod block_cache;
pub mod definition;
pub mod filter;
mod frame;
#[cfg(feature = "inspection")]
pub mod inspection;
mod jacobian;
mod kernels;
pub(crate) mod levels;
mod light;
pub mod probe;
mod radix;
mod renderer;
mod scene;
mod sight;
mod splat_buffers;
mod stages;
mod tile_sums;
#[cfg(feature = "training")]
pub mod training;
mod window;
mod workspace;

pub use block_cache::{BlockReader, SetAside, SpawnReader};
pub use frame::to_byte;
pub use jacobian::Jacobian;
pub use kernels::{FilterKernels, Kernels, PipelineKey, SceneKernels};
pub use levels::NormalEquations;
pub use light::{Cell, Correction, FlatField, counts};
pub use radix::SortPrecision;
pub use renderer::{Job, Plan, Renderer, SearchCommands, Searched};
pub use scene::Scene;
pub(crate) use tile_sums::TileSums;
pub use window::Residency;
pub(crate) use window::WindowRoom;
