//! The lens that an encoder's frames were taken through, and the mask of what counts of them.

use std::sync::Arc;

use nvsprior::Error;
use nvsprior::geometry::{Distortion, Intrinsics, Lens};
use nvsprior::image::Mask;
use nvsprior::residual::Interest;

use super::encoding::nvsp_encoder;
use super::slices::slice;
use super::status::*;
use super::structs::{In, versioned};

/// Brown-Conrady, OpenCV's usual model. `coefficients` in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, of which the
/// first 4, the first 5 or all 8 are given.
pub const NVSP_LENS_BROWN_CONRADY: u32 = 1;
/// Kannala-Brandt, as in OpenCV's module `fisheye`. `coefficients`: k1, k2, k3, k4.
pub const NVSP_LENS_FISHEYE: u32 = 2;

/// A lens with distortion, as OpenCV's calibration gives it. Pixel (0, 0) covers [0, 1) x [0, 1). OpenCV's own
/// calibration puts pixel centres at integers: add 0.5 to its cx and cy.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_lens {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_LENS_*.
    pub model: u32,
    /// How many of `coefficients` are given; the others are zero.
    pub count: u32,
    /// Width of the images, pixels, 1 to 16384.
    pub width: u32,
    /// Height of the images, pixels, 1 to 16384.
    pub height: u32,
    /// Focal length along x, pixels of the images.
    pub fx: f64,
    /// Focal length along y, pixels of the images.
    pub fy: f64,
    /// Principal point, x, pixels from the left edge of the images. It must lie on them.
    pub cx: f64,
    /// Principal point, y, pixels from the upper edge of the images. It must lie on them.
    pub cy: f64,
    /// The distortion, without unit; see `model`.
    pub coefficients: [f64; 8],
}
versioned!(nvsp_lens, 120);

/// Which pixels of an encoder's images count: one byte per pixel, white counts (128 to 255), black does not (0 to 127).
/// Read during the call only.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_mask {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Pixels, 1 to 16384. With a lens its width; without one of the camera's shape (1 % is tolerated).
    pub width: u32,
    /// Pixels, 1 to 16384; as `width`.
    pub height: u32,
    /// First byte, of the upper left pixel.
    pub pixels: *const u8,
    /// Bytes from one row to the next.
    pub stride: usize,
    /// Bytes in all. Nothing beyond them is read.
    pub size: usize,
}
versioned!(nvsp_mask, 40);

/// Sets the lens that all images from here on were taken through. Each image is freed of its distortion as it is read,
/// in the pass that scales it: the encoder's camera stays a pinhole, and packets are about that one. Images must then
/// have the lens's size. The camera may see more than the lens: pixels that the lens does not show count as masked, see
/// nvsp_encoder_set_mask. A pixel is the mean of what its footprint on the image covers: the image is first reduced by
/// area averaging to about the camera's resolution, then sampled with linear interpolation, at most one reduced pixel
/// apart. All of it is integer arithmetic on a map that is made here, so that an image yields the same picture on every
/// machine. Allocates the map, at most 4 bytes per pixel of the lens and 48 per pixel of the camera; no frame allocates
/// for it. If the call fails, the lens before stays. Example:
///
/// ```c
/// nvsp_lens lens = NVSP_INITIALIZER(nvsp_lens);
/// lens.model = NVSP_LENS_BROWN_CONRADY;
/// lens.width = 1920;
/// lens.height = 1080;
/// lens.fx = 1335.4, lens.fy = 1334.9, lens.cx = 962.5, lens.cy = 538.1;
/// lens.count = 5; /* k1, k2, p1, p2, k3 */
/// memcpy(lens.coefficients, calibration, 5 * sizeof(double));
/// status = nvsp_encoder_set_lens(encoder, &lens);
/// ```
///
/// Fails with NVSP_ERR_MEMORY or NVSP_ERR_ARGUMENT: the text names the field, or the corner of the image that has no
/// ray, as the distortion folds the image over itself nearer to its middle. It is also given if camera and lens see
/// nothing in common, or if a mask is set that has not the lens's size: take the mask away first.
///
/// # Parameters
/// - `lens`: the lens; NULL: no lens from here on, images are of a pinhole camera.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_set_lens(
    encoder: Option<&nvsp_encoder>,
    lens: In<nvsp_lens>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let lens = lens.optional()?.map(|lens| checked(&lens)).transpose()?;
        let mut core = content.core()?;
        core.see(|seen| seen.lens = lens)?;
        Ok(NVSP_OK)
    })
}

/// Sets which pixels of all images from here on count. Mask what shows the vehicle itself: its arm, its frame, a lamp.
/// Masked pixels count neither in the search for the pose nor in nvsp_frame_stats, and no bytes are spent on them: the
/// topside shows the prior's render there. A coarse coding may change it a little beside pixels that count. The mask
/// may change from frame to frame, as the arm moves. With a lens, it masks pixels of the lens's images. If the camera's
/// size changes, the mask is scaled; a pixel counts if all that it shows counts. Allocates two bytes per pixel of the
/// mask and 48 per pixel of the camera. If the call fails, the mask before stays. Example:
///
/// ```c
/// nvsp_mask mask = NVSP_INITIALIZER(nvsp_mask);
/// mask.width = mask.stride = 640;
/// mask.height = 360;
/// mask.pixels = arm; /* 0 for a pixel of the arm, else 255 */
/// mask.size = 640 * 360;
/// status = nvsp_encoder_set_mask(encoder, &mask);
/// ```
///
/// Fails with NVSP_ERR_IMAGE (size, stride or bytes), NVSP_ERR_MEMORY, or NVSP_ERR_ARGUMENT if its size is not the
/// lens's, its shape not the camera's, or no pixel counts.
///
/// # Parameters
/// - `mask`: which pixels count; NULL: all pixels count.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_set_mask(
    encoder: Option<&nvsp_encoder>,
    mask: In<nvsp_mask>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let mut core = content.core()?;
        let Some(mask) = mask.optional()? else {
            core.see(|seen| seen.mask = None)?;
            return Ok(NVSP_OK);
        };
        let nvsp_mask { width, height, pixels, stride, size, .. } = mask;
        // SAFETY: so many bytes stand there, as the header asks of these fields.
        let bytes = unsafe { slice(pixels, size, "nvsp_mask.pixels")? };
        let mask = {
            let _memory = core.limits.mask(width, height)?;
            Mask::from_gray(width, height, bytes, stride)?
        };
        core.see(|seen| seen.mask = Some(Arc::new(mask)))?;
        Ok(NVSP_OK)
    })
}

/// Sets which parts of the picture get more of the bytes from here on: what the pilot looks at. `weights` has `columns`
/// times `rows` values from 1 to 255, row by row, laid over the picture in cells of equal size. An error in a cell of
/// weight 8 counts eight times as much as one in a cell of weight 1. At the same budget the other parts get fewer
/// bytes; NVSP_RATE_PSNR stays that of the whole picture. The topside needs to know nothing of it. It may change from
/// frame to frame, as the pilot's cursor moves. Allocates a byte per cell. If the call fails,
/// the weights before stay. Example:
///
/// ```c
/// uint8_t weights[9] = {1, 1, 1, 1, 8, 1, 1, 1, 1}; /* the middle ninth */
/// status = nvsp_encoder_set_interest(encoder, 3, 3, weights, sizeof weights);
/// ```
///
/// Fails with NVSP_ERR_MEMORY, or NVSP_ERR_ARGUMENT if a side has no cells or more than 4096, `size` is not columns
/// times rows, or a weight is 0.
///
/// # Safety
/// - `weights`: their values. NULL, with sides and size of 0: all parts count the same.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_encoder_set_interest(
    encoder: Option<&nvsp_encoder>,
    columns: u32,
    rows: u32,
    weights: *const u8,
    size: usize,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let mut core = content.core()?;
        if weights.is_null() && (columns, rows, size) == (0, 0, 0) {
            core.encoder.set_interest(None);
            return Ok(NVSP_OK);
        }
        // SAFETY: `size` bytes stand at `weights`, see `# Safety`.
        let bytes = unsafe { slice(weights, size, "weights")? };
        let interest = {
            let _memory = core.limits.mask(columns, rows)?;
            Interest::map(columns, rows, bytes)
        };
        let wrong = |_| {
            let what =
                "weights: columns and rows of 1 to 4096, as many weights as cells, none of them 0";
            Failure::argument(what)
        };
        core.encoder.set_interest(Some(interest.map_err(wrong)?));
        Ok(NVSP_OK)
    })
}

/// The lens that a caller states.
fn checked(lens: &nvsp_lens) -> Result<Lens, Failure> {
    let nvsp_lens { model, count, width, height, fx, fy, cx, cy, coefficients, .. } = *lens;
    let max = nvsprior::image::ImageView::MAX_SIDE;
    if !(1..=max).contains(&width) || !(1..=max).contains(&height) {
        return Err(Failure::argument("nvsp_lens.width, height: must lie in 1 to 16384"));
    }
    let fits = match model {
        NVSP_LENS_BROWN_CONRADY => [4, 5, 8].contains(&count),
        NVSP_LENS_FISHEYE => count == 4,
        _ => return Err(Failure::argument("nvsp_lens.model")),
    };
    if !fits {
        let what = "nvsp_lens.count: 4, 5 or 8 for Brown-Conrady, 4 for a fisheye";
        return Err(Failure::argument(what));
    }
    let (given, rest) = coefficients.split_at(count as usize);
    if rest.iter().any(|value| *value != 0.0) {
        return Err(Failure::argument("nvsp_lens.coefficients: not zero beyond `count`"));
    }
    let distortion = match model {
        NVSP_LENS_FISHEYE => Distortion::Fisheye([given[0], given[1], given[2], given[3]]),
        _ => Distortion::brown(given).map_err(Error::from)?,
    };
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
    Ok(Lens::new(intrinsics, distortion).map_err(Error::from)?)
}
