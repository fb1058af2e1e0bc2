//! Modem frames in a line of bytes.

use std::io::Read;
use std::sync::mpsc::SyncSender;

use super::clock::Clock;
use super::event::{Arrived, Event};

/// A modem frame as it goes over a line of bytes.
pub fn framed(bytes: &[u8]) -> Vec<u8> {
    let mut framed = cobs::encode_vec(bytes);
    framed.push(0);
    framed
}

/// Takes modem frames from a line of bytes: each is in COBS, with a zero byte behind it. What is none is handed on as
/// it came, and counts as garbage there.
///
/// Returns why no more come; `None`: the topside has ended.
pub fn take_framed(
    mut input: impl Read,
    clock: Clock,
    mtu: usize,
    events: &SyncSender<Event>,
) -> Option<String> {
    let mut splitter = Splitter::new(mtu);
    let mut buffer = [0; 4096];
    loop {
        let read = match input.read(&mut buffer) {
            Ok(0) => return Some("the input ended".into()),
            Ok(read) => read,
            Err(error) => match error.kind() {
                std::io::ErrorKind::TimedOut | std::io::ErrorKind::Interrupted => continue,
                _ => return Some(format!("reading failed: {error}")),
            },
        };
        for byte in &buffer[..read] {
            let Some(bytes) = splitter.take(*byte) else { continue };
            let arrived = Arrived { time: clock.now(), bytes, from: None };
            events.send(Event::Arrived(arrived)).ok()?;
        }
    }
}

/// Divides a line of bytes at its zeros.
struct Splitter {
    bytes: Vec<u8>,
    longest: usize,
}

impl Splitter {
    fn new(mtu: usize) -> Splitter {
        Splitter { bytes: Vec::new(), longest: cobs::max_encoding_length(mtu) }
    }

    /// Takes a byte; gives the modem frame that it ends.
    fn take(&mut self, byte: u8) -> Option<Vec<u8>> {
        if byte != 0 {
            // Of what is too long, the rest is not kept.
            if self.bytes.len() <= self.longest {
                self.bytes.push(byte);
            }
            return None;
        }
        let bytes = std::mem::take(&mut self.bytes);
        match bytes.is_empty() {
            true => None,
            false => Some(cobs::decode_vec(&bytes).unwrap_or(bytes)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(line: &[u8]) -> Vec<Vec<u8>> {
        let mut splitter = Splitter::new(8);
        line.iter().filter_map(|byte| splitter.take(*byte)).collect()
    }

    #[test]
    fn modem_frames_come_out_of_a_line_of_bytes() {
        let frames = [vec![0, 1, 0, 0], vec![9; 8], vec![0]];
        let mut line = vec![0, 0];
        for frame in &frames {
            line.extend(cobs::encode_vec(frame));
            line.push(0);
        }
        assert_eq!(split(&line), frames);
    }

    #[test]
    fn noise_is_handed_on_and_bounded() {
        let long = split(&[&[7; 100_000][..], &[0]].concat());
        assert!(long.len() == 1 && long[0].len() <= 10);
        let [one, two] = &split(&[200, 3, 0, 2, 5, 0])[..] else { panic!() };
        assert_eq!((&one[..], &two[..]), (&[200, 3][..], &[5][..]));
    }
}
