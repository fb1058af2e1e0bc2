//! Makes tags.

use super::key::Key;
use super::key_set::Keys;
use super::limits::{NUMBER_BYTES, STREAMS};
use super::tag::{Content, TagInput, Tagger, put_number};

/// Puts a number and a tag in front of what a side sends.
#[derive(Clone, Debug)]
pub struct Authenticator {
    key: Option<Key>,
    content: Content,
    tag_bytes: usize,
    epoch: u64,
    number: u64,
}

impl Authenticator {
    /// By the first of these keys, from [`Keys::number`] on.
    pub fn new(keys: &Keys, content: Content) -> Authenticator {
        let [key, ..] = keys.keys().clone();
        let (tag_bytes, epoch, number) = (keys.tag_bytes(), keys.epoch(), keys.number());
        Authenticator { key, content, tag_bytes, epoch, number }
    }

    /// Bytes that number and tag take.
    pub fn overhead(&self) -> usize {
        NUMBER_BYTES + self.tag_bytes
    }

    /// Number of the next thing. Keep it over a restart within an epoch: [`Keys::with_number`].
    pub fn next_number(&self) -> u64 {
        self.number
    }

    /// Writes number, tag and content in place of what `frame` holds. `stream`: 0 to 3.
    pub fn write(&mut self, stream: u8, content: &[u8], frame: &mut Vec<u8>) {
        frame.clear();
        frame.resize(self.overhead(), 0);
        frame.extend(content);
        self.seal(stream, frame);
    }

    /// Writes number and tag into the first [`overhead`](Self::overhead) bytes of `frame`; the content stands behind
    /// them already. Does nothing if it is shorter than that.
    pub fn seal(&mut self, stream: u8, frame: &mut [u8]) {
        let overhead = self.overhead();
        let (Some(key), Some((head, content))) = (&self.key, frame.split_at_mut_checked(overhead))
        else {
            return;
        };
        let stream = stream % STREAMS as u8;
        let (number, tag) = head.split_at_mut(NUMBER_BYTES);
        number.copy_from_slice(&put_number(stream, self.number));
        let Authenticator { content: kind, epoch, number, .. } = *self;
        let input = TagInput { content: kind, stream, epoch, number };
        Tagger::new(key).write(&input, content, tag);
        self.number += 1;
    }
}
