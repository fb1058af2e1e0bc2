//! Bytes made a packet. Random bytes hardly ever match a check.

use nvsprior::packet::{CAMERA_PART_LEN, LEARNT_SHORT_LEN, RENDER_PART_LEN, SHORT_LATENT_LEN};

use super::SIZES;

/// Bits of the first byte: the latent part is made valid.
const LATENT: u8 = 1;
/// The parts after it are made valid.
const PARTS: u8 = 1 << 1;
/// The end of the packet is missing. Bits 5 to 7 say how much.
const CUT: u8 = 1 << 3;

/// Flags of a packet: the camera part follows, the render part follows.
const CAMERA: u8 = 1 << 3;
const RENDER: u8 = 1 << 7;

/// Versions of the full form and of the short one.
const FULL: [u8; 4] = [1, 2, 8, 11];
const SHORT: [u8; 4] = [4, 7, 13, 14];

pub fn repair(choice: u8, bytes: &mut Vec<u8>) {
    if choice & LATENT != 0 && bytes.len() >= 2 {
        set_version(bytes);
    }
    let Some(latent) = latent_len(bytes) else { return };
    if choice & PARTS != 0 {
        repair_camera(latent, bytes);
    }
    if choice & LATENT != 0 {
        repair_latent(latent, bytes);
    }
    if choice & PARTS != 0 {
        let camera = if bytes[1] & CAMERA != 0 { CAMERA_PART_LEN } else { 0 };
        let render = if bytes[1] & RENDER != 0 { RENDER_PART_LEN } else { 0 };
        repair_render(latent, latent + camera, bytes);
        repair_residual(latent, latent + camera + render, bytes);
    }
    if choice & CUT != 0 {
        let cut = bytes.len() * usize::from(1 + (choice >> 5)) / 16;
        bytes.truncate(bytes.len() - cut);
    }
}

fn crc16(parts: &[&[u8]]) -> [u8; 2] {
    crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&parts.concat()).to_le_bytes()
}

/// Makes the first byte that of a packet, and the flags some that go with it.
fn set_version(bytes: &mut [u8]) {
    let version = bytes[0] & 0xF;
    let number = usize::from(version);
    let known = FULL.contains(&version) || SHORT.contains(&version);
    // Half of the others have the short form.
    let others = if number & 8 == 0 { SHORT } else { FULL };
    let version = if known { version } else { others[number % others.len()] };
    bytes[0] = 0xB0 | version;
    let profile = bytes[1] & 0b11;
    if FULL.contains(&version) && !matches!(profile, 1 | 2) {
        bytes[1] ^= 0b1;
    }
    if SHORT.contains(&version) {
        bytes[1] &= !CAMERA;
        bytes[1] = bytes[1] & !0b11 | if profile & 1 == 0 { 0 } else { 3 };
    }
}

/// Length of the latent part; `None`: it is not all there, or has no known version.
fn latent_len(bytes: &[u8]) -> Option<usize> {
    let [first, flags, ..] = *bytes else { return None };
    let version = first & 0xF;
    let len = match (FULL.contains(&version), version) {
        (true, _) => 15 + if flags & 0b11 == 2 { 28 } else { 16 },
        (false, 4 | 7) => SHORT_LATENT_LEN,
        (false, 13 | 14) => LEARNT_SHORT_LEN,
        _ => return None,
    };
    (len <= bytes.len()).then_some(len)
}

/// Makes a full form's size one that is decoded, and the check right.
fn repair_latent(len: usize, bytes: &mut [u8]) {
    if is_full(bytes) {
        let (width, height) = SIZES[usize::from(bytes[9]) % SIZES.len()];
        bytes[9..12].copy_from_slice(&((width - 1) | (height - 1) << 12).to_le_bytes()[..3]);
    }
    let check = crc16(&[&bytes[..len - 2]]);
    bytes[len - 2..len].copy_from_slice(&check);
}

fn is_full(bytes: &[u8]) -> bool {
    FULL.contains(&(bytes[0] & 0xF))
}

/// Makes the camera's check right, and the tag in the latent part that of the camera.
fn repair_camera(latent: usize, bytes: &mut [u8]) {
    let end = latent + CAMERA_PART_LEN;
    if bytes[1] & CAMERA == 0 || !is_full(bytes) || bytes.len() < end {
        return;
    }
    // The size is made one of these later: here as there.
    let (width, height) = SIZES[usize::from(bytes[9]) % SIZES.len()];
    let size = ((width - 1) | (height - 1) << 12).to_le_bytes();
    let check = crc16(&[&size[..3], &bytes[latent..end - 2]]);
    bytes[end - 2..end].copy_from_slice(&check);
    bytes[latent - 3] = check[0];
}

fn repair_render(latent: usize, start: usize, bytes: &mut [u8]) {
    let end = start + RENDER_PART_LEN;
    if bytes[1] & RENDER != 0 && bytes.len() >= end {
        let check = crc16(&[&bytes[..latent], &bytes[start..end - 2]]);
        bytes[end - 2..end].copy_from_slice(&check);
    }
}

/// Sets the residual part's length to the bytes that are there, and makes its check right.
fn repair_residual(latent: usize, start: usize, bytes: &mut Vec<u8>) {
    if bytes.len() < start + 2 {
        return;
    }
    let payload = bytes.len() - start - 2;
    bytes[start] = 0x80 | (payload & 0x7F) as u8;
    bytes[start + 1] = (payload >> 7 & 0x7F) as u8;
    if !is_full(bytes) {
        let check = crc16(&[&crc32fast::hash(&bytes[..latent]).to_le_bytes(), &bytes[start..]]);
        bytes.extend(check);
        return;
    }
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes[..latent]);
    hasher.update(&bytes[start..]);
    bytes.extend(hasher.finalize().to_le_bytes());
}
