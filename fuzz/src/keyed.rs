//! Keys: what an authenticator made, damaged, cut, repeated, of others, and garbage, in any order, at a verifier and at
//! a collector. Nothing passes that was not made with the keys, and nothing twice.
use std::collections::BTreeSet;

use arbitrary::{Arbitrary, Unstructured};
use nvsprior_link::keys::{Authenticator, Content, Key, Keys, Refusal, Seen, Verifier};
use nvsprior_link::modem::{Collector, CollectorOptions, MIN_MTU, ModemError};

#[derive(Arbitrary, Debug)]
struct Input {
    tag: u8,
    epoch: u64,
    number: u64,
    content: u8,
    seen: Option<u64>,
    frames: Vec<Made>,
    arrivals: Vec<Arrival>,
}

/// Something that the other side makes.
#[derive(Arbitrary, Debug)]
struct Made {
    stream: u8,
    second_key: bool,
    /// Numbers that are lost before it.
    lost: u16,
    bytes: Vec<u8>,
}

#[derive(Arbitrary, Debug)]
enum Arrival {
    /// One of those, with zeros behind it, and one bit flipped or none.
    Frame {
        index: u8,
        zeros: u8,
        flip: Option<u16>,
    },
    Cut {
        index: u8,
        len: u8,
    },
    Garbage(Vec<u8>),
}

pub fn run(bytes: &[u8]) {
    let Ok(input) = Input::arbitrary_take_rest(Unstructured::new(bytes)) else { return };
    // With fewer bytes of tag a fuzzer would find one.
    let tag = 8 + usize::from(input.tag) % 9;
    let number = input.number % (1 << 48);
    let keys = || {
        let keys = Keys::new([1, 2].map(|byte| Key::new([byte; Key::LEN]))).expect("two keys");
        let keys = keys.with_tag_bytes(tag).expect("a length in range");
        keys.with_epoch(input.epoch).with_number(number).expect("a number in range")
    };
    let content =
        [Content::Frame, Content::Report, Content::Packet][usize::from(input.content) % 3];
    let frames = made(&keys(), &input.frames, content);
    let first = keys().ids().next().unwrap_or_default();
    let seen = input.seen.map(|number| Seen { key: first, stream: 0, number });
    let mut verifier = Verifier::new(&keys().with_seen(seen), content);
    // From the smallest MTU on.
    let mtu = MIN_MTU + keys().overhead() + usize::from(input.content / 3) % 64;
    let options = CollectorOptions { packets: 4, ..CollectorOptions::new(mtu) };
    let mut collector = Collector::with_keys(options, &keys()).expect("room for tags");
    let mut taken = BTreeSet::new();
    for arrival in &input.arrivals {
        let arrived = arrived(arrival, &frames);
        let pushed = collector.push(0.0, &arrived);
        assert!(content == Content::Frame || pushed == Err(ModemError::Key(Refusal::Foreign)));
        let Ok(verified) = verifier.verify(&arrived) else { continue };
        let padded = matches!(content, Content::Frame | Content::Report);
        let own = frames.iter().any(|(_, frame)| match padded {
            true => without_zeros(frame) == without_zeros(&arrived),
            false => *frame == arrived,
        });
        assert!(own, "a frame that nobody made");
        assert!(taken.insert((verified.key.0, verified.stream, verified.number)), "taken twice");
    }
    // What was taken is known to a verifier that starts again.
    let seen: Vec<_> = verifier.seen().collect();
    let mut again = Verifier::new(&keys().with_seen(seen), content);
    for (_, frame) in &frames {
        if let Ok(verified) = again.verify(frame) {
            let known = (verified.key.0, verified.stream, verified.number);
            assert!(!taken.contains(&known), "taken again");
        }
    }
}

/// The number's low bits stay: zeros at the end are those of the content.
fn without_zeros(frame: &[u8]) -> &[u8] {
    let zeros = frame.iter().rev().take_while(|byte| **byte == 0).count();
    &frame[..frame.len() - zeros]
}

/// The number of each, and the bytes.
fn made(keys: &Keys, frames: &[Made], content: Content) -> Vec<(u64, Vec<u8>)> {
    let second = Keys::new([Key::new([2; Key::LEN])]).expect("a key");
    let second = second.with_tag_bytes(keys.tag_bytes()).expect("a length in range");
    let second = second.with_epoch(keys.epoch()).with_number(keys.number()).expect("a number");
    let mut numbers = [keys.number(); 2];
    let mut all = Vec::new();
    for Made { stream, second_key, lost, bytes } in frames.iter().take(16) {
        let place = usize::from(*second_key);
        numbers[place] += u64::from(*lost);
        let keys = if *second_key { &second } else { keys };
        let Ok(keys) = keys.clone().with_number(numbers[place]) else { return all };
        let mut frame = Vec::new();
        Authenticator::new(&keys, content).write(*stream, bytes, &mut frame);
        all.push((numbers[place], frame));
        numbers[place] += 1;
    }
    all
}

fn arrived(arrival: &Arrival, frames: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let frame = |index: u8| {
        let frame = frames.get(usize::from(index) % frames.len().max(1));
        frame.map(|(_, frame)| frame.clone()).unwrap_or_default()
    };
    match arrival {
        Arrival::Garbage(bytes) => bytes.clone(),
        Arrival::Cut { index, len } => {
            let mut frame = frame(*index);
            frame.truncate((*len).into());
            frame
        }
        Arrival::Frame { index, zeros, flip } => {
            let mut frame = frame(*index);
            if let Some(bit) = flip.filter(|_| !frame.is_empty()) {
                let bit = usize::from(bit) % (8 * frame.len());
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            frame.extend(std::iter::repeat_n(0, usize::from(*zeros) % 8));
            frame
        }
    }
}
