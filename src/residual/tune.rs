//! What the encoder holds for a good picture.

/// What counts when bits are given to one part of a difference picture and taken from another. What decodes them needs
/// to know nothing of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Tune {
    /// All squared errors count alike.
    #[default]
    Psnr = 0,
    /// An error counts less where the picture has much texture, which hides it (SSIM, Wang et al. 2004), and errors of
    /// colour count half.
    Ssim = 1,
    /// An error counts more where the prior is far from the picture: a new thing shows first.
    Detection = 2,
}
