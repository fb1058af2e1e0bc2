//! Coded streams, cut into the units of their pictures.

use anyhow::ensure;

use nvsprior_inputs::ffmpeg;

/// A coded stream: what all pictures need, and the unit of each picture.
#[derive(Debug, PartialEq)]
pub struct Units {
    /// Parameter sets, sequence headers.
    pub header: Vec<u8>,
    pub pictures: Vec<Vec<u8>>,
}

/// Types of HEVC units that hold a slice lie below this.
const HEVC_SLICES: u8 = 32;

/// An HEVC stream with one slice in each picture. The start codes stay.
pub fn of_hevc(stream: &[u8]) -> Units {
    let mut starts: Vec<_> = ffmpeg::start_codes(stream).collect();
    starts.push((stream.len(), 0));
    let mut units = Units { header: Vec::new(), pictures: Vec::new() };
    for ends in starts.windows(2) {
        let [(from, code), (to, _)] = [ends[0], ends[1]];
        let unit = &stream[from..to];
        let Some(first) = unit.get(code) else { continue };
        if first >> 1 & 0x3F < HEVC_SLICES {
            units.pictures.push(unit.to_vec());
        } else if units.pictures.is_empty() {
            units.header.extend(unit);
        }
    }
    units
}

const SEQUENCE_HEADER: u8 = 1;
const TEMPORAL_DELIMITER: u8 = 2;

/// An AV1 stream: each temporal unit is a picture. Delimiters and sequence headers count as what all pictures need.
pub fn of_av1(mut stream: &[u8]) -> anyhow::Result<Units> {
    let mut units = Units { header: Vec::new(), pictures: Vec::new() };
    while let Some(first) = stream.first() {
        let kind = first >> 3 & 0xF;
        ensure!(first & 2 != 0, "an AV1 unit without its size");
        let mut at = if first & 4 != 0 { 2 } else { 1 };
        let mut size = 0_usize;
        for place in 0..8 {
            let byte = *stream.get(at).unwrap_or(&0);
            at += 1;
            size |= usize::from(byte & 0x7F) << (7 * place);
            if byte & 0x80 == 0 {
                break;
            }
        }
        ensure!(at + size <= stream.len(), "an AV1 unit that is cut");
        let (unit, rest) = stream.split_at(at + size);
        stream = rest;
        match kind {
            TEMPORAL_DELIMITER => units.pictures.push(Vec::new()),
            SEQUENCE_HEADER => {
                if units.header.is_empty() {
                    units.header.extend(unit);
                }
            }
            _ => match units.pictures.last_mut() {
                Some(picture) => picture.extend(unit),
                None => anyhow::bail!("an AV1 picture before the first delimiter"),
            },
        }
    }
    Ok(units)
}

/// Milliseconds between two pictures of [`to_ivf`].
pub const APART: usize = 1000;

/// An AV1 stream of some pictures, each with its number, in an IVF file.
pub fn to_ivf<'a>(
    header: &[u8],
    size: (u32, u32),
    pictures: impl ExactSizeIterator<Item = (usize, &'a [u8])>,
) -> Vec<u8> {
    let delimiter = [TEMPORAL_DELIMITER << 3 | 2, 0];
    let mut file = b"DKIF\0\0\x20\0AV01".to_vec();
    let (width, height, count) = (size.0 as u16, size.1 as u16, pictures.len() as u32);
    file.extend([width.to_le_bytes(), height.to_le_bytes()].concat());
    file.extend([1000_u32, 1, count, 0].map(u32::to_le_bytes).concat());
    for (k, (number, picture)) in pictures.enumerate() {
        let header = if k == 0 { header } else { &[] };
        let len = (delimiter.len() + header.len() + picture.len()) as u32;
        file.extend(len.to_le_bytes());
        file.extend(((number * APART) as u64).to_le_bytes());
        file.extend([&delimiter, header, picture].concat());
    }
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hevc_is_cut_at_its_slices() {
        let (parameters, slice) = (32 << 1, 1 << 1);
        let stream = [0, 0, 0, 1, parameters, 7, 0, 0, 1, slice, 8, 9, 0, 0, 0, 1, slice, 5];
        let units = of_hevc(&stream);
        assert_eq!(units.header, [0, 0, 0, 1, parameters, 7]);
        assert_eq!(units.pictures, [vec![0, 0, 1, slice, 8, 9], vec![0, 0, 0, 1, slice, 5]]);
    }

    #[test]
    fn av1_is_cut_at_its_delimiters() {
        let frame = |byte| vec![6 << 3 | 2, 1, byte];
        let header = [SEQUENCE_HEADER << 3 | 2, 2, 4, 4];
        let pictures = [frame(1), frame(2)];
        let delimiter = [TEMPORAL_DELIMITER << 3 | 2, 0];
        let parts = [&delimiter[..], &header, &pictures[0], &delimiter, &pictures[1]];
        let stream = parts.concat();
        let units = of_av1(&stream).unwrap();
        assert_eq!((units.header, &units.pictures[..]), (header.to_vec(), &pictures[..]));
        assert!(of_av1(&stream[..stream.len() - 1]).is_err());
    }

    #[test]
    fn ivf_says_when_each_picture_is() {
        let pictures = [(0, &[7, 8][..]), (3, &[9])];
        let file = to_ivf(&[5], (320, 180), pictures.into_iter());
        assert_eq!(file.len(), 32 + 12 + 5 + 12 + 3);
        assert_eq!(&file[32..44], [5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(&file[44..49], [0x12, 0, 5, 7, 8]);
        assert_eq!(&file[49..61], [3, 0, 0, 0, 0xB8, 0xB, 0, 0, 0, 0, 0, 0]);
    }
}
