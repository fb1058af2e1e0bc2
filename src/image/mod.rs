//! Pictures, and images in the pixel formats of cameras and screens.
//!
//! A [`Converter`] turns a camera's image, of any format and size, into an encoder's [`Picture`], and frees it of its
//! lens's distortion. A [`Mask`] says which of its pixels count.
//! A [`Preprocessor`] treats pictures of dark scenes: white balance and CLAHE. [`write_picture`] writes
//! a decoded picture in the format of whoever shows it. All of it is integer arithmetic: an image
//! gives the same picture, and so the same packet, on every CPU.

mod axis;
mod colour;
mod colour_order;
mod convert;
mod error;
mod mask;
mod picture;
mod pixel_format;
mod preprocessing;
mod scaler;
mod undistortion;
mod view;
mod write;

#[cfg(feature = "encode")]
pub(crate) use colour_order::ColourOrder;
pub use convert::Converter;
pub use error::PixelError;
pub use mask::Mask;
pub use picture::{Picture, psnr_of_mse};
pub use pixel_format::PixelFormat;
pub use preprocessing::{Clahe, Preprocessing, PreprocessingError, Preprocessor, WhiteBalance};
pub use view::{Colour, ImageView};
pub use write::write_picture;

#[cfg(test)]
mod tests;
