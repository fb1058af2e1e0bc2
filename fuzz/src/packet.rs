//! Packets and the difference pictures in them: any bytes must give an error or a picture.
//!
//! Random bytes hardly ever match a check. So the first byte of the input says which checks to make right first.
use nvsprior::coder_tables::Tables;
use nvsprior::packet::{CAMERA_PART_LEN, Residual, SHORT_LATENT_LEN, Salvage, Session};
use nvsprior::residual::{Placement, ResidualDecoder, StreamFrame, Viewpoint};
use nvsprior::{Camera, Packet, Picture};

#[path = "predicted.rs"]
mod predicted;

/// Pixels of a picture that is decoded here.
const PIXELS: u32 = 64 * 64;

pub fn run(input: &[u8]) {
    predicted::run(input);
    let Some((&repairs, bytes)) = input.split_first() else { return };
    let mut bytes = bytes.to_vec();
    if repairs & 1 != 0 {
        repair_latent(&mut bytes);
    }
    if repairs & 2 != 0 {
        repair_residual(&mut bytes);
    }
    let Ok(salvage) = Packet::salvage(&bytes) else { return };
    if let Ok(packet) = Packet::decode(&bytes) {
        let again = packet.encode().expect("what was read can be written");
        assert_eq!(Packet::decode(&again), Ok(packet));
    }
    let (width, height) = match salvage.latent.session {
        Session::Stated { width, height, .. } => (width, height),
        Session::Tagged(_) => (64, 48),
    };
    if width * height > PIXELS {
        return;
    }
    let mut picture = Picture::new(width, height);
    let mut decoder = ResidualDecoder::new(width, height, &Tables::generic());
    if let Ok(residual) = &salvage.residual {
        let _ = decoder.add(residual, true, &mut picture);
    }
    add_in_stream(&salvage, &mut decoder, &mut picture);
    if let Some(start) = &salvage.residual_start
        && let Ok(rows) = decoder.add_start(start, true, &mut picture)
    {
        assert!(rows <= height);
    }
}

/// The residual as one of a stream, three times: later ones are predicted from the first, and from each other.
fn add_in_stream(salvage: &Salvage, decoder: &mut ResidualDecoder, picture: &mut Picture) {
    let (width, height) = (picture.width, picture.height);
    let (fx, cx, cy) = (width as f32, width as f32 / 2.0, height as f32 / 2.0);
    let camera = Camera { width, height, fx, fy: fx, cx, cy };
    // Any numbers, from the packet's own bytes.
    let words = salvage.latent.pose.words().words.map(|word| word as f32 / 131_072.0);
    let placement = Placement {
        rotation: [words[3], words[4], words[5], words[6]],
        translation: [words[0], words[1], words[2]],
    };
    let depths: Vec<f32> = (0..width * height).map(|i| words[i as usize % 7] * 8.0).collect();
    let viewpoint = Viewpoint { camera, placement };
    for number in 0..3 {
        let frame = StreamFrame { frame: number, viewpoint: &viewpoint, depths: &depths };
        if let Ok(Residual::Stream { reference, small_blocks, payload }) = salvage.residual {
            let residual = |reference| Residual::Stream { reference, small_blocks, payload };
            let _ = decoder.add_in_stream(&residual(None), &frame, true, picture);
            let frame = StreamFrame { frame: number + 1, ..frame };
            let _ = decoder.add_in_stream(&residual(reference), &frame, true, picture);
        }
        if let Some(start) = &salvage.residual_start {
            let _ = decoder.add_start_in_stream(start, &frame, true, picture);
        }
    }
}

/// Length of the latent part, by the flags.
fn latent_len(bytes: &[u8]) -> usize {
    match bytes.get(1).map(|flags| flags & 3) {
        Some(2) => 43,
        Some(0 | 3) => SHORT_LATENT_LEN,
        _ => 31,
    }
}

/// Makes the first byte, and the latent part's check, those of a packet.
fn repair_latent(bytes: &mut [u8]) {
    let len = latent_len(bytes);
    let Some(part) = bytes.get_mut(..len) else { return };
    part[0] = if len == SHORT_LATENT_LEN { 0xB4 } else { 0xB1 };
    let check = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&part[..len - 2]);
    part[len - 2..].copy_from_slice(&check.to_le_bytes());
}

/// Sets the residual part's length to the bytes that are there, and makes its check right.
fn repair_residual(bytes: &mut Vec<u8>) {
    let latent = latent_len(bytes);
    let camera = if bytes.get(1).is_some_and(|flags| flags & 8 != 0) { CAMERA_PART_LEN } else { 0 };
    let start = latent + camera;
    if bytes.len() < start + 2 {
        return;
    }
    let payload = bytes.len() - start - 2;
    bytes[start] = 0x80 | (payload & 0x7F) as u8;
    bytes[start + 1] = (payload >> 7 & 0x7F) as u8;
    if latent == SHORT_LATENT_LEN {
        let bound = [&crc32fast::hash(&bytes[..latent]).to_le_bytes(), &bytes[start..]].concat();
        let check = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&bound);
        bytes.extend(check.to_le_bytes());
        return;
    }
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes[..latent]);
    hasher.update(&bytes[start..]);
    bytes.extend(hasher.finalize().to_le_bytes());
}
