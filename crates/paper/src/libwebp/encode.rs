//! Lossy encoding.

use std::ffi::c_int;

use libwebp_sys as sys;

use super::Arena;

/// How to code a picture.
#[derive(Clone, Copy, Debug)]
pub struct Lossy {
    /// 0 to 100.
    pub quality: f32,
    /// 0 (fast) to 6 (small).
    pub method: u8,
    /// Groups of macroblocks with quantisers of their own, 1 to 4.
    pub segments: u8,
}

/// Codes `width × height` RGB pixels without padding as a WebP file, which replaces the content of
/// `file`. The error is libwebp's.
///
/// # Panics
/// If `rgb` has not three bytes per pixel.
pub fn encode_rgb(
    rgb: &[u8],
    width: u32,
    height: u32,
    how: Lossy,
    arena: &mut Arena,
    file: &mut Vec<u8>,
) -> Result<(), String> {
    assert_eq!(rgb.len(), width as usize * height as usize * 3, "bytes of the picture");
    let wrong_version = |()| "library of another version".to_owned();
    let mut config = sys::WebPConfig::new().map_err(wrong_version)?;
    config.quality = how.quality;
    config.method = how.method.into();
    config.segments = how.segments.into();
    let mut picture = sys::WebPPicture::new().map_err(wrong_version)?;
    let side = |v: u32| c_int::try_from(v).map_err(|_| format!("{width}×{height} pixels"));
    (picture.width, picture.height) = (side(width)?, side(height)?);
    file.clear();
    picture.writer = Some(append);
    picture.custom_ptr = std::ptr::from_mut(file).cast();
    let done = arena.lend(|| {
        // SAFETY: the picture was initialised; `rgb` has `height` rows of `3 · width` bytes; config
        // and the vector behind `custom_ptr` outlive the calls; the picture is freed before the
        // arena ends.
        unsafe {
            let imported = sys::WebPPictureImportRGB(&mut picture, rgb.as_ptr(), 3 * picture.width);
            let done = imported != 0 && sys::WebPEncode(&config, &mut picture) != 0;
            sys::WebPPictureFree(&mut picture);
            done
        }
    });
    if done { Ok(()) } else { Err(format!("{:?}", picture.error_code)) }
}

unsafe extern "C" fn append(
    data: *const u8,
    count: usize,
    picture: *const sys::WebPPicture,
) -> c_int {
    if count > 0 {
        // SAFETY: libwebp passes `count` bytes, and the picture whose `custom_ptr` is the vector
        // that `encode_rgb` holds borrowed.
        unsafe {
            let file = &mut *(*picture).custom_ptr.cast::<Vec<u8>>();
            file.extend_from_slice(std::slice::from_raw_parts(data, count));
        }
    }
    1
}
