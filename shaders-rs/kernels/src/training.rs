//! Constants and buffer layouts of training, which the stages and the host share.

use crate::shared::{Outline, Params, sh_coefficients, tiles_between};
#[cfg(target_arch = "spirv")]
use spirv_std::num_traits::Float;

/// First plane of a group of parameters. A plane holds one float per splat.
pub const POSITION: u32 = 0;
/// Natural logarithms of the standard deviations.
pub const LOG_SCALE: u32 = 3;
/// Quaternion (w, x, y, z), of any length but zero.
pub const ROTATION: u32 = 6;
/// Logit of the opacity.
pub const OPACITY: u32 = 10;
/// Spherical harmonics, RGB after RGB.
pub const SH: u32 = 11;

/// Planes of the parameters of a degree.
pub const fn planes(sh_degree: u32) -> u32 {
    SH + 3 * sh_coefficients(sh_degree)
}

/// Sums of a pair of a tile and a splat over the tile's pixels: the gradient by the splat's colour (3), and with `h`,
/// the gradient by log alpha at a pixel, and `(x, y)`, the pixel's offset from the tile's middle: Σ h, Σ h x, Σ h y, Σ
/// h x², Σ h x y, Σ h y².
pub const PAIR_SUMS: u32 = 9;
/// Pairs of floats that hold them.
pub const PAIR_FLOATS: u32 = PAIR_SUMS.div_ceil(2);
/// No pair: the splat touches nothing of the tile, or the tile's pixels were finished before it.
pub const NO_PAIR: u32 = u32::MAX;
/// Floats of a pixel of the loss's gradient: by R, G and B, and their product with the render's colour.
pub const GRADIENT_PIXEL: u32 = 4;
/// A pixel of a frame is a word: red, green and blue, of so many bits each from the lowest on.
pub const FRAME_BITS: u32 = 10;
/// The bits of a channel.
pub const FRAME_MASK: u32 = (1 << FRAME_BITS) - 1;
/// What stands for 1: four times 255, so that 8-bit values are held as they are.
pub const FRAME_ONE: u32 = 4 * 255;
/// Set if the pixel counts. The bits of one that does not are all 0.
pub const FRAME_COUNTS: u32 = 1 << (3 * FRAME_BITS);
/// Half the window of SSIM, pixels.
pub const SSIM_REACH: u32 = 5;
/// Weights of the window of SSIM from its middle on: a Gaussian of 1.5 pixels (Wang et al. 2004).
pub const SSIM_WEIGHTS: [f32; 6] =
    [0.266_011_72, 0.213_005_34, 0.109_360_69, 0.036_000_773, 0.007_598_758, 0.001_028_38];
/// Pixels that an invocation blurs.
pub const RUN: u32 = 8;
/// Invocations of a workgroup that blurs.
pub const RUNS: u32 = 8;
/// Blurred maps of frame and render for SSIM, as pairs of floats: render and frame; the sum of their squares, which is
/// all that SSIM asks of these, and their product.
pub const SSIM_MAPS: u32 = 2;

/// What a training step needs to know beside [`Params`]; written by the host before each submission.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Training {
    /// Coefficients of the spherical harmonics that are there.
    pub sh_coefficients: u32,
    /// Coefficients that are trained.
    pub sh_trained: u32,
    /// Room for slots: see stage `train_slots`.
    pub slot_capacity: u32,
    /// Number of the step: the seed of its noise.
    pub step: u32,
    /// Rates of positions, log scales, rotations, opacity logits, the first coefficient, the others.
    pub rates: [f32; 6],
    /// Adam: what makes its means unbiased, `1/(1 − βⁿ)` for both.
    pub unbias: [f32; 2],
    /// Pull of opacities towards 0, per splat.
    pub opacity_pull: f32,
    /// Pull of standard deviations towards 0, per splat and axis.
    pub scale_pull: f32,
    /// Standard deviation of the noise of positions, in shares of a splat's covariance.
    pub noise: f32,
    /// Share of SSIM in the loss.
    pub ssim: f32,
    /// One over the number of pixels and channels.
    pub per_value: f32,
    /// Errors below it count by their squares (Huber's loss); 0 if none does.
    pub knee: f32,
    /// The first splat that is trained; those before it keep their places in the planes of splats.
    pub first_trained: u32,
    /// How many splats are trained. The planes of parameters are of these alone.
    pub trained: u32,
    /// How many of them, the first ones, are in use.
    pub in_use: u32,
    /// Steps by which parameters are rounded before splats are drawn: those of positions, log scales, rotations (x, y,
    /// z of the unit quaternion), opacity logits, the first coefficient. 0: not rounded. The gradient is that of the
    /// rounded splats.
    pub rounding: [f32; 5],
}

/// Least and greatest logit of an opacity that is rounded, in steps.
pub const ROUNDED_LOGITS: [f32; 2] = [-5.0, 8.0];

/// The nearest multiple of a step; the value itself if the step is 0.
pub fn rounded(value: f32, step: f32) -> f32 {
    if step > 0.0 { (value / step + 0.5).floor() * step } else { value }
}

/// Adam's means fade by these factors per step (Kingma and Ba 2015).
pub const FADING: [f32; 2] = [0.9, 0.999];

/// What the stages of training tell each other and the host. Cleared before each step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct SlotCounters {
    /// Slots that the splats need. May wrap.
    pub slots: u32,
    /// Blocks of 256 of them, each splat's rounded down: tells if the other has wrapped.
    pub blocks: u32,
    /// Splats that have slots.
    pub seen: u32,
    /// Workgroups that take their steps.
    pub groups: [u32; 3],
}

/// Tiles `[x0, y0, x1, y1)` of which a splat may have pairs: all those that stage `bin_emit` lists it for.
pub fn slot_box(params: &Params, outline: &Outline) -> [u32; 4] {
    let [top, bottom] = outline.rows(params);
    let (high, slope) = (1.0 / outline.rise, outline.slope);
    let reach =
        (outline.cut * (outline.width * outline.width + slope * slope * high * high)).sqrt();
    let middle = outline.mean[0];
    let slack = 4e-6 * (middle.abs() + reach);
    let [left, right] =
        tiles_between(middle - reach - slack, middle + reach + slack, params.tiles_x);
    [left, top, right, bottom]
}
