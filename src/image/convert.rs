//! A camera's image to the encoder's picture.

use super::axis::{Axis, WEIGHT_BITS};
use super::colour::{Matrix, SAMPLE_BITS};
use super::view::{Plane, check_size};
use super::{ImageView, PixelError};
use crate::{Camera, Picture};

/// Makes pictures of one size from images of any.
///
/// Every sample of the result is within one step of the exact value, for images up to 32 times the
/// picture's size. Planes are scaled before colours are converted, chroma at its own resolution.
/// Buffers of less than 2 MiB are kept. Nothing is allocated if the image before had the same size
/// and format and the picture is large enough.
pub struct Converter {
    width: u32,
    height: u32,
    /// For planes of full and of half resolution, one for x and one for y.
    axes: [[Axis; 2]; 2],
    /// Weighted sum of a plane's rows, and the sum with [`SAMPLE_BITS`].
    sums: Vec<u32>,
    line: Vec<u16>,
    /// A row of the picture in three components, with [`SAMPLE_BITS`].
    components: [Vec<u16>; 3],
}

impl Converter {
    /// Makes a converter for pictures of this size, that of the encoder's camera: sides of 1 to
    /// [`Camera::MAX_SIDE`] pixels.
    pub fn new(width: u32, height: u32) -> Result<Converter, PixelError> {
        check_size(width, height, Camera::MAX_SIDE)?;
        let components = std::array::from_fn(|_| vec![0; width as usize]);
        let (axes, sums, line) = Default::default();
        Ok(Converter { width, height, axes, sums, line, components })
    }

    /// Makes `into` a picture of the image, 8-bit RGB. Scales it if its size differs.
    ///
    /// # Errors
    /// If [`ImageView::check`] refuses the image, or its shape is not the picture's (ratios of the
    /// sides more than 1 % apart). The picture is then left as it was.
    pub fn convert(&mut self, image: &ImageView, into: &mut Picture) -> Result<(), PixelError> {
        image.check()?;
        self.check_shape(image)?;
        self.fit(image);
        (into.width, into.height) = (self.width, self.height);
        let row_len = self.width as usize * 3;
        into.data.resize(row_len * self.height as usize, 0);
        let planes = image.format.planes();
        let matrix = (planes.len() > 1).then(|| Matrix::new(image.colour));
        for (y, row) in into.data.chunks_exact_mut(row_len).enumerate() {
            for ((plane, stride), bytes) in planes.iter().zip(image.strides).zip(image.planes) {
                self.scale(plane, bytes, stride, image.width, y);
            }
            self.write(matrix.as_ref(), row);
        }
        Ok(())
    }

    /// Refuses ratios of the sides that are more than 1 % apart: less is the rounding of sizes.
    fn check_shape(&self, image: &ImageView) -> Result<(), PixelError> {
        let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
        let wide = product(image.width, self.height);
        let high = product(image.height, self.width);
        if wide.abs_diff(high) * 100 > high {
            let (expected, found) = ((self.width, self.height), (image.width, image.height));
            return Err(PixelError::Shape { expected, found });
        }
        Ok(())
    }

    /// The weights for an image's size.
    fn fit(&mut self, image: &ImageView) {
        for plane in image.format.planes() {
            let [x, y] = &mut self.axes[plane.pixels as usize - 1];
            x.fit(image.width, plane.pixels, self.width);
            y.fit(image.height, plane.pixels, self.height);
        }
    }

    /// Makes row `y` of a plane's components: scales first down the columns, every byte in the same
    /// way, then along the row.
    fn scale(&mut self, plane: &Plane, bytes: &[u8], stride: usize, width: u32, y: usize) {
        let [along, down] = &self.axes[plane.pixels as usize - 1];
        let row_len = plane.size(width, 1).0 as usize * plane.step;
        let (first, weights) = down.pixel(y);
        let rows = (first..).map(|row| &bytes[row * stride..row * stride + row_len]);
        self.sums.clear();
        self.sums.resize(row_len, 0);
        for (&weight, row) in weights.iter().zip(rows) {
            for (sum, &byte) in self.sums.iter_mut().zip(row) {
                *sum += u32::from(weight) * u32::from(byte);
            }
        }
        self.line.clear();
        self.line.extend(self.sums.iter().map(|&sum| round(sum, WEIGHT_BITS - SAMPLE_BITS)));
        for (offset, &component) in plane.components.iter().enumerate() {
            for (x, to) in self.components[component].iter_mut().enumerate() {
                let (first, weights) = along.pixel(x);
                let samples = &self.line[first * plane.step + offset..];
                let weighted =
                    |(k, &w): (usize, &u16)| u32::from(samples[k * plane.step]) * u32::from(w);
                let sum = weights.iter().enumerate().map(weighted).sum();
                *to = round(sum, WEIGHT_BITS);
            }
        }
    }

    /// Where the buffers lie, and their capacities.
    #[cfg(test)]
    pub(super) fn buffers(&self) -> Vec<(usize, usize)> {
        fn buffer<T>(buffer: &Vec<T>) -> (usize, usize) {
            (buffer.as_ptr() as usize, buffer.capacity())
        }
        let axes = self.axes.iter().flatten().flat_map(Axis::buffers);
        let rows = self.components.iter().map(buffer);
        axes.chain(rows).chain([buffer(&self.sums), buffer(&self.line)]).collect()
    }

    /// Writes a row's components as bytes.
    fn write(&self, matrix: Option<&Matrix>, row: &mut [u8]) {
        let [a, b, c] = &self.components;
        for (((rgb, &a), &b), &c) in row.chunks_exact_mut(3).zip(a).zip(b).zip(c) {
            rgb.copy_from_slice(&match matrix {
                Some(matrix) => matrix.rgb(a, b, c),
                None => [a, b, c].map(|v| round(u32::from(v), SAMPLE_BITS) as u8),
            });
        }
    }
}

/// Rounds to whole numbers. Means of bytes are at most 255, so neither the sum nor the result
/// overflows.
fn round(value: u32, bits: u32) -> u16 {
    ((value + (1 << (bits - 1))) >> bits) as u16
}
