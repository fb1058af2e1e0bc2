//! A picture to the bytes of who shows it.

use super::view::check_size;
use super::{ImageView, PixelError, PixelFormat};
use crate::Picture;

/// Writes a picture as `Rgb8`, `Bgr8` or `Rgba8` (alpha 255), with `stride` bytes from one row to the next. Bytes of
/// `into` between and after the rows stay as they are. `into` may end with the last row's pixels.
///
/// # Errors
/// If a side of the picture is zero or above [`ImageView::MAX_SIDE`], or it has fewer bytes than
/// its size says. If the format is YUV, the stride shorter than a row, or `into` too short. Nothing
/// is written then.
pub fn write_picture(
    picture: &Picture,
    format: PixelFormat,
    stride: usize,
    into: &mut [u8],
) -> Result<(), PixelError> {
    let [plane] = format.planes() else { return Err(PixelError::NotWritten(format)) };
    let size = (picture.width, picture.height);
    check_size(size.0, size.1, ImageView::MAX_SIDE)?;
    plane.check(size, stride, into.len())?;
    let (width, height) = (size.0 as usize, size.1 as usize);
    let needed = width * height * 3;
    let Some(data) = picture.data.get(..needed) else {
        let found = picture.data.len();
        return Err(PixelError::TooShort { plane: "of the picture", needed, found });
    };
    for (from, to) in data.chunks_exact(width * 3).zip(into.chunks_mut(stride)) {
        for (rgb, pixel) in from.chunks_exact(3).zip(to.chunks_exact_mut(plane.step)) {
            pixel.fill(255);
            for (byte, &component) in pixel.iter_mut().zip(plane.components) {
                *byte = rgb[component];
            }
        }
    }
    Ok(())
}
