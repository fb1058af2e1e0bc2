//! Images of any size and format to 8-bit RGB of one size.

use super::ImageView;
use super::axis::{Axis, WEIGHT_BITS};
use super::colour::{Matrix, SAMPLE_BITS};
use super::view::Plane;
use crate::Picture;

/// Makes pictures of one size from images of any.
///
/// Planes are scaled before colours are converted, chroma at its own resolution. Buffers of less than 2 MiB are kept,
/// for pictures of up to 4096 pixels.
pub(super) struct Scaler {
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

impl Scaler {
    /// Makes one for pictures of this size, of at least one pixel.
    pub fn new(width: u32, height: u32) -> Scaler {
        let components = std::array::from_fn(|_| vec![0; width as usize]);
        let (axes, sums, line) = Default::default();
        Scaler { width, height, axes, sums, line, components }
    }

    /// Takes all memory that images of this size need, in any format.
    pub fn prepare(&mut self, width: u32, height: u32) {
        for (pixels, [x, y]) in (1..).zip(&mut self.axes) {
            x.fit(width, pixels, self.width);
            y.fit(height, pixels, self.height);
        }
        // The longest row has four bytes per pixel.
        self.sums.reserve(4 * width as usize);
        self.line.reserve(4 * width as usize);
    }

    /// Width and height of its pictures, pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Makes `into` a picture of the image, which was checked.
    pub fn scale_image(&mut self, image: &ImageView, into: &mut Picture) {
        self.fit(image);
        into.resize(self.width, self.height);
        let row_len = self.width as usize * 3;
        let planes = image.format.planes();
        let matrix = (planes.len() > 1).then(|| Matrix::new(image.colour));
        for (y, row) in into.data.chunks_exact_mut(row_len).enumerate() {
            for ((plane, stride), bytes) in planes.iter().zip(image.strides).zip(image.planes) {
                self.scale(plane, bytes, stride, image.width, y);
            }
            self.write(matrix.as_ref(), row);
        }
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
