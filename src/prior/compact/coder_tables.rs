//! Coder tables in a compact prior: as many bytes as they have, and those.

use super::super::PriorError;
use super::super::tables_file::refusal;
use super::format::FORMAT;
use crate::coder_tables::Tables;

const START: usize = 4;

/// The section of tables; of none, nothing.
pub fn to_bytes(tables: Option<&Tables>) -> Vec<u8> {
    let Some(tables) = tables.map(Tables::write) else { return Vec::new() };
    [&(tables.len() as u32).to_le_bytes()[..], &tables].concat()
}

/// Reads the section at the start of `bytes`, which begin at byte `at` of the file. Also returns how many bytes it
/// takes.
pub fn read(bytes: &[u8], at: usize) -> Result<(Tables, usize), PriorError> {
    let truncated = |size: usize| {
        let needed = at as u128 + size as u128;
        PriorError::Truncated { needed, found: at + bytes.len() }
    };
    let start = bytes.first_chunk().ok_or_else(|| truncated(START))?;
    let size = START.saturating_add(u32::from_le_bytes(*start) as usize);
    let tables = bytes.get(START..size).ok_or_else(|| truncated(size))?;
    let tables = Tables::read(tables).map_err(|error| refusal(FORMAT, at + START, &error))?;
    Ok((tables, size))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::prior::tables_file::tests::sample_tables;

    #[test]
    fn tables_come_back() {
        assert!(to_bytes(None).is_empty());
        let tables = sample_tables(1);
        let bytes = to_bytes(Some(&tables));
        let (found, size) = read(&[&bytes[..], &[7; 3]].concat(), 76).unwrap();
        assert_eq!((found, size), (tables, bytes.len()));
    }

    #[test]
    fn what_no_writer_leaves_is_refused() {
        let valid = to_bytes(Some(&sample_tables(1)));
        let error = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = valid.clone();
            change(&mut bytes);
            read(&bytes, 76).unwrap_err()
        };
        let magic = error(&|b| b[4] = b'n');
        assert!(matches!(magic, PriorError::Field { offset: 80, .. }), "{magic}");
        let short = valid.len() as u32 - START as u32 - 1;
        let length = error(&|b| b[..4].copy_from_slice(&short.to_le_bytes()));
        let end = 80 + u64::from(short);
        assert!(matches!(length, PriorError::Field { offset, .. } if offset == end), "{length}");
        for size in [short + 2, u32::MAX] {
            let cut = error(&|b| b[..4].copy_from_slice(&size.to_le_bytes()));
            let expected = 80 + u128::from(size);
            assert!(matches!(cut, PriorError::Truncated { needed, .. } if needed == expected));
        }
        for len in 0..valid.len() {
            let cut = error(&|b| b.truncate(len));
            assert!(matches!(cut, PriorError::Truncated { .. }), "{len}: {cut}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_sections_are_an_error_or_tables(
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
            size in 0..300_u32,
            whole in proptest::collection::vec(any::<u8>(), Tables::encoded_len()),
        ) {
            prop_assert!(read(&bytes, 76).is_err());
            prop_assert!(read(&[&size.to_le_bytes()[..], &bytes].concat(), 76).is_err());
            let len = whole.len() as u32;
            let bytes = [&len.to_le_bytes()[..], b"NVT1", &whole[4..]].concat();
            let (tables, size) = read(&bytes, 76).unwrap();
            prop_assert_eq!(size, bytes.len());
            prop_assert_eq!(to_bytes(Some(&tables)), bytes);
        }
    }
}
