//! Lossy WebP through libwebp, less the bytes that a packet's header repeats.
//!
//! A lossy WebP file without extras is one VP8 key frame in a RIFF container (RFC 9649, section
//! 2.5; RFC 6386, section 9.1):
//!
//! | bytes | content | in the payload |
//! |---|---|---|
//! | 0–19 | `RIFF`, size, `WEBP`, `VP8 `, size | no |
//! | 20–22 | frame tag: key frame, version, length of the first partition | yes |
//! | 23–25 | start code 9D 01 2A | no |
//! | 26–29 | width and height, 14 bits each, scale 0 | no |
//! | 30–… | partitions, a zero after an odd number of bytes | yes, less one last zero |

mod encoder;

use nvsprior::Picture;
use nvsprior::residual::max_payload_len;

use crate::error::WebpError;
use crate::libwebp::{Arena, Lossy, decode_rgb, encode_rgb, features};
pub use encoder::{Coded, WebpEncoder};

/// Bytes of the container, and of the frame tag after it.
const CONTAINER_LEN: usize = 20;
const TAG_LEN: usize = 3;
const START_CODE: [u8; 3] = [0x9D, 0x01, 0x2A];
/// Libwebp's slowest and best search.
const METHOD: u8 = 6;

/// A difference picture by WebP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Payload<'a> {
    /// It is a whole WebP file, not one without what a packet says anyway.
    pub whole: bool,
    /// Its bytes.
    pub bytes: &'a [u8],
}

/// Libwebp with all the memory that pictures of one size need.
pub struct Webp {
    arena: Arena,
    /// The file last coded, or the one being decoded.
    file: Vec<u8>,
    /// What a decoder would make of a payload.
    rebuilt: Vec<u8>,
}

impl Webp {
    /// Makes one for pictures of a size. Larger pictures work too, but cost allocations.
    pub fn new(width: u32, height: u32) -> Webp {
        let file = || Vec::with_capacity(max_payload_len(width, height) + CONTAINER_LEN + 8);
        let arena = Arena::with_capacity(arena_len(width, height));
        Webp { arena, file: file(), rebuilt: file() }
    }

    /// A picture as a WebP file, at a quality of 0 to 100 with 1 to 4 segments.
    pub fn encode_file(
        &mut self,
        picture: &Picture,
        quality: f32,
        segments: u8,
    ) -> Result<&[u8], WebpError> {
        check_shape(picture)?;
        let Picture { width, height, ref data } = *picture;
        let how = Lossy { quality, method: METHOD, segments };
        encode_rgb(data, width, height, how, &mut self.arena, &mut self.file)
            .map_err(WebpError::Encode)?;
        Ok(&self.file)
    }

    /// Decodes a lossy WebP file of the size of `into`. Refuses others before anything is decoded.
    pub fn decode_file(&mut self, file: &[u8], into: &mut Picture) -> Result<(), WebpError> {
        check_shape(into)?;
        check_file(file, into)?;
        decode_rgb(file, into.width, &mut into.data, &mut self.arena)
            .ok_or(WebpError::Payload("damaged VP8 frame"))
    }

    /// Codes a picture, into `payload`, at a quality of 0 to 100. Returns whether that is a whole file.
    pub(crate) fn encode(
        &mut self,
        picture: &Picture,
        quality: f32,
        payload: &mut Vec<u8>,
    ) -> Result<bool, WebpError> {
        // One segment: more of them spend bits on errors that an eye would see, not on the largest errors
        // (docs/decisions.md, 4).
        self.encode_file(picture, quality, 1)?;
        payload.clear();
        let (width, height) = (picture.width, picture.height);
        if strip(&self.file, width, height, payload, &mut self.rebuilt).is_none() {
            payload.clear();
            payload.extend_from_slice(&self.file);
            return Ok(true);
        }
        Ok(false)
    }

    /// Decodes a payload of [`WebpEncoder`] into a difference picture of its size.
    ///
    /// # Errors
    /// If it is no picture of that size.
    pub fn decode(&mut self, payload: Payload, into: &mut Picture) -> Result<(), WebpError> {
        let Payload { whole, bytes: payload } = payload;
        if whole {
            return self.decode_file(payload, into);
        }
        let mut file = std::mem::take(&mut self.rebuilt);
        let decoded = match rebuild(payload, into.width, into.height, &mut file) {
            Some(()) => self.decode_file(&file, into),
            None => Err(NO_FRAME),
        };
        self.rebuilt = file;
        decoded
    }
}

const NO_FRAME: WebpError =
    WebpError::Payload("shorter than a VP8 frame tag, or beyond a RIFF file");

/// More bytes than libwebp takes to code or decode a picture. On noise at quality 100 it takes up
/// to 33 bytes per pixel and another 180 KB (see the test).
fn arena_len(width: u32, height: u32) -> usize {
    48 * (width as usize).next_multiple_of(16) * (height as usize).next_multiple_of(16) + (1 << 19)
}

/// Checks that a picture has as many bytes as its size asks for.
fn check_shape(picture: &Picture) -> Result<(), WebpError> {
    let Picture { width, height, ref data } = *picture;
    let bytes = data.len();
    match bytes > 0 && bytes == width as usize * height as usize * 3 {
        true => Ok(()),
        false => Err(WebpError::Shape { width, height, bytes }),
    }
}

/// Refuses a file that is not a plain lossy picture of the size of `into`.
fn check_file(file: &[u8], into: &Picture) -> Result<(), WebpError> {
    let features = features(file).ok_or(WebpError::Payload("not a WebP picture"))?;
    let (expected, found) = ((into.width, into.height), (features.width, features.height));
    if found != expected {
        return Err(WebpError::Size { expected, found });
    }
    if !features.plain_lossy {
        return Err(WebpError::Payload("not a plain lossy WebP picture"));
    }
    Ok(())
}

/// Writes what [`rebuild`] needs to make this very file again; `None` if it could not.
fn strip(
    file: &[u8],
    width: u32,
    height: u32,
    payload: &mut Vec<u8>,
    rebuilt: &mut Vec<u8>,
) -> Option<()> {
    let tag = file.get(CONTAINER_LEN..CONTAINER_LEN + TAG_LEN)?;
    let partitions = file.get(CONTAINER_LEN + TAG_LEN + START_CODE.len() + 4..)?;
    payload.extend_from_slice(tag);
    payload.extend_from_slice(partitions.strip_suffix(&[0]).unwrap_or(partitions));
    rebuild(payload, width, height, rebuilt)?;
    (rebuilt == file).then_some(())
}

/// Writes the WebP file around a payload. `None` if no such file can have this payload or this size.
fn rebuild(payload: &[u8], width: u32, height: u32, file: &mut Vec<u8>) -> Option<()> {
    let (tag, partitions) = payload.split_at_checked(TAG_LEN)?;
    let side = |v: u32| u16::try_from(v).ok().filter(|v| *v < 1 << 14).map(u16::to_le_bytes);
    let frame_len = payload.len().checked_add(START_CODE.len() + 4)?;
    let padding = frame_len % 2;
    let chunk_len = u32::try_from(frame_len + padding).ok()?;
    let riff_len = chunk_len.checked_add(12)?;
    file.clear();
    file.extend_from_slice(b"RIFF");
    file.extend_from_slice(&riff_len.to_le_bytes());
    file.extend_from_slice(b"WEBPVP8 ");
    file.extend_from_slice(&chunk_len.to_le_bytes());
    file.extend_from_slice(tag);
    file.extend_from_slice(&START_CODE);
    file.extend_from_slice(&side(width)?);
    file.extend_from_slice(&side(height)?);
    file.extend_from_slice(partitions);
    if padding > 0 {
        file.push(0);
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sample(width: u32, height: u32) -> Picture {
        let mut picture = Picture::new(width, height);
        for (i, v) in picture.data.iter_mut().enumerate() {
            *v = (128 + (i * i / 97) % 61) as u8;
        }
        picture
    }

    fn coded(picture: &Picture, quality: f32) -> Vec<u8> {
        let mut payload = Vec::new();
        let mut webp = Webp::new(picture.width, picture.height);
        assert_eq!(webp.encode(picture, quality, &mut payload), Ok(false));
        payload
    }

    fn rebuilt(payload: &[u8], width: u32, height: u32) -> Vec<u8> {
        let mut file = Vec::new();
        rebuild(payload, width, height, &mut file).unwrap();
        file
    }

    fn decode(
        whole: bool,
        payload: &[u8],
        (width, height): (u32, u32),
    ) -> Result<Picture, WebpError> {
        let mut picture = Picture::new(width, height);
        Webp::new(width, height)
            .decode(Payload { whole, bytes: payload }, &mut picture)
            .map(|()| picture)
    }

    #[test]
    fn stripping_saves_27_bytes_and_loses_nothing() {
        for (width, height) in [(1, 1), (17, 33), (64, 48)] {
            for quality in [0.0, 3.5, 20.0, 50.0, 75.0, 100.0] {
                let picture = sample(width, height);
                let payload = coded(&picture, quality);
                let file = rebuilt(&payload, width, height);
                assert!(payload.len() + 27 <= file.len());
                let mut webp = Webp::new(width, height);
                assert_eq!(webp.encode_file(&picture, quality, 1).unwrap(), file);
                let ours = decode(false, &payload, (width, height)).unwrap();
                assert_eq!(decode(true, &file, (width, height)), Ok(ours));
            }
        }
    }

    #[test]
    fn other_shapes_are_kept_whole() {
        let file = rebuilt(&coded(&sample(17, 33), 50.0), 17, 33);
        let strip = |file: &[u8], height| strip(file, 17, height, &mut Vec::new(), &mut Vec::new());
        assert_eq!(strip(&file, 33), Some(()));
        assert_eq!(strip(&file, 32), None);
        for index in [0, 4, 8, 12, 16, 23, 26, 29] {
            let mut other = file.clone();
            other[index] ^= 0x40;
            assert_eq!(strip(&other, 33), None, "byte {index}");
        }
        assert_eq!(strip(&file[..25], 33), None);
    }

    #[test]
    fn refuses_pictures_of_another_size_or_kind() {
        let picture = sample(16, 16);
        let payload = coded(&picture, 50.0);
        let file = rebuilt(&payload, 16, 16);
        let size = WebpError::Size { expected: (32, 16), found: (16, 16) };
        assert_eq!(decode(true, &file, (32, 16)), Err(size));
        let image = image::RgbImage::from_raw(16, 16, picture.data.clone()).unwrap();
        let mut lossless = std::io::Cursor::new(Vec::new());
        image.write_to(&mut lossless, image::ImageFormat::WebP).unwrap();
        let kind = decode(true, lossless.get_ref(), (16, 16));
        assert_eq!(kind, Err(WebpError::Payload("not a plain lossy WebP picture")));
        assert_eq!(decode(false, &[1, 2], (16, 16)), Err(NO_FRAME));
        let mut webp = Webp::new(16, 16);
        let mut encode = |picture: &Picture| webp.encode(picture, 50.0, &mut Vec::new());
        assert!(encode(&Picture::new(0, 4)).is_err());
        assert!(encode(&Picture { width: 9, ..picture }).is_err());
    }

    #[test]
    fn libwebp_never_leaves_its_arena() {
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        for (width, height) in [(1, 1), (3, 700), (700, 3), (320, 180), (640, 360)] {
            let mut picture = Picture::new(width, height);
            picture.data.fill_with(&mut noise);
            let mut webp = Webp::new(width, height);
            let mut payload = Vec::with_capacity(max_payload_len(width, height));
            let before = [payload.capacity(), webp.file.capacity(), webp.rebuilt.capacity()];
            for quality in [0.0, 30.0, 100.0] {
                let whole = webp.encode(&picture, quality, &mut payload).unwrap();
                webp.decode(Payload { whole, bytes: &payload }, &mut Picture::new(width, height))
                    .unwrap();
            }
            let (peak, room) = (webp.arena.peak(), arena_len(width, height));
            assert!(peak > 0 && peak * 5 < room * 4, "{width}×{height}: {peak} of {room}");
            assert_eq!(webp.arena.spilled(), 0);
            let after = [payload.capacity(), webp.file.capacity(), webp.rebuilt.capacity()];
            assert_eq!(before, after, "{width}×{height}: {}", payload.len());
        }
    }

    proptest! {
        #[test]
        fn arbitrary_payloads_never_panic(
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
            tag in any::<bool>(),
        ) {
            let _ = decode(true, &bytes, (16, 16));
            // A plausible frame tag lets the rest reach the decoder's inner loops.
            let start: &[u8] = if tag { &[0x90, 0x01, 0x00] } else { &[] };
            let payload = [start, &bytes[..]].concat();
            let _ = decode(false, &payload, (16, 16));
        }

        #[test]
        fn damaged_payloads_give_a_picture_of_the_size_or_an_error(
            damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        ) {
            let mut payload = coded(&sample(40, 24), 60.0);
            for (index, value) in damage {
                let index = index.index(payload.len());
                payload[index] = value;
            }
            if let Ok(picture) = decode(false, &payload, (40, 24)) {
                prop_assert_eq!((picture.width, picture.height), (40, 24));
            }
        }
    }
}
