//! What makes a splat unusable.

use std::fmt;

/// Largest magnitude of a logarithmic scale. Up to this a variance `exp(2 s)` is a normal f32, with
/// room for the products of a covariance.
pub const MAX_LOG_SCALE: f32 = 40.0;

/// Largest magnitude of a spherical harmonic's coefficient: a million times white. Up to this sums of squared colours
/// stay within an f32.
pub const MAX_COEFFICIENT: f32 = 1e6;

/// An infinite opacity logit becomes this, with its sign. Converters of quantised scenes write an
/// opacity of exactly 1 as an infinite logit. At 20 the opacity is 1 to the last bit of an f32.
pub const INFINITE_LOGIT: f32 = 20.0;

/// Shortest quaternion that still names a rotation.
pub(super) const MIN_QUATERNION: f64 = 1e-6;

/// What makes a splat unusable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A parameter is infinite or not a number.
    NonFinite,
    /// The quaternion is shorter than 1e-6.
    Rotation,
    /// A logarithmic scale lies beyond ±[`MAX_LOG_SCALE`].
    Scale,
    /// A coefficient of the spherical harmonics lies beyond ±[`MAX_COEFFICIENT`].
    Colour,
}

impl Fault {
    pub(super) const ALL: [Fault; 4] =
        [Fault::NonFinite, Fault::Rotation, Fault::Scale, Fault::Colour];
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::NonFinite => write!(f, "parameter that is not a finite number"),
            Fault::Rotation => write!(f, "quaternion shorter than {MIN_QUATERNION:e}"),
            Fault::Scale => write!(f, "logarithmic scale beyond ±{MAX_LOG_SCALE}"),
            Fault::Colour => write!(f, "colour coefficient beyond ±{MAX_COEFFICIENT:e}"),
        }
    }
}
