//! Bytes made a packet. Random bytes hardly ever match a check.

use nvsprior::packet::{RENDER_PART_LEN, SESSION_PART_LEN, SHORT_LATENT_LEN};

use super::SIZES;

/// Bits of the first byte: the latent part is made valid.
const LATENT: u8 = 1;
/// The parts after it are made valid.
const PARTS: u8 = 1 << 1;
/// The end of the packet is missing. Bits 5 to 7 say how much.
const CUT: u8 = 1 << 3;

/// Words of the pose's kind in the first byte: short, compact.
const POSE: u8 = 0x1F;
const SHORT: u8 = 0;
const COMPACT: u8 = 0b0_0111;
/// Bits of the second byte: the truth map, the session part, the render part follow.
const TRUTH: u8 = 1 << 1;
const SESSION: u8 = 1 << 2;
const RENDER: u8 = 1 << 3;
const CHECK: usize = 2;

pub fn repair(choice: u8, bytes: &mut Vec<u8>) {
    if choice & LATENT != 0 && bytes.len() >= 2 {
        // Half of all poses are short ones. All bits of the second byte are known ones.
        let kind = if bytes[0] & 1 == 0 { SHORT } else { COMPACT };
        bytes[0] = bytes[0] & !POSE | kind;
        bytes[1] &= 0x3F;
    }
    let Some(latent) = latent_len(bytes) else { return };
    if choice & PARTS != 0 {
        repair_session(latent, bytes);
    }
    if choice & LATENT != 0 {
        let check = crc16(&[&bytes[..latent - CHECK]]);
        bytes[latent - CHECK..latent].copy_from_slice(&check);
    }
    if choice & PARTS != 0 {
        let session = if bytes[1] & SESSION != 0 { SESSION_PART_LEN } else { 0 };
        let render = if bytes[1] & RENDER != 0 { RENDER_PART_LEN } else { 0 };
        repair_render(latent, latent + session, bytes);
        repair_residual(latent, latent + session + render, bytes);
    }
    if choice & CUT != 0 {
        let cut = bytes.len() * usize::from(1 + (choice >> 5)) / 16;
        bytes.truncate(bytes.len() - cut);
    }
}

fn crc16(parts: &[&[u8]]) -> [u8; CHECK] {
    crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&parts.concat()).to_le_bytes()
}

/// Length of the latent part; `None`: it is not all there, or of no kind that stands by itself.
fn latent_len(bytes: &[u8]) -> Option<usize> {
    let len = match bytes.first()? & POSE {
        SHORT => SHORT_LATENT_LEN,
        COMPACT => SHORT_LATENT_LEN + 4,
        _ => return None,
    };
    (len <= bytes.len()).then_some(len)
}

/// Makes the session's size one that is decoded, its check right, and the tag in the latent part its.
fn repair_session(latent: usize, bytes: &mut [u8]) {
    let end = latent + SESSION_PART_LEN;
    if bytes[1] & SESSION == 0 || bytes.len() < end {
        return;
    }
    let (width, height) = SIZES[usize::from(bytes[latent + 4]) % SIZES.len()];
    let size = ((width - 1) | (height - 1) << 12).to_le_bytes();
    bytes[latent + 4..latent + 7].copy_from_slice(&size[..3]);
    let check = crc16(&[&bytes[latent..end - CHECK]]);
    bytes[end - CHECK..end].copy_from_slice(&check);
    let tag = crc32fast::hash(&bytes[latent..end - CHECK]).to_le_bytes();
    bytes[4..6].copy_from_slice(&tag[..2]);
}

fn repair_render(latent: usize, start: usize, bytes: &mut [u8]) {
    let end = start + RENDER_PART_LEN;
    if bytes[1] & RENDER != 0 && bytes.len() >= end {
        let check = crc16(&[&bytes[..latent], &bytes[start..end - CHECK]]);
        bytes[end - CHECK..end].copy_from_slice(&check);
    }
}

/// Makes the residual part's check right.
fn repair_residual(latent: usize, start: usize, bytes: &mut Vec<u8>) {
    let kind = bytes[0] >> 5;
    let has_part = kind >= 3 || bytes[1] & TRUTH != 0;
    if !has_part || bytes.len() < start + CHECK {
        return;
    }
    // Zeros at the end are padding.
    bytes.extend((bytes.last() == Some(&0)).then_some(1));
    let own = crc32fast::hash(&bytes[..latent]).to_le_bytes();
    let check = crc16(&[&own, &bytes[start + CHECK..]]);
    bytes[start..start + CHECK].copy_from_slice(&check);
}
