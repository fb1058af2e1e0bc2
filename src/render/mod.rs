//! Rendering the prior on the device: a file per GPU stage, each named as its shader and as its f64
//! twin, holding buffers and dispatch only.

pub(crate) mod bin;
pub(crate) mod derive;
mod kernels;
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
mod view;
mod workspace;

pub use kernels::Kernels;
pub use renderer::{Jacobian, Plan, Renderer, to_byte};
pub use scene::Scene;
pub use view::NormalEquations;
