//! How far a decoded picture is from what the camera saw.

use nvsprior::truth::{BLOCK, TruthLevel, TruthMap};

use super::decoder::nvsp_decoder;
use super::slices::Room;
use super::status::*;
use super::structs::{Out, Place, versioned, zeroed};

/// A block is as the camera saw it.
pub const NVSP_TRUTH_AS_SEEN: u32 = 0;
/// It differs from what the camera saw.
pub const NVSP_TRUTH_DIFFERS: u32 = 1;
/// It is wrong.
pub const NVSP_TRUTH_WRONG: u32 = 2;
/// Nothing is known of it: it is memory.
pub const NVSP_TRUTH_NOT_SEEN: u32 = 3;

// The library's levels are handed out as they are.
const _: () = {
    assert!(NVSP_TRUTH_AS_SEEN == TruthLevel::AsSeen as u32);
    assert!(NVSP_TRUTH_DIFFERS == TruthLevel::Differs as u32);
    assert!(NVSP_TRUTH_WRONG == TruthLevel::Wrong as u32);
    assert!(NVSP_TRUTH_NOT_SEEN == TruthLevel::NotSeen as u32);
};

/// What the levels of a truth map are about.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_truth {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Blocks in a row.
    pub columns: u32,
    /// Rows of blocks.
    pub rows: u32,
    /// Pixels a side of a block. Those at the right and the lower edge of the picture may be smaller.
    pub block_size: u32,
    /// A block differs if a window of this size near it is off by more than that: the root of the mean squared error
    /// over pixels and colours, values of 0 to 255. 0: nothing is known, and all blocks are NVSP_TRUTH_NOT_SEEN.
    pub differs_above: f32,
    /// It is wrong if one is off by more than that.
    pub wrong_above: f32,
    /// Zero.
    pub reserved: u32,
}
versioned!(nvsp_truth, 32);

/// Tells how far the picture that was decoded or drawn last is from what the camera saw, block by block. Show it with
/// the picture: a prior draws what it remembers as sharply as what is there. The map never says less than what is true,
/// also if the packet was cut. It may say more of a block, if it has no room to say what is true.
///
/// All blocks are NVSP_TRUTH_NOT_SEEN if the packet had no map (nvsp_encoder_options.no_truth), if the difference
/// picture that its map is about did not arrive, if the render is not the vehicle's (NVSP_DECODED_OTHER_RENDER), or if
/// nvsp_decoder_draw drew the picture. A packet that is refused changes nothing: the map stays that of the picture
/// before. Example:
///
/// ```c
/// nvsp_truth truth = NVSP_INITIALIZER(nvsp_truth);
/// size_t size = nvsp_size_bound(NVSP_SIZE_TRUTH, info.width, info.height);
/// status = nvsp_decoder_get_truth(decoder, levels, size, &bytes, &truth);
/// if (levels[y / truth.block_size * truth.columns + x / truth.block_size] == NVSP_TRUTH_WRONG) warn(x, y);
/// ```
///
/// Fails with NVSP_ERR_STATE (no picture yet) or NVSP_ERR_BUFFER_TOO_SMALL.
///
/// # Safety
/// - `levels`: receives NVSP_TRUTH_* of the blocks, row by row, a byte each.
/// - `size`: bytes of `levels`; nvsp_size_bound suffices.
/// - `written`: receives the bytes that the map takes.
/// - `truth`: receives what they are about. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_decoder_get_truth(
    decoder: Option<&nvsp_decoder>,
    levels: *mut u8,
    size: usize,
    written: Place<usize>,
    truth: Out<nvsp_truth>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let out = truth.optional()?;
        // SAFETY: `size` bytes stand at `levels`, see `# Safety`.
        let mut room = unsafe { Room::new(levels, size, written, "levels")? };
        content.with_truth(|map| {
            room.write(&map.levels)?;
            out.write(&about(map));
            Ok(NVSP_OK)
        })
    })
}

fn about(map: &TruthMap) -> nvsp_truth {
    let [differs_above, wrong_above] = map.thresholds.unwrap_or_default();
    nvsp_truth {
        columns: map.columns,
        rows: map.rows,
        block_size: BLOCK,
        differs_above,
        wrong_above,
        ..zeroed()
    }
}
