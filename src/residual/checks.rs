//! Checks of pictures before they are coded.

use crate::Picture;

use super::ResidualError;

/// Checks that a picture is whole and has a width and height, pixels.
pub(super) fn check_size(expected: (u32, u32), picture: &Picture) -> Result<(), ResidualError> {
    let found = (picture.width, picture.height);
    if expected != found {
        return Err(ResidualError::Size { expected, found });
    }
    check_shape(picture)
}

/// Checks that a picture has as many bytes as its size asks for.
pub(super) fn check_shape(picture: &Picture) -> Result<(), ResidualError> {
    let Picture { width, height, ref data } = *picture;
    let bytes = data.len();
    if bytes > 0 && bytes == width as usize * height as usize * 3 {
        Ok(())
    } else {
        Err(ResidualError::Shape { width, height, bytes })
    }
}
