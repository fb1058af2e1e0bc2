//! The keys that a side holds, and how it uses them.

use super::error::KeyError;
use super::key::{Key, KeyId};
use super::limits::{
    DEFAULT_TAG_BYTES, MAX_KEYS, MAX_NUMBER, MAX_TAG_BYTES, MIN_TAG_BYTES, NUMBER_BYTES,
};

/// The keys that a side holds. It makes tags by the first one, and takes those by any of them: so both sides can change
/// to another key, one after the other.
#[derive(Clone, Debug)]
pub struct Keys {
    keys: [Option<Key>; MAX_KEYS],
    tag_bytes: usize,
    epoch: u64,
    number: u64,
    seen: Vec<Seen>,
}

/// The greatest number that was taken of a stream, by a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// Of which key.
    pub key: KeyId,
    /// Of which stream.
    pub stream: u8,
    /// The number.
    pub number: u64,
}

impl Keys {
    /// These keys, with tags of four bytes, for epoch 0.
    ///
    /// # Errors
    /// If there are none or more than [`MAX_KEYS`], or one is there twice.
    pub fn new(given: impl IntoIterator<Item = Key>) -> Result<Keys, KeyError> {
        let mut keys = [const { None }; MAX_KEYS];
        let mut count = 0;
        for key in given {
            if keys.iter().flatten().any(|other| *other == key) {
                return Err(KeyError::Twice);
            }
            if let Some(place) = keys.get_mut(count) {
                *place = Some(key);
            }
            count += 1;
        }
        if !(1..=MAX_KEYS).contains(&count) {
            return Err(KeyError::Count(count));
        }
        let (tag_bytes, epoch, number, seen) = (DEFAULT_TAG_BYTES, 0, 0, Vec::new());
        Ok(Keys { keys, tag_bytes, epoch, number, seen })
    }

    /// Reads the content of a key file: a key a line, as 64 hexadecimal digits. Empty lines and lines that begin with
    /// `#` do not count.
    ///
    /// # Errors
    /// With the number of the line. As for [`Keys::new`].
    pub fn parse(text: &str) -> Result<Keys, KeyError> {
        let lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
        let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let keys = lines.map(|(line, text)| Key::parse(text).ok_or(KeyError::Line { line }));
        Keys::new(keys.collect::<Result<Vec<_>, _>>()?)
    }

    /// The same with tags of another length, 2 to 16 bytes. Both sides need the same.
    ///
    /// # Errors
    /// If the length is another one.
    pub fn with_tag_bytes(mut self, bytes: usize) -> Result<Keys, KeyError> {
        if !(MIN_TAG_BYTES..=MAX_TAG_BYTES).contains(&bytes) {
            return Err(KeyError::TagBytes(bytes));
        }
        self.tag_bytes = bytes;
        Ok(self)
    }

    /// The same for another epoch. Both sides need the same. Nothing of another epoch passes.
    pub fn with_epoch(mut self, epoch: u64) -> Keys {
        self.epoch = epoch;
        self
    }

    /// The same, with the number of the first thing that this side sends. A side that starts again within an epoch must
    /// go on counting: the other side refuses numbers that it has taken.
    ///
    /// # Errors
    /// If the number is too large.
    pub fn with_number(mut self, number: u64) -> Result<Keys, KeyError> {
        if number >= MAX_NUMBER {
            return Err(KeyError::Number(number));
        }
        self.number = number;
        Ok(self)
    }

    /// The same, with what this side had taken before it started again: [`Verifier::seen`](super::Verifier::seen).
    /// Without it, something from before the start may pass once more until something newer has come.
    pub fn with_seen(mut self, seen: impl IntoIterator<Item = Seen>) -> Keys {
        self.seen.extend(seen);
        self
    }

    /// Bytes of a tag.
    pub fn tag_bytes(&self) -> usize {
        self.tag_bytes
    }

    /// The epoch.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Number of the first thing that this side sends.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Bytes that number and tag take, in front of what they belong to.
    pub fn overhead(&self) -> usize {
        NUMBER_BYTES + self.tag_bytes
    }

    /// The keys' ids; the first is that of the key that makes tags.
    pub fn ids(&self) -> impl Iterator<Item = KeyId> {
        self.keys.iter().flatten().map(Key::id)
    }

    pub(super) fn keys(&self) -> &[Option<Key>; MAX_KEYS] {
        &self.keys
    }

    pub(super) fn seen(&self) -> &[Seen] {
        &self.seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_comments_and_up_to_four_keys() {
        let line = |digit: &str| digit.repeat(64);
        let text = format!("# dive of June\n\n  {}\r\n# next\n{}\n", line("1"), line("A"));
        let keys = Keys::parse(&text).unwrap();
        let ids: Vec<_> = keys.ids().collect();
        assert_eq!(ids, [Key::new([0x11; 32]).id(), Key::new([0xAA; 32]).id()]);
        assert_eq!(keys.overhead(), 6);
        assert_eq!(Keys::parse("# none\n").unwrap_err(), KeyError::Count(0));
        let five: String = (1..=5).map(|digit| line(&digit.to_string()) + "\n").collect();
        assert_eq!(Keys::parse(&five).unwrap_err(), KeyError::Count(5));
        assert_eq!(Keys::parse(&(text.clone() + &line("a"))).unwrap_err(), KeyError::Twice);
        let wrong = Keys::parse(&(text + "secret")).unwrap_err();
        assert_eq!(wrong, KeyError::Line { line: 6 });
        assert!(!wrong.to_string().contains("secret"));
    }

    #[test]
    fn options_are_checked() {
        let keys = || Keys::new([Key::new([7; 32])]).unwrap();
        for bytes in [0, 1, 17] {
            assert_eq!(keys().with_tag_bytes(bytes).unwrap_err(), KeyError::TagBytes(bytes));
        }
        assert_eq!(keys().with_tag_bytes(16).unwrap().overhead(), 18);
        assert!(keys().with_number(MAX_NUMBER).is_err() && keys().with_number(0).is_ok());
    }
}
