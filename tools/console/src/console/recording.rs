//! Recordings: modem frames as they came, so that a dive can be played again.
//!
//! | bytes, little endian | content |
//! |---|---|
//! | 8 | `NVSPREC1` |
//! | 8 | per modem frame: when it came, UTC in microseconds |
//! | 4 | its length |
//! | … | its bytes |

use std::io::{Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"NVSPREC1";
/// Bytes before those of a modem frame.
pub const HEAD: usize = 12;
/// Longest modem frame.
const LONGEST: u32 = 1 << 16;

#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error("{}: no recording of a console", .0.display())]
    Foreign(PathBuf),
    #[error("{}: no modem frame is in it", .0.display())]
    Empty(PathBuf),
}

/// A modem frame of a recording.
#[derive(Debug, PartialEq)]
pub struct Recorded {
    /// When it came, UTC, seconds.
    pub time: f64,
    pub bytes: Vec<u8>,
}

pub fn write_head(into: &mut impl Write) -> std::io::Result<()> {
    into.write_all(MAGIC)
}

pub fn write_frame(into: &mut impl Write, time: f64, bytes: &[u8]) -> std::io::Result<()> {
    into.write_all(&((time * 1e6) as u64).to_le_bytes())?;
    into.write_all(&(bytes.len() as u32).to_le_bytes())?;
    into.write_all(bytes)
}

/// Reads a recording from its start. What was cut in the middle of a frame, as power was lost, ends with the frame
/// before.
pub struct Player<R> {
    input: R,
    next: Recorded,
}

impl<R: Read> Player<R> {
    /// # Errors
    /// If it is no recording, or none with a frame in it.
    pub fn open(mut input: R, path: &Path) -> Result<Player<R>, RecordingError> {
        let mut magic = [0; MAGIC.len()];
        input.read_exact(&mut magic).map_err(|_| RecordingError::Foreign(path.into()))?;
        if magic != *MAGIC {
            return Err(RecordingError::Foreign(path.into()));
        }
        let next = read_frame(&mut input).ok_or(RecordingError::Empty(path.into()))?;
        Ok(Player { input, next })
    }

    /// When its first frame came.
    pub fn start(&self) -> f64 {
        self.next.time
    }

    /// The frames in order.
    pub fn frames(self) -> impl Iterator<Item = Recorded> {
        let Player { mut input, next } = self;
        std::iter::once(next).chain(std::iter::from_fn(move || read_frame(&mut input)))
    }
}

fn read_frame(input: &mut impl Read) -> Option<Recorded> {
    let mut head = [0; HEAD];
    input.read_exact(&mut head).ok()?;
    let (time, len) = head.split_at(8);
    let time = u64::from_le_bytes(time.try_into().ok()?) as f64 / 1e6;
    let len = u32::from_le_bytes(len.try_into().ok()?);
    if len > LONGEST {
        return None;
    }
    let mut bytes = vec![0; len as usize];
    input.read_exact(&mut bytes).ok()?;
    Some(Recorded { time, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames() -> Vec<Recorded> {
        let of = |time, bytes: &[u8]| Recorded { time, bytes: bytes.to_vec() };
        vec![of(1.5e9, &[1, 2, 3]), of(1.5e9 + 0.25, &[]), of(1.5e9 + 4.0, &[7; 64])]
    }

    fn written() -> Vec<u8> {
        let mut bytes = Vec::new();
        write_head(&mut bytes).unwrap();
        for Recorded { time, bytes: frame } in frames() {
            write_frame(&mut bytes, time, &frame).unwrap();
        }
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Vec<Recorded>, RecordingError> {
        Ok(Player::open(bytes, Path::new("dive"))?.frames().collect())
    }

    #[test]
    fn frames_come_back_as_they_came() {
        assert_eq!(read(&written()).unwrap(), frames());
        assert_eq!(Player::open(&written()[..], Path::new("dive")).unwrap().start(), 1.5e9);
    }

    #[test]
    fn what_is_cut_ends_with_the_frame_before() {
        let written = written();
        for len in 0..written.len() {
            let frames = read(&written[..len]).map_or(0, |frames| frames.len());
            let ends = [23, 35, 111];
            assert_eq!(frames, ends.iter().filter(|end| len >= **end).count(), "{len} bytes");
        }
    }

    #[test]
    fn lengths_that_cannot_be_take_no_memory() {
        let mut bytes = written();
        bytes[16..20].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(read(&bytes), Err(RecordingError::Empty(_))));
        assert!(matches!(read(b"NVSPREC2aaaa"), Err(RecordingError::Foreign(_))));
    }
}
