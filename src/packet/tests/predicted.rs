//! The predicted form: what is written is read, and nothing else.

use super::*;

const STATE: u32 = 0x1234_5678;

/// A pose of a vehicle that moves evenly, at a time in frames, and shakes by so many steps.
fn moving(time: f64, shake: f64) -> QuantisedPose {
    let shaken = |k: f64| shake * (time * k).sin();
    let turn = 0.004 * time + 1e-4 * shaken(7.0);
    let rotation = DQuat::from_rotation_y(turn) * DQuat::from_rotation_x(0.2);
    let centre = DVec3::from(FRAME.centre.map(f64::from))
        + DVec3::new(0.02 * time, -0.01 * time, 2e-4 * shaken(11.0));
    let pose = Pose::from_centre(rotation, centre);
    QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Short).unwrap()
}

fn short(frame: u32, pose: QuantisedPose) -> Latent {
    let latent = Latent::new(frame, PRIOR, &CAMERA, pose, false).unwrap();
    latent.shortened(PRIOR, &CAMERA).unwrap()
}

/// A side that holds the poses of some frames.
fn holding(frames: impl Iterator<Item = u32>, shake: f64) -> HeldPoses {
    let mut held = HeldPoses::default();
    frames.for_each(|n| held.hold(n, &short(n, moving(n.into(), shake)), STATE));
    held
}

fn predicted(held: &HeldPoses, frame: u32, shake: f64) -> Latent {
    let latent = short(frame, moving(frame.into(), shake));
    held.predict(frame, &latent, STATE).expect("it pays")
}

fn wavelet(payload: &[u8]) -> Residual<'_> {
    Residual::Coded { coder: Coder::SmallBlocks, payload }
}

fn packet_of<'a>(latent: Latent, residual: Residual<'a>) -> Packet<'a> {
    Packet { latent, camera: None, render: None, residual, truth: None }
}

#[test]
fn bytes_are_pinned() {
    let latent = predicted(&holding(95..=100, 1.0), 104, 1.0);
    let bytes = packet_of(latent, wavelet(b"difference")).encode().unwrap();
    assert_eq!(hex(&bytes), PINNED);
}

const PINNED: &str = "8ce80d00180400ea37646966666572656e636540";

#[test]
fn motion_that_goes_on_takes_few_bytes() {
    // Two of the form, fifteen bits of how it is predicted, six numbers of three bits, and two of check.
    let still = holding([7].into_iter(), 0.0);
    let latent = short(9, moving(7.0, 0.0));
    assert_eq!(still.predict(9, &latent, STATE).unwrap().encoded_len(), 9);
    let lens = [1, 5, 20].map(|ahead| {
        let held = holding(90..=100, 0.0);
        predicted(&held, 100 + ahead, 0.0).encoded_len()
    });
    assert!(lens[0] <= 10 && lens[2] <= 12, "{lens:?}");
    // The reference alone tells no motion.
    let alone = predicted(&holding([100].into_iter(), 0.0), 105, 0.0).encoded_len();
    assert!(alone > lens[1] + 2, "{alone} {lens:?}");
}

#[test]
fn far_poses_keep_the_short_form() {
    let held = holding([100].into_iter(), 0.0);
    let far = short(101, moving(1400.0, 0.0));
    assert_eq!(held.predict(101, &far, STATE), None);
    let near = short(165, moving(100.0, 0.0));
    assert_eq!(held.predict(165, &near, STATE), None, "the reference lies too far back");
    let other = short(101, moving(100.0, 0.0));
    assert_eq!(held.predict(101, &other, STATE + 1), None, "another session");
}

proptest! {
    #[test]
    fn what_is_written_is_read(
        start in 0u32..1 << 24,
        lost in proptest::collection::vec(any::<bool>(), 40),
        shake in 0.0..200.0f64,
        ahead in 1u32..30,
        learnt in any::<bool>(),
        portable in any::<bool>(),
        payload in proptest::collection::vec(any::<u8>(), 0..40),
    ) {
        let mut held = HeldPoses::default();
        let latent_of = |k: u32| {
            let frame = start.wrapping_add(k) % Latent::FRAMES;
            let pose = moving(f64::from(k) - 30.0, shake);
            let latent = Latent { portable, ..short(frame, pose) };
            (frame, if learnt { latent.with_update(3) } else { latent })
        };
        for (k, lost) in (0..).zip(&lost) {
            let (frame, latent) = latent_of(k);
            if !lost {
                held.hold(frame, &latent, STATE);
            }
        }
        let (frame, latent) = latent_of(lost.len() as u32 + ahead - 1);
        let Some(predicted) = held.predict(frame, &latent, STATE) else { return Ok(()) };
        prop_assert!(predicted.encoded_len() < latent.encoded_len());
        let bytes = packet_of(predicted, wavelet(&payload)).encode().unwrap();
        prop_assert_eq!(bytes.len(), predicted.encoded_len() + payload.len() + 1);
        prop_assert_eq!(valid_len(&bytes), bytes.len());
        let extent = Extent::read(&bytes).unwrap();
        prop_assert_eq!((extent.head, extent.is_open), (predicted.encoded_len(), true));
        prop_assert!(extent.may_be(frame));
        let read = Packet::salvage_with(&bytes, &held).unwrap();
        // All is as the short form would say it.
        prop_assert_eq!(read.latent, Latent { frame: read.latent.frame, ..latent });
        prop_assert_eq!(read.latent.frame % Latent::FRAMES, frame);
        prop_assert_eq!(read.residual, Ok(wavelet(&payload)));
    }

    #[test]
    fn any_bytes_are_read_or_refused(
        kind in 0u8..16,
        bytes in proptest::collection::vec(any::<u8>(), 0..60),
    ) {
        let bytes = [&[0x80 | kind][..], &bytes].concat();
        let held = holding(0..128, 3.0);
        let _ = Packet::salvage_with(&bytes, &held);
        let _ = Extent::read(&bytes);
        prop_assert!(valid_len(&bytes) <= bytes.len());
    }
}

#[test]
fn what_is_not_held_is_named() {
    let held = holding(95..=100, 1.0);
    let bytes = packet_of(predicted(&held, 104, 1.0), Residual::None).encode().unwrap();
    assert!(Packet::salvage_with(&bytes, &held).is_ok());
    let reference = (1..=6).map(|d| 100 - d + 1).find(|n| {
        let mut without = held.clone();
        without.forget(*n);
        let missing = PacketError::PoseNotHeld { frame: 104, reference: *n };
        Packet::salvage_with(&bytes, &without).err() == Some(missing)
    });
    assert!(reference.is_some());
    // Without any pose, only the low bits of the number are known.
    assert!(matches!(Packet::decode(&bytes), Err(PacketError::PoseNotHeld { frame: 104, .. })));
    // Of the same numbers, but another vehicle's.
    let others = holding(95..=100, 2.0);
    let refused = Packet::salvage_with(&bytes, &others).err();
    assert_eq!(refused, Some(PacketError::Check(Part::Latent)));
    let mut others = others;
    others.refuse(&bytes, &PacketError::Check(Part::Latent));
    let refused = Packet::salvage_with(&bytes, &others).err();
    assert!(matches!(refused, Some(PacketError::PoseNotHeld { .. })), "it is forgotten");
    let mut session = HeldPoses::default();
    (95..=100).for_each(|n| session.hold(n, &short(n, moving(n.into(), 1.0)), STATE + 1));
    let refused = Packet::salvage_with(&bytes, &session).err();
    assert_eq!(refused, Some(PacketError::Check(Part::Latent)));
}

#[test]
fn damage_is_found() {
    let held = holding(95..=100, 1.0);
    let latent = predicted(&held, 104, 1.0);
    let bytes = packet_of(latent, wavelet(b"difference")).encode().unwrap();
    let len = latent.encoded_len();
    let pose = Packet::salvage_with(&bytes, &held).unwrap().latent.pose;
    let flip = |bits: &[usize]| {
        let mut damaged = bytes.clone();
        bits.iter().for_each(|bit| damaged[bit / 8] ^= 1 << (bit % 8));
        damaged
    };
    const WHOLE_BIT: usize = 15;
    for a in 0..8 * len {
        for b in a..8 * len {
            let bits = if a == b { vec![a] } else { vec![a, b] };
            let damaged = flip(&bits);
            let read = Packet::salvage_with(&damaged, &held);
            let only_end = bits == [WHOLE_BIT];
            assert_eq!(read.is_ok(), only_end, "bits {bits:?}: {read:?}");
        }
    }
    for bit in 8 * len..8 * bytes.len() {
        let damaged = flip(&[bit]);
        let read = Packet::salvage_with(&damaged, &held).unwrap();
        assert_eq!(read.latent.pose, pose);
        assert_eq!(read.residual, Err(PacketError::Check(Part::Residual)), "bit {bit}");
        assert_eq!(read.residual_start, None);
    }
}

#[test]
fn a_start_of_it_is_a_start() {
    let held = holding(95..=100, 1.0);
    let latent = predicted(&held, 104, 1.0);
    let mut bytes = packet_of(latent, wavelet(b"difference")).encode().unwrap();
    let len = latent.encoded_len();
    // As a collector gives it.
    bytes[1] &= 0x7F;
    for end in 0..len {
        assert!(Packet::salvage_with(&bytes[..end], &held).is_err(), "{end}");
    }
    for end in len..bytes.len() {
        let read = Packet::salvage_with(&bytes[..end], &held).unwrap();
        assert!(read.residual.is_err(), "{end}");
        assert_eq!(read.residual_start.unwrap().payload, &bytes[len..end]);
        assert_eq!(valid_len(&bytes[..end]), len);
    }
}

#[test]
fn what_it_cannot_say_is_refused() {
    let latent = predicted(&holding(95..=100, 1.0), 104, 1.0);
    let uncertain = Latent { uncertain: true, ..latent };
    let packets = [
        packet_of(uncertain, Residual::None),
        packet_of(latent, coded(b"VP8")),
        Packet { render: Some(RenderCheck(7)), ..packet_of(latent, Residual::None) },
        Packet { camera: Some(CAMERA), ..packet_of(latent, Residual::None) },
    ];
    for packet in packets {
        assert_eq!(packet.encode(), Err(PacketError::Predicted));
    }
}

#[test]
fn a_vehicle_predicts_from_what_is_acknowledged() {
    let mut sent = SentPoses::new();
    let latent = |n: u32| short(n, moving(n.into(), 1.0));
    let add = |sent: &mut SentPoses, n| {
        let written = sent.predicted(n, &latent(n), STATE);
        sent.add(n, &written, STATE);
        written.is_predicted()
    };
    assert!((0..10).all(|n| !add(&mut sent, n)), "nothing is acknowledged");
    sent.acknowledge(77, true);
    assert!(!add(&mut sent, 10), "it was never sent");
    sent.acknowledge(0x1_0004, true);
    assert!(add(&mut sent, 11), "numbers in reports are modulo 2¹⁶");
    sent.acknowledge(4, false);
    assert!(!add(&mut sent, 12));
    sent.acknowledge(11, true);
    let stated: Vec<_> = (13..60).filter(|n| !add(&mut sent, *n)).collect();
    assert_eq!(stated, [29, 46], "one in a while stands by itself");
    sent.forget_acknowledged();
    assert!(!add(&mut sent, 60));
}
