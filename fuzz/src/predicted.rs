//! Packets in the predicted form: any bytes give an error or a packet, and what is written is read.
//!
//! Their check needs the poses that they are predicted from. So some are made from the input's first bytes, as packets
//! in the short form hold them, and a packet is written from another one.
use nvsprior::packet::{Coder, Extent, HeldPoses, Latent, Packet, Residual, Session, valid_len};

/// Bytes of a pose in the short form, and where they lie.
const POSE: usize = 12;
const AT: usize = 5;
/// Poses that are held, and what they are about.
const HELD: u8 = 4;
const SESSION: u32 = 7;

pub fn run(input: &[u8]) {
    let mut held = HeldPoses::default();
    let (first, rest) = input.split_at(input.len().min(POSE));
    let Some(latent) = short(first, 0) else { return };
    for number in 0..HELD {
        let moved = [first, &[number]].concat();
        if let Some(latent) = short(&moved, number) {
            held.hold(number.into(), &latent, SESSION);
        }
    }
    read(&[&[0x80 | first[0] & 0xF, HELD][..], rest].concat(), &held);
    let (next, payload) = rest.split_at(rest.len().min(1));
    let offset = next.first().copied().unwrap_or(0);
    let Some(latent) = short(&[first, &[offset]].concat(), HELD).or(Some(latent)) else { return };
    let Some(predicted) = held.predict(latent.frame, &latent, SESSION) else { return };
    let residual = Residual::Coded { coder: Coder::Wavelet, payload };
    let packet = Packet { latent: predicted, camera: None, render: None, residual, truth: None };
    let bytes = packet.encode().expect("what was predicted can be written");
    let again = Packet::salvage_with(&bytes, &held).expect("and read");
    assert_eq!((again.latent, again.residual), (latent, Ok(residual)));
    for (at, by) in payload.chunks_exact(2).map(|pair| (usize::from(pair[0]), pair[1])) {
        let mut damaged = bytes.clone();
        let len = damaged.len();
        damaged[at % len] ^= by;
        read(&damaged, &held);
        read(&damaged[..at % len], &held);
    }
}

fn read(bytes: &[u8], held: &HeldPoses) {
    let _ = Packet::salvage_with(bytes, held);
    let valid = valid_len(bytes);
    assert!(valid <= bytes.len());
    if let Ok(extent) = Extent::read(bytes) {
        let is_predicted = extent.told_by_shares > 0;
        assert!(!is_predicted || (extent.latent..=bytes.len()).contains(&valid));
    }
}

/// A latent part in the short form; `moved`: its pose's bytes, and what is added to the first one of each number.
fn short(moved: &[u8], number: u8) -> Option<Latent> {
    let (pose, offset) = moved.split_at_checked(POSE)?;
    let offset = offset.first().copied().unwrap_or(0);
    let mut bytes = vec![0xB4, 3, number, 0, 9];
    bytes.extend(pose);
    for at in [0, 2, 4, 6, 8] {
        bytes[AT + at] = bytes[AT + at].wrapping_add(offset);
    }
    // Its largest component is the first one.
    bytes[AT + POSE - 1] &= 0x1F;
    let check = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&bytes);
    bytes.extend(check.to_le_bytes());
    let latent = Latent::decode(&bytes).ok()?;
    matches!(latent.session, Session::Tagged(_)).then_some(latent)
}
