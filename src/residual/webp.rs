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

use webp::{BitstreamFeatures, BitstreamFormat, Decoder, Encoder, WebPConfig};

use crate::Picture;
use crate::packet::Coder;

use super::{ResidualError, check_shape};

/// Bytes of the container, and of the frame tag after it.
const CONTAINER_LEN: usize = 20;
const TAG_LEN: usize = 3;
const START_CODE: [u8; 3] = [0x9D, 0x01, 0x2A];
/// Libwebp's slowest and best search.
const METHOD: i32 = 6;

/// Codes a picture at a quality of 0 to 100.
pub(super) fn encode(picture: &Picture, quality: f32) -> Result<(Coder, Vec<u8>), ResidualError> {
    check_shape(picture)?;
    let mut config = WebPConfig::new()
        .map_err(|()| ResidualError::Encode("library of another version".to_owned()))?;
    config.quality = quality;
    config.method = METHOD;
    // Segments shift bits to where an eye would see errors, not to where the error is. On the
    // reef's held-out frames one segment takes 12 to 14 % fewer bytes from 30.5 to 32 dB and 7 %
    // fewer at 33 dB than libwebp's four; the smallest payload falls from 307 to 253 bytes.
    config.segments = 1;
    let file = Encoder::from_rgb(&picture.data, picture.width, picture.height)
        .encode_advanced(&config)
        .map_err(|error| ResidualError::Encode(format!("{error:?}")))?;
    Ok(match strip(&file, picture.width, picture.height) {
        Some(payload) => (Coder::Vp8, payload),
        None => (Coder::WebP, file.to_vec()),
    })
}

/// Decodes what [`encode`] made with [`Coder::Vp8`].
pub(super) fn decode_vp8(
    payload: &[u8],
    width: u32,
    height: u32,
) -> Result<Picture, ResidualError> {
    let file = rebuild(payload, width, height)
        .ok_or(ResidualError::Payload("shorter than a VP8 frame tag, or beyond a RIFF file"))?;
    decode_file(&file, width, height)
}

/// Decodes a lossy WebP file of the given size; refuses others before anything is allocated.
pub(super) fn decode_file(file: &[u8], width: u32, height: u32) -> Result<Picture, ResidualError> {
    let features =
        BitstreamFeatures::new(file).ok_or(ResidualError::Payload("not a WebP picture"))?;
    let found = (features.width(), features.height());
    if found != (width, height) {
        return Err(ResidualError::Size { expected: (width, height), found });
    }
    let lossy = matches!(features.format(), Some(BitstreamFormat::Lossy));
    if !lossy || features.has_alpha() || features.has_animation() {
        return Err(ResidualError::Payload("not a plain lossy WebP picture"));
    }
    let image = Decoder::new(file).decode().ok_or(ResidualError::Payload("damaged VP8 frame"))?;
    Picture::from_rgb(width, height, image.to_vec())
        .ok_or(ResidualError::Payload("not an RGB picture"))
}

/// What [`rebuild`] needs to make this very file again; `None` where it could not.
fn strip(file: &[u8], width: u32, height: u32) -> Option<Vec<u8>> {
    let tag = file.get(CONTAINER_LEN..CONTAINER_LEN + TAG_LEN)?;
    let partitions = file.get(CONTAINER_LEN + TAG_LEN + START_CODE.len() + 4..)?;
    let payload = [tag, partitions.strip_suffix(&[0]).unwrap_or(partitions)].concat();
    (rebuild(&payload, width, height).as_deref() == Some(file)).then_some(payload)
}

/// The WebP file around a payload; `None` where the payload or the size cannot be in one.
fn rebuild(payload: &[u8], width: u32, height: u32) -> Option<Vec<u8>> {
    let (tag, partitions) = payload.split_at_checked(TAG_LEN)?;
    let side = |v: u32| u16::try_from(v).ok().filter(|v| *v < 1 << 14).map(u16::to_le_bytes);
    let frame_len = TAG_LEN + START_CODE.len() + 4 + partitions.len();
    let padding = frame_len % 2;
    let chunk_len = u32::try_from(frame_len + padding).ok()?;
    let riff_len = chunk_len.checked_add(12)?;
    let mut file = Vec::with_capacity(CONTAINER_LEN + frame_len + padding);
    file.extend(b"RIFF");
    file.extend(riff_len.to_le_bytes());
    file.extend(b"WEBPVP8 ");
    file.extend(chunk_len.to_le_bytes());
    file.extend(tag);
    file.extend(START_CODE);
    file.extend(side(width)?);
    file.extend(side(height)?);
    file.extend(partitions);
    file.resize(file.len() + padding, 0);
    Some(file)
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

    #[test]
    fn stripping_saves_27_bytes_and_loses_nothing() {
        for (width, height) in [(1, 1), (17, 33), (64, 48)] {
            for quality in [0.0, 3.5, 20.0, 50.0, 75.0, 100.0] {
                let picture = sample(width, height);
                let (coder, payload) = encode(&picture, quality).unwrap();
                assert_eq!(coder, Coder::Vp8);
                let file = rebuild(&payload, width, height).unwrap();
                assert!(payload.len() + 27 <= file.len());
                assert_eq!(strip(&file, width, height).as_ref(), Some(&payload));
                let ours = decode_vp8(&payload, width, height).unwrap();
                assert_eq!(ours.data, *Decoder::new(&file).decode().unwrap());
                assert_eq!(decode_file(&file, width, height), Ok(ours));
            }
        }
    }

    #[test]
    fn other_shapes_are_kept_whole() {
        let (_, payload) = encode(&sample(17, 33), 50.0).unwrap();
        let file = rebuild(&payload, 17, 33).unwrap();
        assert_eq!(strip(&file, 17, 32), None);
        for index in [0, 4, 8, 12, 16, 23, 26, 29] {
            let mut other = file.clone();
            other[index] ^= 0x40;
            assert_eq!(strip(&other, 17, 33), None, "byte {index}");
        }
        assert_eq!(strip(&file[..25], 17, 33), None);
    }

    #[test]
    fn refuses_pictures_of_another_size_or_kind() {
        let picture = sample(16, 16);
        let (_, payload) = encode(&picture, 50.0).unwrap();
        let file = rebuild(&payload, 16, 16).unwrap();
        let size = ResidualError::Size { expected: (32, 16), found: (16, 16) };
        assert_eq!(decode_file(&file, 32, 16), Err(size));
        let lossless = Encoder::from_rgb(&picture.data, 16, 16).encode_lossless();
        assert!(matches!(decode_file(&lossless, 16, 16), Err(ResidualError::Payload(_))));
        let alpha = Encoder::from_rgba(&[99; 1024], 16, 16).encode(50.0);
        assert!(matches!(decode_file(&alpha, 16, 16), Err(ResidualError::Payload(_))));
        assert!(matches!(decode_vp8(&[1, 2], 16, 16), Err(ResidualError::Payload(_))));
        assert!(encode(&Picture::new(0, 4), 50.0).is_err());
        assert!(encode(&Picture { width: 9, ..picture }, 50.0).is_err());
    }

    proptest! {
        #[test]
        fn arbitrary_payloads_never_panic(
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
            tag in any::<bool>(),
        ) {
            let _ = decode_file(&bytes, 16, 16);
            // A plausible frame tag lets the rest reach the decoder's inner loops.
            let start: &[u8] = if tag { &[0x90, 0x01, 0x00] } else { &[] };
            let _ = decode_vp8(&[start, &bytes[..]].concat(), 16, 16);
        }

        #[test]
        fn damaged_payloads_give_a_picture_of_the_size_or_an_error(
            damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        ) {
            let (_, mut payload) = encode(&sample(40, 24), 60.0).unwrap();
            for (index, value) in damage {
                let index = index.index(payload.len());
                payload[index] = value;
            }
            if let Ok(picture) = decode_vp8(&payload, 40, 24) {
                prop_assert_eq!((picture.width, picture.height), (40, 24));
            }
        }
    }
}
