//! Decoding, of whole files and of the beginnings of files.

use std::ffi::c_int;
use std::mem::MaybeUninit;

use libwebp_sys as sys;

use super::Arena;

/// What a file's header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Features {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// One lossy picture without alpha: what [`super::encode_rgb`] makes.
    pub plain_lossy: bool,
}

/// Format of a lossy picture in libwebp's features.
const LOSSY: c_int = 1;

/// Reads the header of a file; `None` if it is no WebP file.
pub fn features(file: &[u8]) -> Option<Features> {
    let mut found = MaybeUninit::zeroed();
    // SAFETY: pointer and length are those of a slice; the structure is plain numbers.
    let (status, found) = unsafe {
        let status = sys::WebPGetFeatures(file.as_ptr(), file.len(), found.as_mut_ptr());
        (status, found.assume_init())
    };
    if status != sys::VP8StatusCode::VP8_STATUS_OK {
        return None;
    }
    Some(Features {
        width: u32::try_from(found.width).ok()?,
        height: u32::try_from(found.height).ok()?,
        plain_lossy: found.format == LOSSY && found.has_alpha == 0 && found.has_animation == 0,
    })
}

/// Decodes a file of pixels of the given width into `rgb`, without padding; `None` if it is
/// damaged, or its rows do not fill `rgb` exactly.
pub fn decode_rgb(file: &[u8], width: u32, rgb: &mut [u8], arena: &mut Arena) -> Option<()> {
    let stride = c_int::try_from(width).ok()?.checked_mul(3)?;
    // SAFETY: pointers and lengths are those of slices; libwebp refuses a picture that does not fit.
    let decoded = arena.lend(|| unsafe {
        sys::WebPDecodeRGBInto(file.as_ptr(), file.len(), rgb.as_mut_ptr(), rgb.len(), stride)
    });
    (!decoded.is_null()).then_some(())
}
