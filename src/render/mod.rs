//! Rendering the prior on the device: a file per GPU stage, each named as its shader and as its f64
//! twin, holding buffers and dispatch only.

pub(crate) mod bin;
mod binning;
#[cfg(feature = "cli")]
pub mod ceilings;
pub(crate) mod derive;
pub(crate) mod frame;
mod kernels;
mod light;
mod lists;
#[cfg(feature = "reference")]
#[doc(hidden)]
pub mod probe;
pub(crate) mod project;
pub(crate) mod radix;
pub(crate) mod reduce;
mod renderer;
mod scene;
pub(crate) mod splat;
pub(crate) mod view;
mod workspace;

pub use frame::to_byte;
pub use kernels::{Kernels, SceneKernels, Traits};
pub use light::{Cell, Correction, FlatField, counts};
pub use radix::Fineness;
pub use renderer::{Jacobian, Job, Plan, Renderer, Searched};
pub use scene::Scene;
pub use view::NormalEquations;
