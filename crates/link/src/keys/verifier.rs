//! Checks tags.

use super::error::Refusal;
use super::key::{Key, KeyId};
use super::key_set::{Keys, Seen};
use super::limits::{MAX_KEYS, NUMBER_BYTES, STREAMS};
use super::tag::{Content, TagInput, Tagger, take_number};
use super::window::Window;

/// Tells what the other side sent from what others did, and takes each thing once.
///
/// It looks at nothing but number and tag. A thing without the right tag costs a hash of it per number that is tried:
/// eight for each key, 64 for a key by which nothing has come yet. Each number may be taken for a forged one's with a
/// chance of `1 / 256ⁿ`, for `n` bytes of tag: four numbers of a key, 64 of one by which nothing has come yet.
#[derive(Clone, Debug)]
pub struct Verifier {
    keys: [Option<Known>; MAX_KEYS],
    content: Content,
    tag_bytes: usize,
    epoch: u64,
}

/// A key, and what was taken by it.
#[derive(Clone, Debug)]
struct Known {
    key: Key,
    id: KeyId,
    windows: [Window; STREAMS],
}

/// Something that the other side sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verified<'a> {
    /// Without number and tag. Zeros of a modem may follow.
    pub content: &'a [u8],
    /// The stream that it was sent for.
    pub stream: u8,
    /// Its number.
    pub number: u64,
    /// The key that made its tag.
    pub key: KeyId,
}

impl Verifier {
    /// By all of these keys.
    pub fn new(keys: &Keys, content: Content) -> Verifier {
        let known = |key: &Key| {
            let (id, mut windows) = (key.id(), [Window::default(); STREAMS]);
            for seen in keys.seen().iter().filter(|seen| seen.key == id) {
                if let Some(window) = windows.get_mut(usize::from(seen.stream)) {
                    *window = Window::after(seen.number);
                }
            }
            Known { key: key.clone(), id, windows }
        };
        let known = keys.keys().each_ref().map(|key| key.as_ref().map(known));
        Verifier { keys: known, content, tag_bytes: keys.tag_bytes(), epoch: keys.epoch() }
    }

    /// Bytes that number and tag take.
    pub fn overhead(&self) -> usize {
        NUMBER_BYTES + self.tag_bytes
    }

    /// Checks what came.
    ///
    /// # Errors
    /// If no key has made its tag, or it came before. All stays as it was then.
    pub fn verify<'a>(&mut self, frame: &'a [u8]) -> Result<Verified<'a>, Refusal> {
        let (number, rest) = frame.split_first_chunk::<NUMBER_BYTES>().ok_or(Refusal::Foreign)?;
        let (tag, bytes) = rest.split_at_checked(self.tag_bytes).ok_or(Refusal::Foreign)?;
        let (stream, low) = take_number(*number);
        let Verifier { content, epoch, .. } = *self;
        for Known { key, id, windows } in self.keys.iter_mut().flatten() {
            let (window, mut tagger) = (&mut windows[usize::from(stream)], Tagger::new(key));
            for number in window.candidates(low) {
                let input = TagInput { content, stream, epoch, number };
                if tagger.matches(&input, bytes, tag) {
                    let verified = Verified { content: bytes, stream, number, key: *id };
                    return if window.take(number) { Ok(verified) } else { Err(Refusal::Replayed) };
                }
            }
        }
        Err(Refusal::Foreign)
    }

    /// What was taken so far. Keep it over a restart within an epoch: [`Keys::with_seen`].
    pub fn seen(&self) -> impl Iterator<Item = Seen> + '_ {
        self.keys.iter().flatten().flat_map(|known| {
            let all = (0..).zip(&known.windows);
            all.filter_map(|(stream, window)| {
                Some(Seen { key: known.id, stream, number: window.greatest()? })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::keys::Authenticator;

    fn keys(bytes: &[u8]) -> Keys {
        Keys::new(bytes.iter().map(|byte| Key::new([*byte; 32]))).unwrap()
    }

    fn sent(by: &mut Authenticator, stream: u8, content: &[u8]) -> Vec<u8> {
        let mut frame = Vec::new();
        by.write(stream, content, &mut frame);
        frame
    }

    #[test]
    fn what_was_sent_is_taken_once() {
        for tag_bytes in 2..=16 {
            let keys = keys(&[1]).with_tag_bytes(tag_bytes).unwrap();
            let mut vehicle = Authenticator::new(&keys, Content::Frame);
            let mut topside = Verifier::new(&keys, Content::Frame);
            for number in 0..100 {
                let frame = sent(&mut vehicle, 1, b"some bytes");
                assert_eq!(frame.len(), 10 + 2 + tag_bytes);
                let verified = topside.verify(&frame).unwrap();
                assert_eq!((verified.content, verified.stream), (&b"some bytes"[..], 1));
                assert_eq!(verified.number, number);
                assert_eq!(topside.verify(&frame), Err(Refusal::Replayed));
            }
        }
    }

    #[test]
    fn strangers_are_refused() {
        let own = keys(&[1]).with_epoch(3);
        let mut topside = Verifier::new(&own, Content::Frame);
        let others = [
            (keys(&[2]).with_epoch(3), Content::Frame),
            (keys(&[1]).with_epoch(4), Content::Frame),
            (keys(&[1]).with_epoch(3), Content::Report),
            (keys(&[1]).with_epoch(3).with_tag_bytes(5).unwrap(), Content::Frame),
        ];
        for (keys, content) in others {
            let frame = sent(&mut Authenticator::new(&keys, content), 0, b"bytes");
            assert_eq!(topside.verify(&frame), Err(Refusal::Foreign), "{keys:?} {content:?}");
        }
        let good = sent(&mut Authenticator::new(&own, Content::Frame), 0, b"bytes");
        for bit in 0..8 * good.len() {
            let mut damaged = good.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(topside.verify(&damaged), Err(Refusal::Foreign), "bit {bit}");
        }
        for len in 0..good.len() {
            assert_eq!(topside.verify(&good[..len]), Err(Refusal::Foreign), "cut to {len}");
        }
        assert!(topside.verify(&good).is_ok(), "nothing of it has changed the verifier");
    }

    #[test]
    fn keys_change_one_side_after_the_other() {
        let mut topside = Verifier::new(&keys(&[1, 2]), Content::Frame);
        let mut old = Authenticator::new(&keys(&[1]), Content::Frame);
        let mut new = Authenticator::new(&keys(&[2, 1]), Content::Frame);
        for _ in 0..50 {
            assert!(topside.verify(&sent(&mut old, 0, b"old")).is_ok());
        }
        let last = sent(&mut old, 0, b"late");
        // The new key's numbers begin anew.
        let first = sent(&mut new, 0, b"new");
        assert_eq!(topside.verify(&first).unwrap().key, Key::new([2; 32]).id());
        assert!(topside.verify(&last).is_ok());
        assert_eq!(topside.verify(&first), Err(Refusal::Replayed));
    }

    #[test]
    fn streams_count_by_themselves() {
        let keys = keys(&[1]);
        let mut topside = Verifier::new(&keys, Content::Frame);
        for stream in 0..4 {
            let mut vehicle = Authenticator::new(&keys, Content::Frame);
            assert_eq!(topside.verify(&sent(&mut vehicle, stream, b"x")).unwrap().stream, stream);
        }
    }

    /// As many frames are lost as half an hour of a link has.
    #[test]
    fn a_silence_and_a_start_again_are_got_over() {
        let keys = keys(&[1]);
        let mut vehicle = Authenticator::new(&keys, Content::Frame);
        let mut topside = Verifier::new(&keys, Content::Frame);
        let first = sent(&mut vehicle, 0, b"first");
        assert!(topside.verify(&first).is_ok());
        (0..60_000).for_each(|_| drop(sent(&mut vehicle, 0, b"lost")));
        let after = sent(&mut vehicle, 0, b"after");
        assert_eq!(topside.verify(&after).unwrap().number, 60_001);
        assert_eq!(topside.verify(&first), Err(Refusal::Replayed), "long past");
        // A topside that starts again finds the number, and takes nothing twice if it is told what came.
        let mut fresh = Verifier::new(&keys, Content::Frame);
        assert!(fresh.verify(&after).is_ok());
        let seen: Vec<_> = topside.seen().collect();
        assert_eq!(seen, [Seen { key: Key::new([1; 32]).id(), stream: 0, number: 60_001 }]);
        let mut told = Verifier::new(&keys.clone().with_seen(seen), Content::Frame);
        assert_eq!(told.verify(&after), Err(Refusal::Replayed));
        assert!(told.verify(&sent(&mut vehicle, 0, b"next")).is_ok());
        // A vehicle that starts again goes on counting.
        let keys = keys.with_number(vehicle.next_number()).unwrap();
        let mut again = Authenticator::new(&keys, Content::Frame);
        assert!(topside.verify(&sent(&mut again, 0, b"again")).is_ok());
    }

    proptest! {
        #[test]
        fn any_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
            let keys = keys(&[1, 2, 3, 4]).with_tag_bytes(8).unwrap();
            prop_assert_eq!(Verifier::new(&keys, Content::Frame).verify(&bytes), Err(Refusal::Foreign));
        }

        /// Frames come in any order, some twice, some never: each is taken at most once, and one that is not much late
        /// is taken.
        #[test]
        fn each_frame_is_taken_once(order in proptest::collection::vec((0usize..40, 0usize..300), 1..200)) {
            let keys = keys(&[5]);
            let mut vehicle = Authenticator::new(&keys, Content::Report);
            let frames: Vec<_> = (0u32..400).map(|n| sent(&mut vehicle, 2, &n.to_le_bytes())).collect();
            let mut topside = Verifier::new(&keys, Content::Report);
            let mut taken = vec![false; frames.len()];
            let mut at = 0;
            for (step, skip) in order {
                at = if skip < 250 { (at + step) % frames.len() } else { skip };
                match topside.verify(&frames[at]) {
                    Ok(verified) => {
                        prop_assert!(!std::mem::replace(&mut taken[at], true));
                        prop_assert_eq!(verified.number, at as u64);
                    }
                    Err(refusal) => {
                        prop_assert_eq!(refusal, Refusal::Replayed);
                        let newest = taken.iter().rposition(|taken| *taken).unwrap_or(0);
                        prop_assert!(taken[at] || at + 64 <= newest);
                    }
                }
            }
        }
    }
}
