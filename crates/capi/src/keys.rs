//! Keys that both sides hold.

use nvsprior_link::keys::{Key, Keys, MAX_KEYS, Seen};

use super::slices::slice;
use super::status::*;
use super::structs::{In, versioned};

/// Bytes of a key.
pub const NVSP_KEY_BYTES: usize = 32;

/// Keys that both sides hold. What goes to the other side gets 2 bytes of number and a tag in front. What comes without
/// the right tag, or a second time, is refused before anything else of it is read. On a link give the keys to
/// nvsp_vehicle and nvsp_topside, else to encoder and decoder. Example:
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
    /// Number of the first thing that this side sends, below 2^48. An encoder that starts again within an epoch goes on
    /// with nvsp_frame_stats.next_number: numbers that the other side has taken are refused. Two encoders need other
    /// keys, or other epochs. The state of a vehicle or a topside knows it.
    pub number: u64,
    /// Numbers below this one count as taken, by the first key. A decoder that starts again within an epoch gets what
    /// nvsp_decoded.taken told. Without it, what came before may pass once more until something newer has come. The
    /// state of a vehicle or a topside knows it. 0: none.
    pub taken: u64,
}
versioned!(nvsp_keys, 48);

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
    let taken = first.zip(given.taken.checked_sub(1));
    let taken = taken.map(|(key, number)| Seen { key, stream: 0, number });
    Ok(Some(keys.with_seen(taken)))
}

/// As nvsp_keys.taken has it.
pub(super) fn taken_of(mut seen: impl Iterator<Item = Seen>) -> u64 {
    // That of the first key comes first.
    seen.next().map_or(0, |seen| seen.number + 1)
}
