//! The two pose Jacobians.

/// Which pose Jacobian the normal equations are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Jacobian {
    /// Optical flow of each pixel's own ray. A search takes as many renders as with the exact Jacobian and ends at the
    /// same error.
    Flow,
    /// Derivatives of exactly what is drawn: means, covariances, colours.
    Exact,
}
