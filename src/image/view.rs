//! Images as cameras deliver them.

use super::error::PixelError;
use super::pixel_format::PixelFormat;

/// What Y, U and V mean: matrix and range. RGB formats have no use for it.
///
/// Limited range is Y in 16..=235, U and V in 16..=240; full range is 0..=255 for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colour {
    /// BT.601, limited range: V4L2's default for cameras.
    #[default]
    Bt601Limited,
    /// BT.601, full range, as in JPEG.
    Bt601Full,
    /// BT.709, limited range, as in HD video.
    Bt709Limited,
    /// BT.709, full range.
    Bt709Full,
}

/// A plane of a format.
#[doc(hidden)]
pub struct Plane {
    pub name: &'static str,
    /// Bytes from a sample to the next.
    pub step: usize,
    /// Pixels a sample, along either axis.
    pub pixels: u32,
    /// For each byte of a sample, which of the colour's three components it is.
    pub components: &'static [usize],
}

const RGB: [Plane; 1] = [Plane { name: "RGB", step: 3, pixels: 1, components: &[0, 1, 2] }];
const BGR: [Plane; 1] = [Plane { name: "BGR", step: 3, pixels: 1, components: &[2, 1, 0] }];
const RGBA: [Plane; 1] = [Plane { name: "RGBA", step: 4, pixels: 1, components: &[0, 1, 2] }];
const NV12: [Plane; 2] = [
    Plane { name: "Y", step: 1, pixels: 1, components: &[0] },
    Plane { name: "UV", step: 2, pixels: 2, components: &[1, 2] },
];
const I420: [Plane; 3] = [
    Plane { name: "Y", step: 1, pixels: 1, components: &[0] },
    Plane { name: "U", step: 1, pixels: 2, components: &[1] },
    Plane { name: "V", step: 1, pixels: 2, components: &[2] },
];

impl PixelFormat {
    /// Its planes, first to last.
    #[doc(hidden)]
    pub fn planes(self) -> &'static [Plane] {
        match self {
            PixelFormat::Rgb8 => &RGB,
            PixelFormat::Bgr8 => &BGR,
            PixelFormat::Rgba8 => &RGBA,
            PixelFormat::Nv12 => &NV12,
            PixelFormat::I420 => &I420,
        }
    }
}

impl Plane {
    /// Width and height in samples.
    pub fn size(&self, width: u32, height: u32) -> (u32, u32) {
        (width.div_ceil(self.pixels), height.div_ceil(self.pixels))
    }

    /// Refuses a stride that is too small and planes whose bytes end before the last row does.
    pub fn check(
        &self,
        (width, height): (u32, u32),
        stride: usize,
        found: usize,
    ) -> Result<(), PixelError> {
        let plane = self.name;
        let (columns, rows) = self.size(width, height);
        let row = columns as usize * self.step;
        if stride < row {
            return Err(PixelError::Stride { plane, needed: row, found: stride });
        }
        // Saturated, it is beyond any slice.
        let needed = stride.saturating_mul(rows as usize - 1).saturating_add(row);
        if found < needed {
            return Err(PixelError::TooShort { plane, needed, found });
        }
        Ok(())
    }
}

/// The one plane of a gray picture, such as a mask's.
pub(super) const GRAY: Plane = Plane { name: "gray", step: 1, pixels: 1, components: &[0] };

/// Refuses sides of zero or above `max`.
pub(super) fn check_size(width: u32, height: u32, max: u32) -> Result<(), PixelError> {
    if (1..=max).contains(&width) && (1..=max).contains(&height) {
        Ok(())
    } else {
        Err(PixelError::Size { width, height, max })
    }
}

/// An image in somebody else's memory.
#[derive(Clone, Copy, Debug)]
pub struct ImageView<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// How the bytes are laid out.
    pub format: PixelFormat,
    /// What Y, U and V mean.
    pub colour: Colour,
    /// The format's planes, top row first; other planes are ignored. The last row may end before
    /// its stride does.
    pub planes: [&'a [u8]; 3],
    /// Bytes from a row of each plane to the next.
    pub strides: [usize; 3],
}

impl<'a> ImageView<'a> {
    /// Longest side, pixels.
    pub const MAX_SIDE: u32 = 16384;

    /// An image of one plane.
    pub fn packed(
        width: u32,
        height: u32,
        format: PixelFormat,
        bytes: &'a [u8],
        stride: usize,
    ) -> ImageView<'a> {
        let (planes, strides) = ([bytes, &[], &[]], [stride, 0, 0]);
        ImageView { width, height, format, colour: Colour::default(), planes, strides }
    }

    /// Refuses sides of zero or above [`ImageView::MAX_SIDE`], strides shorter than a row, and planes
    /// that end before their last row does.
    pub fn check(&self) -> Result<(), PixelError> {
        check_size(self.width, self.height, Self::MAX_SIDE)?;
        let planes = self.format.planes().iter().zip(self.strides).zip(self.planes);
        for ((plane, stride), bytes) in planes {
            plane.check((self.width, self.height), stride, bytes.len())?;
        }
        Ok(())
    }
}
