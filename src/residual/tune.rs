//! What the encoder holds for a good picture.

/// What counts when bits are given to one part of a difference picture and taken from another. What decodes them needs
/// to know nothing of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Tune {
    /// All squared errors count alike.
    #[default]
    Psnr = 0,
    /// Texture hides errors (SSIM, Wang et al. 2004): they count less in it. Errors of colour count half.
    Ssim = 1,
    /// Errors count more in parts of the picture that the prior does not show. So a new thing shows first.
    Detection = 2,
}
