//! Tags.

use constant_time_eq::constant_time_eq;
use zeroize::Zeroize;

use super::key::Key;
use super::limits::{MAX_TAG_BYTES, NUMBER_BITS, NUMBER_BYTES};

/// What all that goes into a tag begins with.
const MARK: &[u8; 4] = b"nvsk";

/// What a tag is for. A tag of one kind is none of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// A modem frame from the vehicle.
    Frame = 0,
    /// A report from the topside.
    Report = 1,
    /// A packet that does not go over a modem.
    Packet = 2,
}

impl Content {
    /// What of some bytes a tag covers. A modem may fill its frames up with zeros, so zeros at their end do not count.
    fn covered(self, content: &[u8]) -> &[u8] {
        let zeros = match self {
            Content::Frame | Content::Report => {
                content.iter().rev().take_while(|b| **b == 0).count()
            }
            Content::Packet => 0,
        };
        &content[..content.len() - zeros]
    }
}

/// What goes into a tag beside key and content.
#[derive(Clone, Copy, Debug)]
pub struct TagInput {
    pub content: Content,
    pub stream: u8,
    pub epoch: u64,
    pub number: u64,
}

impl TagInput {
    /// What precedes the content, for tags of `len` bytes.
    fn prefix(&self, len: usize) -> [u8; 24] {
        let mut prefix = [0; 24];
        prefix[..4].copy_from_slice(MARK);
        prefix[4..7].copy_from_slice(&[self.content as u8, self.stream, len as u8]);
        prefix[8..16].copy_from_slice(&self.epoch.to_le_bytes());
        prefix[16..].copy_from_slice(&self.number.to_le_bytes());
        prefix
    }
}

/// Makes the tags of a key. Nothing of the key is left once it is dropped.
pub struct Tagger(blake3::Hasher);

impl Drop for Tagger {
    fn drop(&mut self) {
        self.0.zeroize();
    }
}

impl Tagger {
    pub fn new(key: &Key) -> Tagger {
        Tagger(blake3::Hasher::new_keyed(key.bytes()))
    }

    /// Writes the tag of some content, of as many bytes as `tag` has, at most [`MAX_TAG_BYTES`].
    pub fn write(&mut self, input: &TagInput, content: &[u8], tag: &mut [u8]) {
        self.0.reset();
        self.0.update(&input.prefix(tag.len()));
        self.0.update(input.content.covered(content));
        tag.copy_from_slice(&self.0.finalize().as_bytes()[..tag.len()]);
    }

    /// Whether a tag is that of some content. Takes the same time wherever the tag differs.
    pub fn matches(&mut self, input: &TagInput, content: &[u8], tag: &[u8]) -> bool {
        let mut expected = [0; MAX_TAG_BYTES];
        let Some(expected) = expected.get_mut(..tag.len()) else { return false };
        self.write(input, content, expected);
        constant_time_eq(expected, tag)
    }
}

/// The two bytes in front of a tag.
pub fn put_number(stream: u8, number: u64) -> [u8; NUMBER_BYTES] {
    let low = (number & ((1 << NUMBER_BITS) - 1)) as u16;
    (low | u16::from(stream) << NUMBER_BITS).to_le_bytes()
}

/// The stream and the low bits of the number.
pub fn take_number(bytes: [u8; NUMBER_BYTES]) -> (u8, u64) {
    let word = u16::from_le_bytes(bytes);
    ((word >> NUMBER_BITS) as u8, u64::from(word & ((1 << NUMBER_BITS) - 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUT: TagInput =
        TagInput { content: Content::Frame, stream: 2, epoch: 7, number: 0x1_2345 };

    fn tag(input: TagInput, key: u8, content: &[u8]) -> [u8; 4] {
        let mut tag = [0; 4];
        Tagger::new(&Key::new([key; 32])).write(&input, content, &mut tag);
        tag
    }

    /// By BLAKE3's own function over the bytes as the document has them.
    #[test]
    fn a_tag_is_the_start_of_the_keyed_hash() {
        let mut bytes = b"nvsk\0\x02\x04\0".to_vec();
        bytes.extend([7, 0, 0, 0, 0, 0, 0, 0, 0x45, 0x23, 1, 0, 0, 0, 0, 0]);
        bytes.extend(b"content");
        let hash = blake3::keyed_hash(&[9; 32], &bytes);
        assert_eq!(tag(INPUT, 9, b"content"), hash.as_bytes()[..4]);
    }

    #[test]
    fn a_tag_covers_all_of_it() {
        let own = tag(INPUT, 9, b"content");
        let others = [
            tag(INPUT, 8, b"content"),
            tag(INPUT, 9, b"Content"),
            tag(INPUT, 9, b"\0content"),
            tag(TagInput { content: Content::Report, ..INPUT }, 9, b"content"),
            tag(TagInput { stream: 1, ..INPUT }, 9, b"content"),
            tag(TagInput { epoch: 8, ..INPUT }, 9, b"content"),
            tag(TagInput { number: 0x2345, ..INPUT }, 9, b"content"),
        ];
        for other in others {
            assert_ne!(own, other);
        }
        let mut longer = [0; 5];
        Tagger::new(&Key::new([9; 32])).write(&INPUT, b"content", &mut longer);
        assert_ne!(own, longer[..4], "the length counts, too");
    }

    #[test]
    fn zeros_behind_a_modem_frame_are_padding() {
        let own = tag(INPUT, 9, b"content");
        assert_eq!(own, tag(INPUT, 9, b"content\0\0\0"));
        let packet = TagInput { content: Content::Packet, ..INPUT };
        assert_ne!(tag(packet, 9, b"content"), tag(packet, 9, b"content\0"));
    }

    #[test]
    fn stream_and_low_bits_travel() {
        for (stream, number) in [(0, 0), (3, 0x3FFF), (2, 0x1_2345)] {
            assert_eq!(take_number(put_number(stream, number)), (stream, number % (1 << 14)));
        }
    }
}
