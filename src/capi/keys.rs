//! Keys that both sides hold.

use std::ptr::null_mut;

use crate::keys::{Authenticator, Content, Key, Keys, MAX_KEYS, Seen, Verifier};

use super::handle::{Handle, fence};
use super::limits::SMALL;
use super::log::Log;
use super::memory::Grant;
use super::slices::{Room, slice};
use super::status::*;
use super::structs::{In, Place, versioned};

/// Bytes of a key.
pub const NVSP_KEY_BYTES: usize = 32;

/// Keys that both sides hold, for nvsp_sender_options.keys, nvsp_collector_options.keys, nvsp_authenticator and
/// nvsp_verifier. What goes to the other side gets 2 bytes of number and a tag in front. What comes without the right
/// tag, or a second time, is refused before anything else of it is read. Example:
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
    /// with nvsp_sender_statistics.next_number, nvsp_collector_statistics.next_number: numbers that the other side has
    /// taken are refused.
    pub number: u64,
    /// Of each stream: numbers below this one count as taken, by the first key. A side that starts again within an
    /// epoch gives what nvsp_collector_statistics.taken, nvsp_sender_statistics.taken told. Without it, what came
    /// before may pass once more until something newer has come. 0: none.
    pub taken: [u64; 4],
}
versioned!(nvsp_keys, 72);

/// What a tag is for: a modem frame from the vehicle.
pub const NVSP_CONTENT_FRAME: u32 = 0;
/// A report from the topside.
pub const NVSP_CONTENT_REPORT: u32 = 1;
/// A packet that does not go over a modem.
pub const NVSP_CONTENT_PACKET: u32 = 2;

/// Puts numbers and tags in front of what goes another way than through an nvsp_sender, such as packets in files. One
/// thread at a time may use it.
pub type nvsp_authenticator = Handle<Authenticator>;

/// Checks what an nvsp_authenticator has made. One thread at a time may use it. Example:
///
/// ```c
/// if (nvsp_verify(verifier, bytes, size, &offset) == NVSP_OK)
///     status = nvsp_decode(decoder, bytes + offset, size - offset, 0, &picture, NULL);
/// ```
pub type nvsp_verifier = Handle<Verifier>;

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

fn content_of(content: u32) -> Result<Content, Failure> {
    Ok(match content {
        NVSP_CONTENT_FRAME => Content::Frame,
        NVSP_CONTENT_REPORT => Content::Report,
        NVSP_CONTENT_PACKET => Content::Packet,
        _ => return Err(Failure::argument("content: none of NVSP_CONTENT_*")),
    })
}

/// Makes an authenticator.
///
/// Fails with NVSP_ERR_ARGUMENT or NVSP_ERR_MEMORY.
///
/// # Parameters
/// - `keys`: set up by NVSP_INIT. Read during the call. Not NULL.
/// - `content`: NVSP_CONTENT_*.
/// - `authenticator`: receives the authenticator, which nvsp_authenticator_destroy ends. Not NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_authenticator_create(
    keys: In<nvsp_keys>,
    content: u32,
    authenticator: Place<Box<nvsp_authenticator>>,
) -> nvsp_status {
    fence(|| {
        let authenticator = authenticator.required("authenticator")?;
        let keys = keys_of(keys)?.ok_or(Failure::null("keys"))?;
        let made = Authenticator::new(&keys, content_of(content)?);
        let _memory = Grant::take("an authenticator", SMALL, u64::MAX)?;
        authenticator.write(Handle::boxed(made, Log::new(None, null_mut())));
        Ok(NVSP_OK)
    })
}

/// Writes a number, a tag and the content behind them. Allocates nothing.
///
/// Fails with NVSP_ERR_ARGUMENT (the stream) or NVSP_ERR_BUFFER_TOO_SMALL. No number is used then.
///
/// # Safety
/// - `stream`: the stream that it is for, 0 to 3.
/// - `content`: what goes to the other side. Read during the call. Not NULL.
/// - `size`: bytes of it.
/// - `bytes`: receives number, tag and content. Yours, of `room` bytes. They must not overlap the content. Not NULL.
/// - `room`: bytes of `bytes`; `size`, nvsp_keys.tag_bytes and 2 suffice.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_authenticate(
    authenticator: Option<&nvsp_authenticator>,
    stream: u32,
    content: *const u8,
    size: usize,
    bytes: *mut u8,
    room: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_authenticator::call(authenticator, |authenticator| {
        // SAFETY: `room` bytes stand at `bytes`, and `size` at `content`, see `# Safety`.
        let (mut room, content) = unsafe {
            (Room::new(bytes, room, written, "bytes")?, slice(content, size, "content")?)
        };
        if stream > 3 {
            return Err(Failure::argument("stream: above 3"));
        }
        room.fill(authenticator.overhead() + size, |into| {
            into[authenticator.overhead()..].copy_from_slice(content);
            authenticator.seal(stream as u8, into);
        })?;
        Ok(NVSP_OK)
    })
}

/// Tells the number of what an authenticator makes next: nvsp_keys.number of a side that starts again.
///
/// # Parameters
/// - `number`: receives the number. Not NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_authenticator_next_number(
    authenticator: Option<&nvsp_authenticator>,
    number: Place<u64>,
) -> nvsp_status {
    nvsp_authenticator::call(authenticator, |authenticator| {
        number.required("number")?.write(authenticator.next_number());
        Ok(NVSP_OK)
    })
}

/// Ends an authenticator; NULL is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_authenticator_destroy(authenticator: Option<Box<nvsp_authenticator>>) {
    nvsp_authenticator::destroy(authenticator)
}

/// Makes a verifier.
///
/// Fails with NVSP_ERR_ARGUMENT or NVSP_ERR_MEMORY.
///
/// # Parameters
/// - `keys`: set up by NVSP_INIT. Read during the call. Not NULL.
/// - `content`: NVSP_CONTENT_*, as the authenticator's.
/// - `verifier`: receives the verifier, which nvsp_verifier_destroy ends. Not NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_verifier_create(
    keys: In<nvsp_keys>,
    content: u32,
    verifier: Place<Box<nvsp_verifier>>,
) -> nvsp_status {
    fence(|| {
        let verifier = verifier.required("verifier")?;
        let keys = keys_of(keys)?.ok_or(Failure::null("keys"))?;
        let made = Verifier::new(&keys, content_of(content)?);
        let _memory = Grant::take("a verifier", SMALL, u64::MAX)?;
        verifier.write(Handle::boxed(made, Log::new(None, null_mut())));
        Ok(NVSP_OK)
    })
}

/// Checks number and tag of what came. Each thing passes once, in about the order in which it was made: one that is 64
/// numbers behind counts as replayed. Allocates nothing.
///
/// Fails with NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED.
///
/// # Safety
/// - `bytes`: what came. Read during the call. Not NULL.
/// - `size`: bytes of it.
/// - `offset`: receives where the content begins. The content goes on to the end of the bytes. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_verify(
    verifier: Option<&nvsp_verifier>,
    bytes: *const u8,
    size: usize,
    offset: Place<usize>,
) -> nvsp_status {
    nvsp_verifier::call(verifier, |verifier| {
        let offset = offset.required("offset")?;
        // SAFETY: `size` bytes stand at `bytes`, see `# Safety`.
        let bytes = unsafe { slice(bytes, size, "bytes")? };
        verifier.verify(bytes)?;
        offset.write(verifier.overhead());
        Ok(NVSP_OK)
    })
}

/// Ends a verifier; NULL is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_verifier_destroy(verifier: Option<Box<nvsp_verifier>>) {
    nvsp_verifier::destroy(verifier)
}
