//! What a side with keys keeps of its numbers, so that it can start again within an epoch.
//!
//! The file lies beside the key file. It has lines `epoch N`, `next N` and `seen KEY STREAM NUMBER`. Numbers are set
//! aside before they are used, so that none is used twice if the program is killed.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nvsprior::keys::{KeyError, KeyId, Keys, Seen};
use nvsprior::prior::{PriorError, replace_file};

#[derive(Debug, thiserror::Error)]
pub enum KeyStateError {
    #[error("{}: {source}", file.display())]
    Read { file: PathBuf, source: std::io::Error },
    #[error("{}: line {line} is none of a key's state; if it cannot be mended, remove it and give both sides the next \
        --epoch", file.display())]
    Line { file: PathBuf, line: usize },
    #[error("--epoch {epoch}: epoch {known} was used with this key already ({}); give both sides a greater one",
        file.display())]
    Epoch { file: PathBuf, epoch: u64, known: u64 },
    #[error(transparent)]
    Key(#[from] KeyError),
    #[error(transparent)]
    Write(#[from] PriorError),
}

/// Numbers that are set aside at once.
const AHEAD: u64 = 1024;
/// What was taken is written at most so often.
const EVERY: Duration = Duration::from_secs(2);

pub struct KeyState {
    path: PathBuf,
    epoch: u64,
    /// Numbers below it are set aside.
    reserved: u64,
    seen: Vec<Seen>,
    saved: Instant,
}

/// Who of a link's two sides keeps it: both may use one key file.
#[derive(Clone, Copy)]
pub enum Side {
    Vehicle,
    Topside,
}

impl KeyState {
    /// Goes on where this side was in the epoch of the keys, and sets numbers aside.
    pub fn open(key: &Path, side: Side, keys: Keys) -> Result<(Keys, KeyState), KeyStateError> {
        let path = key.with_added_extension(match side {
            Side::Vehicle => "vehicle",
            Side::Topside => "topside",
        });
        let (mut next, mut seen) = (0, Vec::new());
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                let kept = Kept::parse(&text);
                let kept = kept.map_err(|line| KeyStateError::Line { file: path.clone(), line })?;
                let (epoch, known) = (keys.epoch(), kept.epoch);
                if epoch < known {
                    return Err(KeyStateError::Epoch { file: path, epoch, known });
                }
                if epoch == known {
                    (next, seen) = (kept.next, kept.seen);
                }
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(source) => return Err(KeyStateError::Read { file: path, source }),
        }
        let keys = keys.with_number(next)?.with_seen(seen.iter().copied());
        let (epoch, reserved, saved) = (keys.epoch(), next + AHEAD, Instant::now());
        let state = KeyState { path, epoch, reserved, seen, saved };
        state.save()?;
        Ok((keys, state))
    }

    /// Keeps the number of what goes next, and what was taken. Call it before something goes.
    pub fn keep(
        &mut self,
        next: u64,
        seen: impl Iterator<Item = Seen>,
    ) -> Result<(), KeyStateError> {
        let short = next + AHEAD / 2 >= self.reserved;
        if !short && self.saved.elapsed() < EVERY {
            return Ok(());
        }
        self.saved = Instant::now();
        let seen: Vec<Seen> = seen.collect();
        if short || seen != self.seen {
            self.reserved = next + AHEAD;
            self.seen = seen;
            self.save()?;
        }
        Ok(())
    }

    fn save(&self) -> Result<(), KeyStateError> {
        let mut text = format!("epoch {}\nnext {}\n", self.epoch, self.reserved);
        for Seen { key, stream, number } in &self.seen {
            text += &format!("seen {key} {stream} {number}\n");
        }
        Ok(replace_file(&self.path, text.as_bytes())?)
    }
}

/// The content of the file.
struct Kept {
    epoch: u64,
    next: u64,
    seen: Vec<Seen>,
}

impl Kept {
    /// # Errors
    /// With the line that is wrong.
    fn parse(text: &str) -> Result<Kept, usize> {
        let mut kept = Kept { epoch: 0, next: 0, seen: Vec::new() };
        for (index, line) in text.lines().enumerate() {
            kept.take(line).ok_or(index + 1)?;
        }
        Ok(kept)
    }

    fn take(&mut self, line: &str) -> Option<()> {
        let words: Vec<&str> = line.split(' ').collect();
        match words[..] {
            ["epoch", epoch] => self.epoch = epoch.parse().ok()?,
            ["next", next] => self.next = next.parse().ok()?,
            ["seen", key, stream, number] => self.seen.push(Seen {
                key: KeyId(u32::from_str_radix(key, 16).ok()?),
                stream: stream.parse().ok()?,
                number: number.parse().ok()?,
            }),
            _ => return None,
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use nvsprior::keys::Key;

    use super::*;

    fn keys(epoch: u64) -> Keys {
        Keys::new([Key::new([3; 32])]).unwrap().with_epoch(epoch)
    }

    #[test]
    fn a_side_goes_on_and_uses_no_number_twice() {
        let folder = tempfile::tempdir().unwrap();
        let key = folder.path().join("dive.key");
        let open = |epoch| KeyState::open(&key, Side::Vehicle, keys(epoch));
        let (first, mut state) = open(2).unwrap();
        assert_eq!(first.number(), 0);
        let mut next = 0;
        // As if it were killed at any time, it begins behind what was used.
        for _ in 0..3000 {
            state.keep(next, std::iter::empty()).unwrap();
            next += 1;
            if next % 100 == 0 {
                assert!(open_number(&key, 2) >= next, "{next}");
            }
        }
        let seen = Seen { key: first.ids().next().unwrap(), stream: 1, number: 77 };
        state.reserved = 0;
        state.keep(next, [seen].into_iter()).unwrap();
        let text = std::fs::read_to_string(key.with_added_extension("vehicle")).unwrap();
        assert!(text.ends_with(&format!("seen {} 1 77\n", seen.key)), "{text}");
        assert!(matches!(open(1), Err(KeyStateError::Epoch { known: 2, .. })));
        let (other, _) = KeyState::open(&key, Side::Topside, keys(0)).unwrap();
        assert_eq!(other.number(), 0, "the other side has a file of its own");
        assert_eq!(open(3).unwrap().0.number(), 0);
    }

    /// Where a side would begin now; the file stays.
    fn open_number(key: &Path, epoch: u64) -> u64 {
        let text = std::fs::read_to_string(key.with_added_extension("vehicle")).unwrap();
        let kept = Kept::parse(&text).unwrap();
        assert_eq!(kept.epoch, epoch);
        kept.next
    }

    #[test]
    fn a_spoilt_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let key = folder.path().join("dive.key");
        for wrong in ["epoch x\n", "epoch 1\nnext 5\nseen 12\n", "\n", "next -1\n"] {
            std::fs::write(key.with_added_extension("topside"), wrong).unwrap();
            let error = KeyState::open(&key, Side::Topside, keys(0)).err().unwrap();
            assert!(matches!(error, KeyStateError::Line { .. }), "{wrong:?}: {error}");
        }
    }
}
