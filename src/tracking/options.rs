//! Options of the refinement.

#[cfg(feature = "paper")]
use super::descent::{AdamOptions, BfgsOptions};
use super::gauss_newton::GaussNewtonOptions;
use crate::render::{Jacobian, SortPrecision};

/// Which optimiser refines the pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Optimizer {
    /// Gauss–Newton with Levenberg–Marquardt damping, over the pyramid.
    #[default]
    GaussNewton,
    /// BFGS at full resolution, the paper's choice.
    #[cfg(feature = "paper")]
    Bfgs,
    /// Adam at full resolution.
    #[cfg(feature = "paper")]
    Adam,
    /// Adam until it converges, then BFGS.
    #[cfg(feature = "paper")]
    AdamBfgs,
}

impl Optimizer {
    /// Name in reports and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Optimizer::GaussNewton => "gauss-newton",
            #[cfg(feature = "paper")]
            Optimizer::Bfgs => "bfgs",
            #[cfg(feature = "paper")]
            Optimizer::Adam => "adam",
            #[cfg(feature = "paper")]
            Optimizer::AdamBfgs => "adam-bfgs",
        }
    }
}

/// Options of the refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineOptions {
    /// The optimiser.
    pub optimizer: Optimizer,
    /// Jacobian of Gauss–Newton; the gradient methods always use the exact one.
    pub jacobian: Jacobian,
    /// How finely Gauss–Newton's evaluations tell depths apart. Final pictures are always exact.
    pub sort_precision: SortPrecision,
    /// Options of Gauss–Newton.
    pub gauss_newton: GaussNewtonOptions,
    /// Options of BFGS.
    #[cfg(feature = "paper")]
    pub bfgs: BfgsOptions,
    /// Options of Adam.
    #[cfg(feature = "paper")]
    pub adam: AdamOptions,
    /// Most renders, of any level, that one frame takes beside its first search, the picture that is sent included. The
    /// first search starts from the frame before, or from a hint if there is none. A step that would take more is cut
    /// short or left out, and the next frames go on. A pose whose search was cut short is not certain. 0: no other
    /// search than from the frame before and from a hint, without a bound.
    pub lost_renders: u32,
    /// Whether a fresh search may also mask what does not agree.
    pub masks: bool,
}

impl Default for RefineOptions {
    fn default() -> Self {
        RefineOptions {
            optimizer: Optimizer::default(),
            jacobian: Jacobian::Flow,
            sort_precision: SortPrecision::default(),
            gauss_newton: GaussNewtonOptions::default(),
            #[cfg(feature = "paper")]
            bfgs: BfgsOptions::default(),
            #[cfg(feature = "paper")]
            adam: AdamOptions::default(),
            lost_renders: 96,
            masks: true,
        }
    }
}

impl RefineOptions {
    /// The Jacobian that a refinement with these options asks a renderer for.
    pub fn jacobian(&self) -> Jacobian {
        match self.optimizer {
            Optimizer::GaussNewton => self.jacobian,
            #[cfg(feature = "paper")]
            _ => Jacobian::Exact,
        }
    }
}
