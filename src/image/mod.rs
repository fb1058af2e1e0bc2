//! Pictures, and images in the pixel formats of cameras and screens.
//!
//! A [`Converter`] makes an encoder's [`Picture`] of a camera's image, whatever its
//! format and size; [`write_picture`] lays a decoded picture out for whoever shows it. All of it is
//! integer arithmetic: an image gives the same picture, and so the same packet, on every CPU.

mod axis;
mod colour;
mod convert;
mod error;
mod picture;
mod view;
mod write;

pub use convert::Converter;
pub use error::PixelError;
pub use picture::{Picture, psnr_of_mse};
pub use view::{Colour, ImageView, PixelFormat};
pub use write::write_picture;

#[cfg(test)]
mod tests;
