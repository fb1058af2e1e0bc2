//! Packets with predicted poses: any bytes give an error or a packet, and what is written is read.
//!
//! Their check needs the poses that they are predicted from. So some are made from the input's first bytes, as packets
//! with short poses hold them, and a packet is written from another one.
use nvsprior::packet::{Extent, HeldPoses, Latent, Packet, Parsed, Residual, Session};
use nvsprior::{Camera, PriorId};

/// Bytes of a short pose, and where they lie.
const POSE: usize = 12;
const AT: usize = 6;
/// Poses that are held, and what they are about.
const HELD: u8 = 4;
const CAMERA: Camera = Camera { width: 8, height: 8, fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0 };
const SESSION: Session = Session { prior: PriorId(7), camera: CAMERA };
/// First byte of a packet with a predicted pose and no residual.
const PREDICTED: u8 = 0b1_1001;

pub fn run(input: &[u8]) {
    let mut held = HeldPoses::default();
    let (first, rest) = input.split_at(input.len().min(POSE));
    let Some(latent) = short(first, 0) else { return };
    for number in 0..HELD {
        let moved = [first, &[number]].concat();
        if let Some(latent) = short(&moved, number) {
            held.hold(number.into(), &latent, &SESSION).expect("a camera that fits");
        }
    }
    read(&[&[PREDICTED | first[0] & 0xE0, first[1] & 0x3F, HELD, 0][..], rest].concat(), &held);
    let (next, payload) = rest.split_at(rest.len().min(1));
    let offset = next.first().copied().unwrap_or(0);
    let Some(latent) = short(&[first, &[offset]].concat(), HELD).or(Some(latent)) else { return };
    let session = SESSION.check().expect("a camera that fits");
    let Some(predicted) = held.predict(&latent, session) else { return };
    let zeros = payload.iter().rev().take_while(|byte| **byte == 0).count();
    let payload = &payload[..payload.len() - zeros];
    let residual = Residual::Coded { small_blocks: false, payload };
    let packet = Packet { latent: predicted, session: None, render: None, residual, truth: None };
    let bytes = packet.encode().expect("what was predicted can be written");
    let again = Parsed::with(&bytes, &held).expect("and read");
    let tag = session as u16;
    assert_eq!(*again.latent(), Latent { tag, ..latent });
    assert_eq!(again.residual(&bytes), Ok(residual));
    for (at, by) in payload.chunks_exact(2).map(|pair| (usize::from(pair[0]), pair[1])) {
        let mut damaged = bytes.clone();
        let len = damaged.len();
        damaged[at % len] ^= by;
        read(&damaged, &held);
        read(&damaged[..at % len], &held);
    }
}

fn read(bytes: &[u8], held: &HeldPoses) {
    let _ = Parsed::with(bytes, held);
    if let Ok(extent) = Extent::read(bytes) {
        assert!((extent.latent..=bytes.len()).contains(&extent.valid));
    }
}

/// A latent part with a short pose; `moved`: the pose's bytes, and what is added to the first one of each number.
fn short(moved: &[u8], number: u8) -> Option<Latent> {
    let (pose, offset) = moved.split_at_checked(POSE)?;
    let offset = offset.first().copied().unwrap_or(0);
    let mut bytes = vec![0, 0, number, 0, 9, 9];
    bytes.extend(pose);
    for at in [0, 2, 4, 6, 8] {
        bytes[AT + at] = bytes[AT + at].wrapping_add(offset);
    }
    // Its largest component is the first one.
    bytes[AT + POSE - 1] &= 0x1F;
    let check = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&bytes);
    bytes.extend(check.to_le_bytes());
    Latent::decode(&bytes).ok()
}
