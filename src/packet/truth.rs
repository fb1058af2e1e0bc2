//! How long a truth map is, for who reads what follows it.

/// The map by which all of the picture is as seen.
pub const ALL_SEEN: &[u8] = &[0];
/// Bits of the first byte that say how fine the map is; 0: it has no more bytes.
pub const FORM: u8 = 0b11;
/// Bit of the first byte: it is predicted from the last key map.
pub const PREDICTED: u8 = 0b100;
/// Low bits of the second byte: the length of what follows it, up to this; this, and more bytes tell the rest.
pub const LENGTH: u8 = 0x0F;

/// Longest map, bytes.
pub const MAX_LEN: usize = 1 << 20;

/// Where the coded bytes of a map lie; `None`: its end is missing, or it is too long to be one.
pub fn coded(bytes: &[u8]) -> Option<std::ops::Range<usize>> {
    if bytes.first()? & FORM == 0 {
        return Some(1..1);
    }
    let mut len = usize::from(bytes.get(1)? & LENGTH);
    let mut start = 2;
    if len == usize::from(LENGTH) {
        for place in 0..3 {
            let byte = bytes.get(start)?;
            start += 1;
            len += usize::from(byte & 0x7F) << (7 * place);
            if byte & 0x80 == 0 {
                break;
            }
        }
    }
    (len <= MAX_LEN && start + len <= bytes.len()).then_some(start..start + len)
}

/// Splits bytes behind the map that they begin with.
pub fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    coded(bytes).map(|coded| bytes.split_at(coded.end))
}

/// Writes the length of the coded bytes. `high`: the high bits of the first byte.
pub fn write_len(high: u8, len: usize, bytes: &mut Vec<u8>) {
    let short = len.min(LENGTH.into());
    bytes.push(high & !LENGTH | short as u8);
    if short == usize::from(LENGTH) {
        let mut rest = len - short;
        for place in 0..3 {
            let more = place < 2 && rest >> 7 > 0;
            bytes.push((rest & 0x7F) as u8 | if more { 0x80 } else { 0 });
            rest >>= 7;
            if !more {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_tells_its_length() {
        for len in [0, 1, 14, 15, 16, 142, 143, 5000, MAX_LEN] {
            let mut bytes = vec![0b0001];
            write_len(0x70, len, &mut bytes);
            let start = bytes.len();
            bytes.resize(start + len + 3, 9);
            assert_eq!(coded(&bytes), Some(start..start + len), "{len}");
            assert_eq!(bytes[1] & !LENGTH, 0x70);
            assert_eq!(split(&bytes).unwrap().1.len(), 3);
            assert_eq!(split(&bytes[..start + len]).unwrap().1.len(), 0);
            assert!(coded(&bytes[..(start + len).saturating_sub(1)]).is_none(), "{len}");
        }
        assert_eq!(split(&[0b1111_1111, 7]), None);
        assert_eq!(split(&[0b1111_1100, 7]), Some((&[0b1111_1100][..], &[7][..])));
        assert_eq!(split(&[]), None);
    }
}
