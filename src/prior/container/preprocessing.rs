//! The part of the preprocessing.

use super::super::PriorError;
use super::words::{Words, refusal};
use crate::image::{Clahe, Preprocessing, WhiteBalance};

const FORMAT: &str = "preprocessing";

/// The part of a preprocessing.
pub fn to_bytes(preprocessing: &Preprocessing) -> Vec<u8> {
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

/// Reads the part, whose content begins at byte `at` of the file.
pub fn read(content: &[u8], at: usize) -> Result<Preprocessing, PriorError> {
    let mut words = Words::new(content, at);
    let (balance, tiles, clip_limit) = (words.byte()?, words.byte()?, words.float()?);
    words.end(FORMAT)?;
    let white_balance = match balance {
        0 => WhiteBalance::None,
        1 => WhiteBalance::GrayWorld,
        other => return Err(refusal(FORMAT, at, format!("white balance {other}"))),
    };
    let clahe = match (tiles, clip_limit) {
        (0, 0.0) => None,
        _ => Some(Clahe::new(clip_limit, tiles).map_err(|e| refusal(FORMAT, at + 1, e))?),
    };
    Ok(Preprocessing { white_balance, clahe })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_was_written_is_read_back() {
        for white_balance in [WhiteBalance::None, WhiteBalance::GrayWorld] {
            for clahe in [None, Some(Clahe::default()), Clahe::new(256.0, 32).ok()] {
                let preprocessing = Preprocessing { white_balance, clahe };
                assert_eq!(read(&to_bytes(&preprocessing), 76).unwrap(), preprocessing);
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
        for len in 0..6 {
            let cut = read(&section(1, 8)[..len], 76).unwrap_err();
            assert!(matches!(cut, PriorError::Truncated { .. }), "{cut}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_sections_are_an_error_or_a_preprocessing(bytes: [u8; 6]) {
            if let Ok(preprocessing) = read(&bytes, 76) {
                prop_assert_eq!(read(&to_bytes(&preprocessing), 76).unwrap(), preprocessing);
            }
        }
    }
}
