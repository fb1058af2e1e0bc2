//! Niantic's SPZ files, versions 2 to 4, as the scenes' own `.ply` files have them.
//!
//! A header, then streams: positions (24-bit fixed point), opacities, colours, scales, rotations
//! (three bytes x, y, z in version 2; the smallest three of four, ten bits each, from 3 on) and
//! spherical harmonics. Up to version 3 all of it is one gzip stream; version 4 has a plain header of
//! 32 bytes, a table of sizes, and a Zstandard frame for each stream.
//!
//! SPZ has y up and z backwards, Inria's PLY files have y down and z forwards: both axes are flipped here, with
//! rotations and spherical harmonics. Render options are [`RenderOptions::INRIA`], anti-aliased if the file says so.
//! Extensions are ignored; the report's comments say if there are any.

use std::io::Read;

use flate2::read::GzDecoder;
use ruzstd::decoding::StreamingDecoder;

use nvsprior::prior::{PriorError, PriorFile, PriorFormat, Splats};
use nvsprior::{Prior, RenderOptions};

/// How SPZ files start: as gzip up to version 3, with the format's own mark in version 4.
pub const MAGICS: [&[u8]; 2] = [&[0x1f, 0x8b], b"NGSP"];

/// Most bytes that a byte of the file may stand for: what gzip can reach.
const MAX_EXPANSION: u128 = 1032;

/// Bytes of the header up to version 3, and those that version 4 begins with.
const HEADER: usize = 16;

/// Bytes of version 4's header, and of an entry in its table of streams.
const LONG_HEADER: usize = 32;
const ENTRY: usize = 16;

/// Size of a step of colours, in units of the constant coefficient.
const COLOUR_SCALE: f64 = 0.15;

/// Which spherical harmonics change their sign if y and z do. The constant one does not.
#[rustfmt::skip]
const SH_SIGNS: [f32; 15] = [
    -1.0, -1.0, 1.0,
    -1.0, 1.0, 1.0, -1.0, 1.0,
    -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0,
];

/// Reads an SPZ file. Memory grows with what its streams hold: at most 1032 times the content's size.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    if !MAGICS.iter().any(|magic| bytes.starts_with(magic)) {
        return Err(PriorError::UnknownFormat);
    }
    let (header, streams) = match bytes.starts_with(MAGICS[0]) {
        true => inflate(bytes)?,
        false => decompress(bytes)?,
    };
    let antialiased = header.flags & 1 != 0;
    let comments = match header.flags & 2 {
        0 => Vec::new(),
        _ => vec!["SPZ extensions, ignored".into()],
    };
    let options = RenderOptions { antialiased, ..RenderOptions::INRIA };
    let format = PriorFormat::Foreign("SPZ", Some(header.version));
    Ok(PriorFile { comments, ..PriorFile::new(header.splats(&streams), options, format) })
}

struct Header {
    version: u32,
    count: usize,
    sh_degree: u32,
    fraction_bits: u8,
    flags: u8,
}

impl Header {
    /// Reads the header, and checks that a file of `found` bytes can hold what it promises.
    fn read(bytes: &[u8; HEADER], found: usize) -> Result<Header, PriorError> {
        let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        if bytes[..4] != *MAGICS[1] {
            return Err(PriorError::UnknownFormat);
        }
        let (version, count) = (word(4), word(8) as usize);
        if !(2..=4).contains(&version) {
            return Err(refusal(4, format!("version {version}: 2, 3 and 4 are known")));
        }
        if count == 0 {
            return Err(PriorError::Empty);
        }
        if count > Prior::MAX_SPLATS {
            return Err(PriorError::TooMany { count });
        }
        let sh_degree = u32::from(bytes[12]);
        if sh_degree > Splats::MAX_SH_DEGREE {
            return Err(PriorError::ShDegree { degree: sh_degree });
        }
        if bytes[13] > 24 {
            return Err(refusal(13, format!("{} bits of fraction", bytes[13])));
        }
        let header =
            Header { version, count, sh_degree, fraction_bits: bytes[13], flags: bytes[14] };
        let needed = (header.sizes().iter().sum::<usize>() as u128).div_ceil(MAX_EXPANSION);
        match needed > found as u128 {
            true => Err(PriorError::Truncated { needed, found }),
            false => Ok(header),
        }
    }

    /// Bytes of a splat in each stream.
    fn widths(&self) -> [usize; 6] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        [9, 1, 3, 3, rotation, 3 * ((self.sh_degree as usize + 1).pow(2) - 1)]
    }

    fn sizes(&self) -> [usize; 6] {
        self.widths().map(|width| self.count * width)
    }

    /// The splats in all streams, one after the other.
    fn splats(&self, streams: &[u8]) -> Splats {
        let mut at = 0;
        let [positions, opacities, colours, scales, rotations, sh] = self.sizes().map(|size| {
            at += size;
            &streams[at - size..at]
        });
        let [_, _, _, _, rotation_width, sh_width] = self.widths();
        let mut splats = Splats::with_capacity(self.count, self.sh_degree);
        splats.positions.extend(positions.chunks_exact(9).map(|b| self.position(b)));
        splats.opacity_logits.extend(opacities.iter().map(|b| logit(f64::from(*b) / 255.0)));
        let scale = |b: &u8| f32::from(*b) / 16.0 - 10.0;
        splats.log_scales.extend(scales.as_chunks::<3>().0.iter().map(|b| b.each_ref().map(scale)));
        splats.rotations.extend(rotations.chunks_exact(rotation_width).map(rotation));
        for (index, colour) in colours.chunks_exact(3).enumerate() {
            let constant = |b: &u8| ((f64::from(*b) / 255.0 - 0.5) / COLOUR_SCALE) as f32;
            splats.sh.extend(colour.iter().map(constant));
            let rest = &sh[index * sh_width..(index + 1) * sh_width];
            let signs = SH_SIGNS.iter().flat_map(|sign| [sign; 3]);
            let value = |(b, sign): (&u8, &f32)| sign * (f32::from(*b) - 128.0) / 128.0;
            splats.sh.extend(rest.iter().zip(signs).map(value));
        }
        splats
    }

    fn position(&self, bytes: &[u8]) -> [f32; 3] {
        let step = 1.0 / f64::from(1_u32 << self.fraction_bits);
        let axis = |at: usize| {
            let top = [0, bytes[at], bytes[at + 1], bytes[at + 2]];
            f64::from(i32::from_le_bytes(top) >> 8) * step
        };
        [axis(0) as f32, -axis(3) as f32, -axis(6) as f32]
    }
}

/// The logit of an opacity: infinite at 0 and 1.
pub(super) fn logit(opacity: f64) -> f32 {
    libm::log(opacity / (1.0 - opacity)) as f32
}

/// A quaternion (w, x, y, z) of three or four bytes.
fn rotation(bytes: &[u8]) -> [f32; 4] {
    // x, y, z, w.
    let mut q = [0.0; 4];
    let rest = |q: [f64; 4]| (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    if let [x, y, z] = bytes {
        for (value, byte) in q.iter_mut().zip([x, y, z]) {
            *value = f64::from(*byte) / 127.5 - 1.0;
        }
        q[3] = rest(q);
    } else {
        let mut packed = u32::from_le_bytes(std::array::from_fn(|i| bytes[i]));
        let largest = (packed >> 30) as usize;
        for place in (0..4).rev().filter(|place| *place != largest) {
            let magnitude = f64::from(packed & 511) / 511.0 * std::f64::consts::FRAC_1_SQRT_2;
            q[place] = if packed & 512 == 0 { magnitude } else { -magnitude };
            packed >>= 10;
        }
        q[largest] = rest(q);
    }
    [q[3], q[0], -q[1], -q[2]].map(|v| v as f32)
}

/// Versions 2 and 3: header and streams from gzip. What follows the streams is ignored.
fn inflate(bytes: &[u8]) -> Result<(Header, Vec<u8>), PriorError> {
    let mut decoder = GzDecoder::new(bytes);
    let mut first = [0; HEADER];
    let broken = |e: std::io::Error| refusal(0, format!("gzip: {e}"));
    decoder.read_exact(&mut first).map_err(broken)?;
    let header = Header::read(&first, bytes.len())?;
    if header.version > 3 {
        return Err(refusal(4, format!("version {} within gzip", header.version)));
    }
    let size = header.sizes().iter().sum::<usize>();
    let mut streams = Vec::new();
    decoder.by_ref().take(size as u64).read_to_end(&mut streams).map_err(broken)?;
    if streams.len() < size {
        return Err(refusal(0, format!("gzip holds {} bytes of {size}", streams.len())));
    }
    // At the end of the stream its check is seen to.
    decoder.read(&mut [0]).map_err(broken)?;
    Ok((header, streams))
}

/// Version 4: header, table and streams.
fn decompress(bytes: &[u8]) -> Result<(Header, Vec<u8>), PriorError> {
    let truncated = |needed: u128| PriorError::Truncated { needed, found: bytes.len() };
    let first = bytes.first_chunk().ok_or_else(|| truncated(LONG_HEADER as u128))?;
    let header = Header::read(first, bytes.len())?;
    if header.version != 4 {
        return Err(refusal(4, format!("version {} without gzip", header.version)));
    }
    let long: &[u8; LONG_HEADER] =
        bytes.first_chunk().ok_or_else(|| truncated(LONG_HEADER as u128))?;
    let table = u32::from_le_bytes(std::array::from_fn(|i| long[16 + i])) as usize;
    let sizes = header.sizes();
    let expected = sizes.iter().filter(|size| **size > 0).count();
    if usize::from(long[15]) != expected || table < LONG_HEADER {
        return Err(refusal(15, format!("{} streams after byte {table}", long[15])));
    }
    let mut at = table as u64 + (expected * ENTRY) as u64;
    let entries = bytes.get(table..at as usize).ok_or_else(|| truncated(at.into()))?;
    let mut streams = Vec::new();
    for (entry, size) in entries.chunks_exact(ENTRY).zip(sizes) {
        let word = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i]));
        let end = at.saturating_add(word(0));
        let frame = bytes.get(at as usize..end.min(usize::MAX as u64) as usize);
        let frame = frame.ok_or_else(|| truncated(end.into()))?;
        if word(8) != size as u64 {
            return Err(refusal(at, format!("a stream of {} bytes, not {size}", word(8))));
        }
        unpack(frame, size, at, &mut streams)?;
        at = end;
    }
    Ok((header, streams))
}

/// Appends the `size` bytes of a Zstandard frame, which stands at byte `at` of the file.
fn unpack(frame: &[u8], size: usize, at: u64, streams: &mut Vec<u8>) -> Result<(), PriorError> {
    let decoder = StreamingDecoder::new(frame).map_err(|e| refusal(at, e.to_string()))?;
    let before = streams.len();
    let read = decoder.take(size as u64 + 1).read_to_end(streams);
    read.map_err(|e| refusal(at, e.to_string()))?;
    match streams.len() - before == size {
        true => Ok(()),
        false => Err(refusal(at, format!("a frame of other than {size} bytes"))),
    }
}

fn refusal(offset: u64, reason: String) -> PriorError {
    PriorError::Field { format: "SPZ", offset, reason }
}

#[cfg(test)]
mod tests;
