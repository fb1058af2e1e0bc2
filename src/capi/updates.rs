//! Updates of the prior: what a vehicle learns, on its way to the topside.

use crate::Decoder;
use crate::modem::{ModemError, Report};
use crate::prior::Update;

use super::collector::nvsp_collector;
use super::decoder::nvsp_decoder;
use super::encoding::nvsp_encoder;
use super::learning;
use super::limits::Limits;
use super::memory::Grant;
use super::sender::nvsp_sender;
use super::slices::{Room, slice, slice_mut};
use super::status::*;
use super::structs::{Out, Place, versioned, zeroed};

/// Bytes that always suffice for an update that this library's encoders make.
#[allow(dead_code)] // For C alone.
pub const NVSP_UPDATE_BYTES: usize = 65_536;

/// Host memory that an update takes at most: the states that are held, and one more.
const HELD: u64 = 8 << 20;

/// What an encoder has learnt.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_learning {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Number of the newest update that frames are drawn with; 0: none.
    pub newest: u32,
    /// Splats that were learnt and are still there.
    pub splats: u32,
    /// Updates that were given out since the encoder began to learn.
    pub updates: u32,
    /// Updates that did not pay for their bytes, and were dropped.
    pub refused: u32,
    /// Bytes of the updates given out.
    pub update_bytes: u64,
}
versioned!(nvsp_learning, 32);

/// Learns from the last frame: a slice of work, of nvsp_encoder_options.learn steps at most. Call it after each frame,
/// once its packet is on its way: so learning delays no packet. A frame without this call is not learnt from. If the
/// encoder does not learn, nothing happens.
///
/// Fails with NVSP_ERR_UNFINISHED (a frame is under way) or NVSP_ERR_ARGUMENT, and nothing happens. If the device
/// fails, it fails as nvsp_encode does; the encoder then goes on without learning.
///
/// # Parameters
/// - `price`: bytes of pictures that a byte of an update costs. 1 or more; on a link what nvsp_sender_update_price
///   tells.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_learn(encoder: Option<&nvsp_encoder>, price: f64) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        if !(price.is_finite() && price >= 1.0) {
            return Err(Failure::argument("price"));
        }
        learning::learn_more(&mut content.core()?.encoder, price)?;
        Ok(NVSP_OK)
    })
}

/// Copies the update that the frames so far have proved. It adds to the prior what they show and the prior does not.
/// Ask after each nvsp_encoder_learn. Returns NVSP_PENDING if there is none, and writes nothing then. Give it to
/// nvsp_sender_push_update, and keep it for the next dive: nvsp_encoder_add_update. Frames are drawn with it from
/// nvsp_encoder_adopt_update on. Until then, or until nvsp_encoder_drop_update, no other one comes.
///
/// Fails with NVSP_ERR_UNFINISHED (a frame is under way) or NVSP_ERR_BUFFER_TOO_SMALL: the update is then kept.
///
/// # Safety
/// - `update`: receives the update. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `update`; NVSP_UPDATE_BYTES always suffices.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_encoder_take_update(
    encoder: Option<&nvsp_encoder>,
    update: *mut u8,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        // SAFETY: `size` bytes stand at `update`, see `# Safety`.
        let mut room = unsafe { Room::new(update, size, written, "update")? };
        let mut core = content.core()?;
        if core.update.is_none() {
            core.update = learning::take(&mut core.encoder)?;
        }
        let Some(bytes) = &core.update else { return Ok(NVSP_PENDING) };
        room.write(bytes)?;
        core.update = None;
        Ok(NVSP_OK)
    })
}

/// Draws frames from the next one on with the update that nvsp_encoder_take_update gave last, if it has this number:
/// call it with what nvsp_sender_held_update tells. Returns NVSP_PENDING if another one waits, or none.
///
/// Fails with NVSP_ERR_UNFINISHED (a frame is under way).
///
/// # Parameters
/// - `number`: the update's number.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_adopt_update(
    encoder: Option<&nvsp_encoder>,
    number: u32,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let number = u16::try_from(number).map_err(|_| Failure::argument("number"))?;
        let adopted = learning::adopt(&mut content.core()?.encoder, number)?;
        Ok(if adopted { NVSP_OK } else { NVSP_PENDING })
    })
}

/// Drops the update that waits to be adopted: it could not be sent. Learning goes on without it.
///
/// Fails with NVSP_ERR_UNFINISHED (a frame is under way).
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_drop_update(encoder: Option<&nvsp_encoder>) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let mut core = content.core()?;
        core.update = None;
        learning::drop_waiting(&mut core.encoder)?;
        Ok(NVSP_OK)
    })
}

/// Draws frames from the next one on with an update of an earlier dive, or of this dive before a restart. Give all of
/// them, in their order. An update that waits to be adopted is dropped.
///
/// Fails with NVSP_ERR_UPDATE, NVSP_ERR_OTHER_PRIOR, NVSP_ERR_NEWER, NVSP_ERR_MEMORY, NVSP_ERR_UNFINISHED (a frame is
/// under way), or NVSP_ERR_STATE if the prior was opened without NVSP_PRIOR_UPDATES. Nothing changes then.
///
/// # Safety
/// - `update`: the update. Read during the call. Not NULL.
/// - `size`: bytes of `update`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_encoder_add_update(
    encoder: Option<&nvsp_encoder>,
    update: *const u8,
    size: usize,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        // SAFETY: `size` bytes stand at `update`, see `# Safety`.
        let bytes = unsafe { slice(update, size, "update")? };
        let mut core = content.core()?;
        let _memory = room(&core.limits)?;
        let mut learnt = core.encoder.learnt().clone();
        learnt
            .add(&Update::read(bytes).map_err(crate::Error::from)?)
            .map_err(crate::Error::from)?;
        core.encoder.set_learnt(&learnt)?;
        core.update = None;
        Ok(NVSP_OK)
    })
}

/// Tells what an encoder has learnt. Allocates nothing.
///
/// Fails with NVSP_ERR_UNFINISHED (a frame is under way).
///
/// # Parameters
/// - `learning`: receives it, set up by NVSP_INIT. Not NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_get_learning(
    encoder: Option<&nvsp_encoder>,
    learning: Out<nvsp_learning>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let out = learning.required()?;
        let core = content.core()?;
        let learnt = core.encoder.learnt();
        let counts = learning::counts(&core.encoder);
        out.write(&nvsp_learning {
            newest: learnt.number().into(),
            splats: learnt.splats().len() as u32,
            updates: counts.updates,
            refused: counts.refused,
            update_bytes: counts.update_bytes,
            ..zeroed()
        });
        Ok(NVSP_OK)
    })
}

/// Takes an update that the vehicle sent, or one of an earlier dive. Packets that are drawn with it can be decoded from
/// here on; those of some updates before still can. Give updates in their order. One that is there already changes
/// nothing. One that stands on an earlier state begins a new chain there: the vehicle has lost what came after.
///
/// Fails with NVSP_ERR_UPDATE, NVSP_ERR_OTHER_PRIOR, NVSP_ERR_NEWER, NVSP_ERR_MEMORY, or NVSP_ERR_STATE if the prior
/// was opened without NVSP_PRIOR_UPDATES. Nothing changes then.
///
/// # Safety
/// - `update`: the update. Read during the call. Not NULL.
/// - `size`: bytes of `update`.
/// - `number`: receives the number of the newest update that is held. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_decoder_add_update(
    decoder: Option<&nvsp_decoder>,
    update: *const u8,
    size: usize,
    number: Place<u32>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let number = number.required("number")?;
        // SAFETY: `size` bytes stand at `update`, see `# Safety`.
        let bytes = unsafe { slice(update, size, "update")? };
        let added = content.change(|decoder: &mut Decoder, limits| {
            let _memory = room(limits)?;
            Ok(decoder.add_update(bytes)?)
        })?;
        number.write(added.into());
        Ok(NVSP_OK)
    })
}

/// Most bytes of a report that is read here; none of this library is longer.
const REPORT_BYTES: usize = 2048;

/// Adds to a report of nvsp_collector_report which updates the decoder holds. Without it a sender that expects reports
/// never tells of a held update. Allocates nothing.
///
/// Fails with NVSP_ERR_MODEM (no report, or no room for what is added), NVSP_ERR_ARGUMENT or NVSP_ERR_UNFINISHED (a
/// packet is under way). The report stays as it is then.
///
/// # Safety
/// - `report`: the report, in place. Yours, of `size` bytes. Not NULL.
/// - `report_size`: bytes of the report.
/// - `size`: most bytes of a modem frame, `report_size` or more.
/// - `written`: receives the report's new length, bytes. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_decoder_tell_updates(
    decoder: Option<&nvsp_decoder>,
    report: *mut u8,
    report_size: usize,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let written = written.required("written")?;
        if report.is_null() {
            return Err(Failure::null("report"));
        }
        // SAFETY: `size` bytes stand at `report`, see `# Safety`.
        let into = unsafe { slice_mut(report, size, "report")? };
        if report_size > size.min(REPORT_BYTES) {
            return Err(Failure::argument("report_size"));
        }
        let mut before = [0; REPORT_BYTES];
        before[..report_size].copy_from_slice(&into[..report_size]);
        let (mut told, user) = Report::read(&before[..report_size])?;
        content.change(|decoder, _| {
            told.tell_states(decoder.states());
            Ok(())
        })?;
        written.write(told.write(user, into)?);
        Ok(NVSP_OK)
    })
}

/// Sets memory aside for an update.
fn room(limits: &Limits) -> Result<Grant, Failure> {
    Grant::take("an update of the prior", HELD, limits.host_bytes)
}

/// Takes an update to send, in nvsp_sender_options.update_share of the bit rate. All updates of a dive are kept, and
/// come again for a topside that lacks them. After a restart of the vehicle, give all that it still has.
///
/// Fails with NVSP_ERR_ARGUMENT (the time), NVSP_ERR_STATE (the sender was made without NVSP_SENDER_UPDATES),
/// NVSP_ERR_UPDATE (it is damaged, does not stand on those before, or is too long for the MTU) or NVSP_ERR_UNFINISHED
/// (there is no more room). Nothing changes then: call nvsp_encoder_drop_update.
///
/// # Safety
/// - `now`: seconds.
/// - `update`: the update. Read during the call. Not NULL.
/// - `size`: bytes of `update`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_sender_push_update(
    sender: Option<&nvsp_sender>,
    now: f64,
    update: *const u8,
    size: usize,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        // SAFETY: `size` bytes stand at `update`, see `# Safety`.
        let bytes = unsafe { slice(update, size, "update")? };
        content.push_update(now, bytes)?;
        Ok(NVSP_OK)
    })
}

/// Tells how many bytes of pictures a byte of an update costs on this link, for nvsp_encoder_learn: its parity and
/// headers count. It changes with the loss. Allocates nothing.
///
/// Fails with NVSP_ERR_STATE if the sender was made without NVSP_SENDER_UPDATES.
///
/// # Parameters
/// - `price`: receives it, 1 or more. Not NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_update_price(
    sender: Option<&nvsp_sender>,
    price: Place<f64>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let price = price.required("price")?;
        price.write(content.update_price().ok_or(ModemError::NoUpdates)?);
        Ok(NVSP_OK)
    })
}

/// Tells the newest update that frames may be drawn with: the topside has it. Without reports it has it with a chance
/// of 99 %, at the loss that is assumed. Returns NVSP_PENDING if there is none, and writes nothing then. Allocates
/// nothing.
///
/// # Parameters
/// - `number`: receives its number, for nvsp_encoder_adopt_update. Not NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_held_update(
    sender: Option<&nvsp_sender>,
    number: Place<u32>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let number = number.required("number")?;
        let Some(held) = content.held_update() else { return Ok(NVSP_PENDING) };
        number.write(held.into());
        Ok(NVSP_OK)
    })
}

/// Copies the update that is due first. Ask after NVSP_EVENT_UPDATE: give it to nvsp_decoder_add_update, tell what came
/// of it with nvsp_collector_settle_update, and ask again. Returns NVSP_PENDING if there is none, and writes nothing
/// then. Allocates nothing.
///
/// Fails with NVSP_ERR_ARGUMENT or NVSP_ERR_BUFFER_TOO_SMALL. The update stays then.
///
/// # Safety
/// - `stream`: 0 to 3.
/// - `update`: receives the update. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `update`; nvsp_collector_options.update_bytes always suffices.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_fetch_update(
    collector: Option<&nvsp_collector>,
    stream: u32,
    update: *mut u8,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        // SAFETY: `size` bytes stand at `update`, see `# Safety`.
        let mut room = unsafe { Room::new(update, size, written, "update")? };
        let Some(bytes) = content.update(stream_of(stream)?) else { return Ok(NVSP_PENDING) };
        room.write(bytes)?;
        Ok(NVSP_OK)
    })
}

/// Tells whether the update that nvsp_collector_fetch_update gave was added. If not, it needs others before it: it is
/// given again after another one was added, unless its place is needed. Allocates nothing.
///
/// Fails with NVSP_ERR_ARGUMENT.
///
/// # Parameters
/// - `stream`: 0 to 3.
/// - `added`: not 0: nvsp_decoder_add_update returned NVSP_OK.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_collector_settle_update(
    collector: Option<&nvsp_collector>,
    stream: u32,
    added: u32,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        content.settle_update(stream_of(stream)?, added != 0);
        Ok(NVSP_OK)
    })
}

fn stream_of(stream: u32) -> Result<u8, Failure> {
    match u8::try_from(stream) {
        Ok(stream @ 0..=3) => Ok(stream),
        _ => Err(Failure::argument("stream")),
    }
}
