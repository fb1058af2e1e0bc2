//! Niantic's SPZ files, versions 2 to 4, as the scenes' own `.ply` files have them.
//!
//! A header, then streams: positions (24-bit fixed point), opacities, colours, scales, rotations
//! (three bytes x, y, z in version 2; the smallest three of four, ten bits each, from 3 on) and
//! spherical harmonics. Up to version 3 all of it is one gzip stream; version 4 has a plain header of
//! 32 bytes, a table of sizes, and a Zstandard frame for each stream.
//!
//! SPZ has y up and z backwards, Inria's PLY files have y down and z forwards: both axes are flipped here, with
//! rotations and spherical harmonics; other axes, if the extension `SPZ_ADOBE_coordinate_system` states them. Other
//! extensions and flags are left out, with a warning. Render options are [`RenderOptions::INRIA`], anti-aliased if the
//! file says so.

use std::io::Read;

use flate2::read::MultiGzDecoder;
use ruzstd::decoding::StreamingDecoder;

use nvsprior::prior::{
    Field, FieldUse, PriorError, PriorFile, PriorFormat, PriorWarning, Splats, passed_over,
};
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

/// Flags: trained anti-aliased, and extensions follow.
const ANTIALIASED: u8 = 1;
const EXTENSIONS: u8 = 2;

/// The extension that states the axes of a file's values.
const COORDINATES: u32 = 0xadbe_0001;

/// What is done with the extensions, by their types.
pub const FIELDS: [Field; 2] = [
    ("adbe0001", FieldUse::Read),     // SPZ_ADOBE_coordinate_system
    ("adbe0002", FieldUse::Harmless), // SPZ_ADOBE_safe_orbit_camera
];

/// Most bytes of extensions that are read.
const MAX_EXTENSIONS: u64 = 1 << 20;

/// Reads an SPZ file. Memory grows with what its streams hold: at most 1032 times the content's size.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    if !MAGICS.iter().any(|magic| bytes.starts_with(magic)) {
        return Err(PriorError::UnknownFormat);
    }
    let (header, streams, records) = match bytes.starts_with(MAGICS[0]) {
        true => inflate(bytes)?,
        false => decompress(bytes)?,
    };
    let (axes, warnings) = header.extensions(&records)?;
    let antialiased = header.flags & ANTIALIASED != 0;
    let options = RenderOptions { antialiased, ..RenderOptions::INRIA };
    let format = PriorFormat::Foreign("SPZ", Some(header.version));
    let file = PriorFile::new(header.splats(&streams, axes), options, format);
    Ok(PriorFile { warnings, near_by_size: true, ..file })
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

    /// The axes of the file's values, and warnings of what is left out. `records`: the extensions, each its type, its
    /// length and its content.
    fn extensions(&self, records: &[u8]) -> Result<(Axes, Vec<PriorWarning>), PriorError> {
        let (mut axes, mut names, mut rest) = (Axes::RUB, Vec::new(), records);
        let word = |bytes: &[u8]| u32::from_le_bytes(std::array::from_fn(|i| bytes[i]));
        while let Some((head, behind)) = rest.split_at_checked(8) {
            let (kind, length) = (word(head), word(&head[4..]) as usize);
            let Some((content, behind)) = behind.split_at_checked(length) else {
                return Err(refusal(
                    0,
                    format!("extension {kind:08x} of {length} bytes is cut off"),
                ));
            };
            match (kind, length) {
                (COORDINATES, 4) => axes = Axes::of(word(content))?,
                _ => names.push(format!("{kind:08x}")),
            }
            rest = behind;
        }
        let flags = self.flags & !(ANTIALIASED | EXTENSIONS);
        let bits = (0..8).filter(|bit| flags >> bit & 1 != 0).map(|bit| bit.to_string());
        let bits: Vec<String> = bits.collect();
        let mut warnings = passed_over("SPZ extension", names.iter().map(String::as_str), &FIELDS);
        warnings.extend(passed_over("SPZ flag", bits.iter().map(String::as_str), &[]));
        Ok((axes, warnings))
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
    fn splats(&self, streams: &[u8], axes: Axes) -> Splats {
        let mut at = 0;
        let [positions, opacities, colours, scales, rotations, sh] = self.sizes().map(|size| {
            at += size;
            &streams[at - size..at]
        });
        let [_, _, _, _, rotation_width, sh_width] = self.widths();
        let mut splats = Splats::with_capacity(self.count, self.sh_degree);
        splats.positions.extend(positions.chunks_exact(9).map(|b| axes.vector(self.position(b))));
        splats.opacity_logits.extend(opacities.iter().map(|b| logit(f64::from(*b) / 255.0)));
        let scale = |b: &u8| f32::from(*b) / 16.0 - 10.0;
        splats.log_scales.extend(scales.as_chunks::<3>().0.iter().map(|b| b.each_ref().map(scale)));
        splats
            .rotations
            .extend(rotations.chunks_exact(rotation_width).map(|b| axes.rotation(rotation(b))));
        let signs = axes.sh_signs();
        for (index, colour) in colours.chunks_exact(3).enumerate() {
            let constant = |b: &u8| ((f64::from(*b) / 255.0 - 0.5) / COLOUR_SCALE) as f32;
            splats.sh.extend(colour.iter().map(constant));
            let rest = &sh[index * sh_width..(index + 1) * sh_width];
            let signs = signs.iter().flat_map(|sign| [sign; 3]);
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
        [axis(0) as f32, axis(3) as f32, axis(6) as f32]
    }
}

/// The signs by which values of a file's axes become those of right, down, forwards.
#[derive(Clone, Copy)]
struct Axes([f32; 3]);

impl Axes {
    /// Right, up, backwards: those of a file that states none.
    const RUB: Axes = Axes([1.0, -1.0, -1.0]);

    /// Those of the extension: 1 to 8 are left or right, down or up, backwards or forwards, in this order of bits.
    fn of(code: u32) -> Result<Axes, PriorError> {
        match code {
            0 => Ok(Axes::RUB),
            1..=8 => {
                let bit = |bit: u32| (code - 1) >> bit & 1 != 0;
                let sign = |same: bool| if same { 1.0 } else { -1.0 };
                Ok(Axes([sign(bit(0)), sign(!bit(1)), sign(bit(2))]))
            }
            _ => Err(refusal(
                0,
                format!(
                    "coordinate system {code}, with y and z exchanged, is not read here: save it as RUB"
                ),
            )),
        }
    }

    fn vector(self, v: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| v[i] * self.0[i])
    }

    /// A rotation's axis turns round where an odd number of axes is flipped.
    fn rotation(self, [w, a, b, c]: [f32; 4]) -> [f32; 4] {
        let [x, y, z] = self.0;
        [w, a * (y * z), b * (x * z), c * (x * y)]
    }

    /// Of the spherical harmonics from degree 1 on.
    #[rustfmt::skip]
    fn sh_signs(self) -> [f32; 15] {
        let [x, y, z] = self.0;
        [
            y, z, x,
            x * y, y * z, 1.0, x * z, 1.0,
            y, x * y * z, y, z, x, z, x,
        ]
    }
}

/// The logit of an opacity: infinite at 0 and 1.
pub(super) fn logit(opacity: f64) -> f32 {
    libm::log(opacity / (1.0 - opacity)) as f32
}

/// A quaternion (w, x, y, z), in the file's axes, of three or four bytes.
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
    [q[3], q[0], q[1], q[2]].map(|v| v as f32)
}

/// Versions 2 and 3: header, streams and extensions from gzip.
fn inflate(bytes: &[u8]) -> Result<(Header, Vec<u8>, Vec<u8>), PriorError> {
    let mut decoder = MultiGzDecoder::new(bytes);
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
    let mut behind = Vec::new();
    decoder.take(MAX_EXTENSIONS).read_to_end(&mut behind).map_err(broken)?;
    if header.flags & EXTENSIONS == 0 {
        behind.clear();
    }
    Ok((header, streams, behind))
}

/// Version 4: header, streams and extensions.
fn decompress(bytes: &[u8]) -> Result<(Header, Vec<u8>, Vec<u8>), PriorError> {
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
    // They lie between header and table.
    let behind = if header.flags & EXTENSIONS == 0 { LONG_HEADER } else { table };
    Ok((header, streams, bytes[LONG_HEADER..behind].to_vec()))
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
