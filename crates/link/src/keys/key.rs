//! A key.

use std::fmt;

use constant_time_eq::constant_time_eq_32;
use zeroize::Zeroize;

use super::limits::KEY_LEN;

/// Of a key's id: what its hash is for.
const ID: &str = "nvsprior 2026-11-27 id of a key";

/// A secret that both sides hold. It is erased when it is dropped, and no text of it can be made.
#[derive(Clone)]
pub struct Key([u8; Key::LEN]);

impl Drop for Key {
    fn drop(&mut self) {
        self.0.zeroize();
    }
}

/// A name for a key that tells nothing of it: four bytes of a hash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct KeyId(pub u32);

impl Key {
    /// Bytes of a key.
    pub const LEN: usize = KEY_LEN;

    /// The key of these bytes, which should be random ones.
    pub fn new(bytes: [u8; Key::LEN]) -> Key {
        Key(bytes)
    }

    /// Reads 64 hexadecimal digits.
    pub(super) fn parse(text: &str) -> Option<Key> {
        let digits = text.as_bytes();
        if digits.len() != 2 * Key::LEN {
            return None;
        }
        let mut key = Key([0; Key::LEN]);
        for (byte, pair) in key.0.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = digit(pair[0])? << 4 | digit(pair[1])?;
        }
        Some(key)
    }

    /// By which a user tells keys apart.
    pub fn id(&self) -> KeyId {
        let mut hash = blake3::derive_key(ID, &self.0);
        let id = u32::from_le_bytes([hash[0], hash[1], hash[2], hash[3]]);
        hash.zeroize();
        KeyId(id)
    }

    pub(super) fn bytes(&self) -> &[u8; Key::LEN] {
        &self.0
    }
}

impl PartialEq for Key {
    /// Takes the same time wherever they differ.
    fn eq(&self, other: &Key) -> bool {
        constant_time_eq_32(&self.0, &other.0)
    }
}

impl Eq for Key {}

impl fmt::Debug for Key {
    /// Without the key.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "Key({})", self.id())
    }
}

impl fmt::Display for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

fn digit(letter: u8) -> Option<u8> {
    char::from(letter).to_digit(16).map(|digit| digit as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_read_and_other_text_is_not() {
        let text = "00".repeat(31) + "aF";
        let mut bytes = [0; 32];
        bytes[31] = 0xAF;
        assert_eq!(Key::parse(&text), Some(Key(bytes)));
        for wrong in ["", &text[1..], &(text.clone() + "0"), &text.replace("aF", "g0"), "+1"] {
            assert_eq!(Key::parse(wrong), None, "{wrong}");
        }
        assert_eq!(Key::parse(&("é".repeat(32))), None);
    }

    #[test]
    fn no_text_tells_the_key() {
        let key = Key::new(*b"a secret that nobody should read");
        let shown = format!("{key:?}");
        assert_eq!(shown, format!("Key({})", key.id()));
        assert_eq!(shown.len(), "Key()".len() + 8);
        assert_ne!(key.id(), Key::new([0; 32]).id());
    }
}
