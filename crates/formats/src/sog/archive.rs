//! Files and pictures in a SOG archive.

use std::io::{Cursor, Read};

use image_webp::WebPDecoder;
use zip::ZipArchive;

use super::meta::refusal;
use nvsprior::prior::PriorError;

/// How ZIP archives start.
pub const MAGIC: &[u8] = b"PK\x03\x04";

/// Most bytes of a file that a byte of the archive may stand for. Pictures are compressed already.
const MAX_EXPANSION: u64 = 64;

/// Most pixels that are no splat: as many as there are splats, and so many more.
const SPARE_PIXELS: usize = 1 << 16;

/// An archive in memory.
pub struct Archive<'a> {
    zip: ZipArchive<Cursor<&'a [u8]>>,
    /// Most bytes that a file in it may have.
    limit: u64,
}

/// A picture.
pub struct Pixels {
    data: Vec<u8>,
    channels: usize,
}

impl<'a> Archive<'a> {
    pub fn open(bytes: &'a [u8]) -> Result<Archive<'a>, PriorError> {
        let zip = ZipArchive::new(Cursor::new(bytes));
        let zip = zip.map_err(|e| refusal(format!("archive: {e}")))?;
        Ok(Archive { zip, limit: bytes.len() as u64 * MAX_EXPANSION })
    }

    /// The content of a file.
    pub fn file(&mut self, name: &str) -> Result<Vec<u8>, PriorError> {
        let mut content = Vec::new();
        let file = self.zip.by_name(name).map_err(|e| refusal(format!("{name}: {e}")))?;
        let read = file.take(self.limit + 1).read_to_end(&mut content);
        read.map_err(|e| refusal(format!("{name}: {e}")))?;
        match content.len() as u64 > self.limit {
            true => Err(refusal(format!("{name}: more than {} bytes", self.limit))),
            false => Ok(content),
        }
    }

    /// A picture with a pixel for each of `count` splats.
    pub fn per_splat(&mut self, name: &str, count: usize) -> Result<Pixels, PriorError> {
        self.picture(name, |width, height| {
            (count..=2 * count + SPARE_PIXELS).contains(&(width * height))
        })
    }

    /// A lossless WebP picture, if it has a size, width and height in pixels, that fits.
    pub fn picture(
        &mut self,
        name: &str,
        fits: impl Fn(usize, usize) -> bool,
    ) -> Result<Pixels, PriorError> {
        let content = self.file(name)?;
        let wrong = |reason: String| refusal(format!("{name}: {reason}"));
        let mut decoder =
            WebPDecoder::new(Cursor::new(content)).map_err(|e| wrong(e.to_string()))?;
        let (width, height) = decoder.dimensions();
        if !fits(width as usize, height as usize) {
            return Err(wrong(format!("{width}×{height} pixels do not fit what meta.json says")));
        }
        if decoder.is_animated() || decoder.is_lossy() {
            return Err(wrong("no lossless picture, so its values are lost".into()));
        }
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let mut data = vec![0; width as usize * height as usize * channels];
        decoder.read_image(&mut data).map_err(|e| wrong(e.to_string()))?;
        Ok(Pixels { data, channels })
    }
}

impl Pixels {
    /// Red, green, blue and alpha of a pixel, row by row.
    pub fn at(&self, index: usize) -> [u8; 4] {
        let pixel = &self.data[index * self.channels..][..self.channels];
        [pixel[0], pixel[1], pixel[2], pixel.get(3).copied().unwrap_or(255)]
    }

    /// The first `count` pixels.
    pub fn first(&self, count: usize) -> impl Iterator<Item = [u8; 4]> {
        (0..count).map(|index| self.at(index))
    }
}
