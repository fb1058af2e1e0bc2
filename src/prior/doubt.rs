//! Doubt: how far the prior's picture may be off, splat by splat.
//!
//! It lies in a file beside the prior's, `PRIOR.doubt`, little endian:
//!
//! | byte | type | content |
//! |---|---|---|
//! | 0 | | `nvsd` |
//! | 4 | u8 | version of the format: 1 |
//! | 5 | u32 | [`PriorId`] of the prior |
//! | 9 | u32 | number of splats |
//! | 13 | u8 × n | doubt of each splat, in the prior's order |
//! | end − 4 | u32 | CRC-32 of all bytes before |
//!
//! It is no part of the prior's identity: it changes no picture. Only the topside needs it.

use std::path::{Path, PathBuf};

use super::beside;
use super::error::PriorError;
use super::id::PriorId;
use super::limits::MAX_SPLATS;
use super::prior::Prior;
use super::replace::replace_file;

const MAGIC: &[u8] = b"nvsd";
const VERSION: u8 = 1;
const HEADER: usize = 13;
const CHECK: usize = 4;
/// What errors call it.
const FORMAT: &str = "doubt of a prior";

/// How far the prior's picture may be off, splat by splat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Doubt {
    prior: PriorId,
    of: Vec<u8>,
}

impl Doubt {
    /// Takes each splat's doubt: the error that its part of a picture is expected to have, RMS, values of 0 to 255.
    ///
    /// # Errors
    /// If there is not one for each splat.
    pub fn new(prior: &Prior, of: Vec<u8>) -> Result<Doubt, PriorError> {
        let (found, expected) = (of.len(), prior.len());
        match found == expected {
            true => Ok(Doubt { prior: prior.id(), of }),
            false => Err(PriorError::Shape { array: "doubt", found, expected }),
        }
    }

    /// Doubts of the splats, in the prior's order.
    pub fn of_splats(&self) -> &[u8] {
        &self.of
    }

    /// The file beside a prior's file: `prior.ply.doubt` beside `prior.ply`.
    pub fn path_beside(prior: &Path) -> PathBuf {
        beside::path(prior, "doubt")
    }

    /// Reads the file beside the prior's, of which `prior` is the content; `None` if there is no such file.
    ///
    /// # Errors
    /// If it cannot be read, is damaged, or is that of another prior.
    pub fn open_beside(path: &Path, prior: &Prior) -> Result<Option<Doubt>, PriorError> {
        let path = Doubt::path_beside(path);
        if beside::is_absent(&path) {
            return Ok(None);
        }
        let read = || {
            let max = (HEADER + CHECK + MAX_SPLATS) as u64;
            Doubt::read(&beside::read(&path, max, FORMAT)?, prior)
        };
        read().map(Some).map_err(|error| error.in_file(&path.display().to_string()))
    }

    /// Writes a file, which is there whole or not at all.
    pub fn save(&self, path: &Path) -> Result<(), PriorError> {
        replace_file(path, &self.to_bytes())
    }

    fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = [MAGIC, &[VERSION], &self.prior.to_bytes()].concat();
        bytes.extend((self.of.len() as u32).to_le_bytes());
        bytes.extend(&self.of);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        bytes
    }

    fn read(bytes: &[u8], prior: &Prior) -> Result<Doubt, PriorError> {
        let refuse = |offset: u64, reason: &str| {
            let reason = reason.to_owned();
            Err(PriorError::Field { format: FORMAT, offset, reason })
        };
        let needed = (HEADER + CHECK + prior.len()) as u128;
        let truncated = || PriorError::Truncated { needed, found: bytes.len() };
        let (content, check) = bytes.split_last_chunk::<CHECK>().ok_or_else(truncated)?;
        let (header, of) = content.split_first_chunk::<HEADER>().ok_or_else(truncated)?;
        if !header.starts_with(MAGIC) {
            return refuse(0, "it does not begin with nvsd");
        }
        if header[4] != VERSION {
            let (version, known) = (header[4].into(), VERSION.into());
            return Err(PriorError::Newer { format: FORMAT, version, known });
        }
        let (stated, found) = (u32::from_le_bytes(*check), crc32fast::hash(content));
        if stated != found {
            return Err(PriorError::Damaged { stated, found });
        }
        let id = PriorId::from_bytes([header[5], header[6], header[7], header[8]]);
        if id != prior.id() {
            return Err(PriorError::Identity { stated: id, found: prior.id() });
        }
        let count = u32::from_le_bytes([header[9], header[10], header[11], header[12]]);
        if count as usize != of.len() {
            return refuse(9, "it has another number of splats");
        }
        Doubt::new(prior, of.to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::RenderOptions;
    use crate::prior::tests::sample_splats;

    fn sample_prior() -> Prior {
        Prior::from_splats(sample_splats(5, 0), RenderOptions::INRIA).unwrap()
    }

    #[test]
    fn doubt_comes_back_from_the_file_beside_its_prior() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("prior.ply");
        let prior = sample_prior();
        assert_eq!(Doubt::open_beside(&path, &prior).unwrap(), None);
        let of: Vec<u8> = (0..prior.len()).map(|splat| splat as u8).collect();
        let doubt = Doubt::new(&prior, of).unwrap();
        doubt.save(&Doubt::path_beside(&path)).unwrap();
        assert_eq!(Doubt::open_beside(&path, &prior).unwrap(), Some(doubt));
    }

    #[test]
    fn what_is_no_doubt_of_the_prior_is_refused() {
        let prior = sample_prior();
        let short = Doubt::new(&prior, vec![0; prior.len() - 1]);
        assert!(matches!(short, Err(PriorError::Shape { array: "doubt", .. })));
        let bytes = Doubt::new(&prior, vec![7; prior.len()]).unwrap().to_bytes();
        for place in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[place] ^= 1;
            let error = Doubt::read(&changed, &prior).unwrap_err();
            let expected = match place {
                0..4 => matches!(error, PriorError::Field { offset: 0, .. }),
                4 => matches!(error, PriorError::Newer { version: 0, .. }),
                _ => matches!(error, PriorError::Damaged { .. }),
            };
            assert!(expected, "byte {place}: {error}");
            assert!(Doubt::read(&bytes[..place], &prior).is_err(), "{place} bytes");
        }
        let other = prior.clone().with_coder_tables(Some(crate::coder_tables::Tables::stream()));
        let error = Doubt::read(&bytes, &other).unwrap_err();
        assert!(matches!(error, PriorError::Identity { .. }), "{error}");
    }
}
