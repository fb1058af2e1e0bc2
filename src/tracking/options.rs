//! Options of the refinement.

use super::gauss_newton::GaussNewtonOptions;
use crate::render::{Jacobian, SortPrecision};

/// Options of the refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineOptions {
    /// The Jacobian.
    pub jacobian: Jacobian,
    /// How finely Gauss–Newton's evaluations tell depths apart. Final pictures are always exact.
    pub sort_precision: SortPrecision,
    /// Options of Gauss–Newton.
    pub gauss_newton: GaussNewtonOptions,
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
            jacobian: Jacobian::Flow,
            sort_precision: SortPrecision::default(),
            gauss_newton: GaussNewtonOptions::default(),
            lost_renders: 96,
            masks: true,
        }
    }
}
