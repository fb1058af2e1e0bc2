//! What the render says about a coefficient.

/// What the render says about a coefficient, features in steps.
#[derive(Clone, Copy)]
pub struct RenderValue {
    /// The render's own coefficient.
    pub own: i32,
    /// The same, times the change of light.
    pub guess: i32,
}
