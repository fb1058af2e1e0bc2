//! The preprocessing in a compact prior.

use super::super::PriorError;
use super::format::refusal;
use crate::image::{Clahe, Preprocessing, WhiteBalance};

pub const BYTES: usize = 6;

/// The section of a preprocessing; of none, nothing.
pub fn to_bytes(preprocessing: &Preprocessing) -> Vec<u8> {
    if preprocessing.is_none() {
        return Vec::new();
    }
    let balance = match preprocessing.white_balance {
        WhiteBalance::None => 0,
        WhiteBalance::GrayWorld => 1,
    };
    let (tiles, clip_limit) =
        preprocessing.clahe.map_or((0, 0.0), |clahe| (clahe.tiles(), clahe.clip_limit()));
    let mut bytes = vec![balance, tiles];
    bytes.extend(clip_limit.to_le_bytes());
    bytes
}

/// Reads the section at the start of `bytes`, which begin at byte `at` of the file.
pub fn read(bytes: &[u8], at: usize) -> Result<Preprocessing, PriorError> {
    let section = bytes
        .first_chunk::<BYTES>()
        .ok_or(PriorError::Truncated { needed: (at + BYTES) as u128, found: at + bytes.len() })?;
    let [balance, tiles, clip_limit @ ..] = *section;
    let white_balance = match balance {
        0 => WhiteBalance::None,
        1 => WhiteBalance::GrayWorld,
        other => return Err(refusal(at, format!("white balance {other} is not known here"))),
    };
    let clip_limit = f32::from_le_bytes(clip_limit);
    let clahe = match (tiles, clip_limit) {
        (0, 0.0) => None,
        _ => Some(Clahe::new(clip_limit, tiles).map_err(|e| refusal(at + 1, e.to_string()))?),
    };
    Ok(Preprocessing { white_balance, clahe })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_was_written_is_read_back() {
        assert!(to_bytes(&Preprocessing::NONE).is_empty());
        for white_balance in [WhiteBalance::None, WhiteBalance::GrayWorld] {
            for clahe in [None, Some(Clahe::default()), Clahe::new(256.0, 32).ok()] {
                let preprocessing = Preprocessing { white_balance, clahe };
                let bytes = [to_bytes(&preprocessing), vec![7; 9]].concat();
                if !preprocessing.is_none() {
                    assert_eq!(read(&bytes, 76).unwrap(), preprocessing);
                }
            }
        }
    }

    #[test]
    fn what_no_writer_leaves_is_refused() {
        let two = 2f32.to_le_bytes();
        let section = |balance, tiles| [&[balance, tiles][..], &two].concat();
        assert!(read(&section(1, 8), 76).is_ok());
        let offset = |bytes: &[u8]| match read(bytes, 76) {
            Err(PriorError::Field { offset, .. }) => offset,
            other => panic!("{other:?}"),
        };
        assert_eq!(offset(&section(2, 8)), 76);
        assert_eq!(offset(&section(0, 33)), 77);
        assert_eq!(offset(&section(0, 0)), 77);
        assert_eq!(offset(&[0, 8, 0, 0, 0, 0]), 77);
        for len in 0..BYTES {
            let cut = read(&section(1, 8)[..len], 76).unwrap_err();
            assert!(matches!(cut, PriorError::Truncated { needed: 82, .. }), "{cut}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_sections_are_an_error_or_a_preprocessing(bytes: [u8; BYTES]) {
            if let Ok(preprocessing) = read(&bytes, 76) {
                let again = [to_bytes(&preprocessing), vec![0; BYTES]].concat();
                prop_assert_eq!(read(&again, 76).unwrap(), preprocessing);
            }
        }
    }
}
