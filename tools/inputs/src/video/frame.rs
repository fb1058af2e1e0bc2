//! A decoded frame: I420 with the strides of the program that decoded it.

use nvsprior::Picture;
use nvsprior::image::{Converter, ImageView, PixelError, PixelFormat};

use super::decoder::Decoder;
use super::matroska::Header;

/// How the bytes of a frame lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    pub header: Header,
    pub(super) strides: [usize; 3],
    /// Where each plane begins, and where the last one ends.
    pub(super) planes: [usize; 4],
}

impl Layout {
    pub fn of(decoder: Decoder, header: Header) -> Layout {
        // GStreamer's default: rows of a multiple of four bytes, planes of an even number of rows.
        let (unit, pair) = match decoder {
            Decoder::Gstreamer => (4, 2),
            Decoder::Ffmpeg => (1, 1),
        };
        let [width, height] = [header.width, header.height].map(|side| side as usize);
        let luma = width.next_multiple_of(unit);
        let chroma = width.div_ceil(2).next_multiple_of(unit);
        let first = luma * height.next_multiple_of(pair);
        let each = chroma * height.div_ceil(2);
        let planes = [0, first, first + each, first + 2 * each];
        Layout { header, strides: [luma, chroma, chroma], planes }
    }

    /// Bytes of a frame.
    pub fn bytes(&self) -> usize {
        self.planes[3]
    }
}

/// A frame of a video.
#[derive(Clone, Debug)]
pub struct VideoFrame {
    /// All frames of the video count, from 0.
    pub index: usize,
    /// Its time stamp, seconds.
    pub time: f64,
    pub(super) layout: Layout,
    pub(super) data: Vec<u8>,
}

impl VideoFrame {
    pub fn size(&self) -> (u32, u32) {
        (self.layout.header.width, self.layout.header.height)
    }

    pub fn view(&self) -> ImageView<'_> {
        let Layout { header, strides, planes } = self.layout;
        let plane = |i: usize| &self.data[planes[i]..planes[i + 1]];
        ImageView {
            width: header.width,
            height: header.height,
            format: PixelFormat::I420,
            colour: header.colour,
            planes: [plane(0), plane(1), plane(2)],
            strides,
        }
    }

    /// Its brightness, row by row without gaps.
    pub fn luma(&self) -> Vec<u8> {
        let (width, height) = self.size();
        let rows = self.data.chunks(self.layout.strides[0]).take(height as usize);
        rows.flat_map(|row| &row[..width as usize]).copied().collect()
    }
}

/// A frame's picture in RGB, at its own size.
pub fn rgb(converter: &mut Converter, frame: &VideoFrame) -> Result<Picture, PixelError> {
    let (width, height) = frame.size();
    let mut picture = Picture::new(width, height);
    converter.convert(&frame.view(), &mut picture)?;
    Ok(picture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nvsprior::image::Colour;

    fn layout(decoder: Decoder, width: u32, height: u32) -> Layout {
        let colour = Colour::Bt601Full;
        Layout::of(decoder, Header { colour, ..Header::of_size(width, height) })
    }

    /// As the programs wrote frames of these sizes.
    #[test]
    fn frames_have_the_bytes_that_the_programs_write() {
        for (width, height, gstreamer, ffmpeg) in
            [(427, 240, 154_560, 153_840), (322, 182, 88_816, 87_906), (320, 180, 86_400, 86_400)]
        {
            assert_eq!(layout(Decoder::Gstreamer, width, height).bytes(), gstreamer);
            assert_eq!(layout(Decoder::Ffmpeg, width, height).bytes(), ffmpeg);
        }
    }

    #[test]
    fn odd_frames_become_pictures() {
        for decoder in [Decoder::Gstreamer, Decoder::Ffmpeg] {
            let layout = layout(decoder, 5, 3);
            let mut data = vec![128; layout.bytes()];
            for y in 0..3 {
                data[y * layout.strides[0]..][..5].fill(10 * y as u8);
            }
            let frame = VideoFrame { index: 0, time: 0.0, layout, data };
            let picture = rgb(&mut Converter::new(5, 3).unwrap(), &frame).unwrap();
            let expected: Vec<u8> = (0..3).flat_map(|y| [10 * y; 15]).collect();
            assert_eq!(picture.data, expected);
            assert_eq!(frame.luma().len(), 15);
        }
    }
}
