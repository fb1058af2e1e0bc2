//! Rendering the prior on the device. `stages.rs` records the stages of a frame in their order; the shaders and their
//! f64 twins have the same names.

pub(crate) mod arithmetic;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod binning;
mod block_cache;
pub mod definition;
pub mod filter;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod frame;
#[cfg(feature = "inspection")]
pub mod inspection;
mod jacobian;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod kernels;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod levels;
mod light;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod radix;
mod renderer;
mod scene;
mod sight;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod splat_buffers;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod stages;
mod tile_sums;
mod window;
#[doc(hidden)]
#[allow(missing_docs)] // For `crate::parts`.
pub mod workspace;

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
