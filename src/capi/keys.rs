//! Keys that both sides hold.

use crate::keys::{Key, Keys, MAX_KEYS, Seen};

use super::slices::slice;
use super::status::*;
use super::structs::{In, versioned};

/// Bytes of a key.
pub const NVSP_KEY_BYTES: usize = 32;

/// Keys that both sides hold. What goes to the other side gets 2 bytes of number and a tag in front. What comes without
/// the right tag, or a second time, is refused before anything else of it is read. If an nvsp_sender divides the
/// packets, give the keys to it and to the nvsp_collector, else to encoder and decoder. Example:
///
/// ```c
/// nvsp_keys keys = NVSP_INITIALIZER(nvsp_keys);
/// keys.keys = key; // 32 random bytes
/// keys.count = 1;
/// keys.epoch = dive;
/// options.keys = &keys;
/// ```
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_keys {
    pub struct_size: u32,
    pub abi_version: u32,
    /// `count` keys of NVSP_KEY_BYTES bytes each, one after the other. Tags are made by the first, and checked by all.
    /// The library copies them, and erases its copies when they are not needed any more.
    pub keys: *const u8,
    /// Number of keys, 1 to 4.
    pub count: u32,
    /// Bytes of a tag, 2 to 16. Both sides need the same. 0: 4.
    pub tag_bytes: u32,
    /// Both sides need the same, and nothing of another epoch passes: count the dives, for example.
    pub epoch: u64,
    /// Number of the first thing that this side sends, below 2^48. A side that starts again within an epoch goes on
    /// with `next_number` of nvsp_frame_stats, nvsp_sender_statistics or nvsp_collector_statistics: numbers that the
    /// other side has taken are refused. Two encoders need other keys, or other epochs.
    pub number: u64,
    /// Of each stream: numbers below this one count as taken, by the first key. A side that starts again within an
    /// epoch gives what `taken` of nvsp_collector_statistics or nvsp_sender_statistics told, or in the first place
    /// nvsp_decoded.taken. Without it, what came before may pass once more until something newer has come. 0: none.
    pub taken: [u64; 4],
}
versioned!(nvsp_keys, 72);

/// The keys; `None`: NULL.
pub(super) fn keys_of(given: In<nvsp_keys>) -> Result<Option<Keys>, Failure> {
    let Some(given) = given.optional()? else { return Ok(None) };
    let count = given.count as usize;
    if !(1..=MAX_KEYS).contains(&count) {
        return Err(Failure::argument("nvsp_keys.count: not 1 to 4"));
    }
    // SAFETY: so many bytes stand there, as the header asks.
    let bytes = unsafe { slice(given.keys, count * NVSP_KEY_BYTES, "nvsp_keys.keys")? };
    let (all, _) = bytes.as_chunks::<NVSP_KEY_BYTES>();
    let mut keys = Keys::new(all.iter().map(|key| Key::new(*key)))?
        .with_epoch(given.epoch)
        .with_number(given.number)?;
    if given.tag_bytes != 0 {
        keys = keys.with_tag_bytes(given.tag_bytes as usize)?;
    }
    let first = keys.ids().next();
    let taken = (0..).zip(given.taken).filter_map(|(stream, below)| {
        Some(Seen { key: first?, stream, number: below.checked_sub(1)? })
    });
    Ok(Some(keys.with_seen(taken)))
}

/// As nvsp_keys.taken has it.
pub(super) fn taken_of(seen: impl Iterator<Item = Seen>) -> [u64; 4] {
    let mut taken = [0; 4];
    let mut first = None;
    // Those of the first key come first.
    for seen in seen {
        if *first.get_or_insert(seen.key) == seen.key
            && let Some(place) = taken.get_mut(usize::from(seen.stream))
        {
            *place = seen.number + 1;
        }
    }
    taken
}
