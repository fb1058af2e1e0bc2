//! What a prior's file claims to hold, read without taking memory, so that loading it can be refused beforehand.

use super::blocked::Block;
use super::container::Format;
use super::ply_header::header_of;
use super::{Splats, ply};

/// What a file of a prior claims, not yet checked: only reading it shows whether it is true.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PriorClaims {
    /// Bytes of the file.
    pub bytes: u64,
    /// Splats.
    pub splats: u64,
    /// Degree of the spherical harmonics.
    pub sh_degree: u32,
    /// Bytes of the file that hold no splats: header, comments, key frames, coder tables.
    besides: u64,
    compact: bool,
}

impl PriorClaims {
    /// Reads the claims of a PLY file, a compact prior or a blocked one; `None` for any other content.
    pub fn of(bytes: &[u8]) -> Option<PriorClaims> {
        PriorClaims::of_start(bytes, bytes.len() as u64)
    }

    /// As [`PriorClaims::of`], from the first bytes of a file of `size` bytes. They must hold the header.
    pub fn of_start(bytes: &[u8], size: u64) -> Option<PriorClaims> {
        let own = [Format::Compact, Format::Blocked].map(Format::magic);
        let claims = if own.iter().any(|magic| bytes.starts_with(magic)) {
            let degree = u32::from(*bytes.get(5)?);
            let count = u32::from_le_bytes(*bytes.get(12..)?.first_chunk()?);
            // Every part but the splats may be as long as the file.
            (u64::from(count), degree, size, true)
        } else if bytes.starts_with(ply::MAGIC) || bytes.starts_with(ply::MARKED_MAGIC) {
            let header = header_of(bytes);
            (ply_splats(header)?, ply_degree(header), header.len() as u64, false)
        } else {
            return None;
        };
        let (splats, sh_degree, besides, compact) = claims;
        // A splat takes a byte or more of a file, else the file is refused before anything is taken.
        let splats = splats.min(size);
        let sh_degree = sh_degree.min(Splats::MAX_SH_DEGREE);
        Some(PriorClaims { bytes: size, splats, sh_degree, besides, compact })
    }

    /// What the head of a blocked prior claims of one of its blocks, which is a file of its own.
    pub fn of_block(block: &Block, sh_degree: u32) -> PriorClaims {
        let (bytes, splats) = (u64::from(block.bytes), u64::from(block.splats));
        PriorClaims { bytes, splats, sh_degree, besides: bytes, compact: true }
    }

    /// Host memory that loading takes at most, bytes, besides the file's own.
    pub fn host_bytes(&self) -> u64 {
        // Numbers of a splat: as they stand in the file, without those that are not valid, and laid out for the
        // device. The place of the prior takes a number of eight bytes per splat three times, the analysis an index.
        let numbers = 4 * (11 + 3 * (u64::from(self.sh_degree) + 1).pow(2));
        let mut splat = 3 * numbers + 32;
        // The planes of the packed stream, its window, distances along the curve and the numbers in steps.
        if self.compact {
            splat += 3 * numbers + 48;
        }
        // Comments and key frames stand there as text or in a few bytes, and are taken apart.
        self.splats * splat + 24 * self.besides
    }

    /// Device memory of its splats, bytes: what stays, and as much again for the copy on the way if the device has a
    /// memory of its own. Encoders and decoders take more: by splats, by pixels and by what they see.
    pub fn device_bytes(&self) -> u64 {
        self.splats * super::analysis::splat_bytes(self.sh_degree)
    }
}

fn lines(header: &[u8]) -> impl Iterator<Item = impl Iterator<Item = &[u8]>> {
    header
        .split(|byte| matches!(byte, b'\n' | b'\r'))
        .map(|line| line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()))
}

/// The largest number of vertices that a line states.
fn ply_splats(header: &[u8]) -> Option<u64> {
    lines(header)
        .filter_map(|mut words| {
            let stated = words.next() == Some(b"element".as_slice())
                && words.next() == Some(b"vertex".as_slice());
            let number = words.next().and_then(|number| std::str::from_utf8(number).ok());
            number.filter(|_| stated).and_then(|number| number.parse().ok())
        })
        .max()
}

/// The degree that the number of properties `f_rest_*` belongs to, rounded up.
fn ply_degree(header: &[u8]) -> u32 {
    let found = lines(header)
        .filter_map(|mut words| {
            (words.next() == Some(b"property".as_slice())).then(|| words.nth(1)).flatten()
        })
        .filter(|name| name.starts_with(b"f_rest_"))
        .count();
    (0..Splats::MAX_SH_DEGREE)
        .find(|degree| 3 * ((*degree as usize + 1).pow(2) - 1) >= found)
        .unwrap_or(Splats::MAX_SH_DEGREE)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{bare, sample_splats};
    use super::super::{KeyFrames, RenderOptions, compact, ply};
    use super::*;
    use crate::image::Preprocessing;

    #[test]
    fn files_say_what_they_hold() {
        let (splats, options) = (sample_splats(7, 2), RenderOptions::INRIA);
        let mut file = Vec::new();
        let none = (&KeyFrames::NONE, &Preprocessing::NONE);
        ply::write_ply(&splats, &options, none.0, none.1, &mut file).unwrap();
        let claims = PriorClaims::of(&file).unwrap();
        assert_eq!((claims.splats, claims.sh_degree, claims.bytes), (7, 2, file.len() as u64));
        let mut file = Vec::new();
        let fine = &compact::Quantisation::default();
        compact::write(&splats, &bare(&options), fine, &mut file).unwrap();
        let claims = PriorClaims::of(&file).unwrap();
        assert_eq!((claims.splats, claims.sh_degree), (7, 2));
        assert!(claims.host_bytes() > 7 * 4 * 38);
    }

    #[test]
    fn claims_do_not_exceed_what_a_file_can_hold() {
        let claims = |text: &str| PriorClaims::of(text.as_bytes());
        assert_eq!(claims("no prior"), None);
        assert_eq!(claims("ply\nformat ascii 1.0\nend_header\n"), None, "no vertices");
        let huge = "ply\nelement  vertex 4000000000\nproperty float f_rest_0\nend_header\n";
        let found = claims(huge).unwrap();
        assert_eq!((found.splats, found.sh_degree), (huge.len() as u64, 1));
        assert_eq!(PriorClaims::of(b"nvsg"), None);
        assert_eq!(PriorClaims::of(b"nvsb"), None);
        let claims_of = |bytes: &[u8]| PriorClaims::of(bytes).unwrap();
        let head = [&b"nvsb\x01\x01\0\0"[..], &[0; 4], &9_u32.to_le_bytes(), &[0; 900]].concat();
        let found = claims_of(&head);
        assert_eq!((found.splats, found.sh_degree, found.bytes), (9, 1, 916));
        let cut = [&b"nvsg\x01\xff\0\0"[..], &[0xff; 8]].concat();
        let found = claims_of(&cut);
        assert_eq!((found.splats, found.sh_degree), (16, 3));
    }
}
