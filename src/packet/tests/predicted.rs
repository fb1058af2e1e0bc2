//! Predicted poses: what is written is read, and nothing else.

use super::*;

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

fn stated(frame: u32, pose: QuantisedPose) -> Latent {
    Latent { frame, pose, ..latent(PoseProfile::Short) }
}

/// A side that holds the poses of some frames.
fn holding(frames: impl Iterator<Item = u32>, shake: f64) -> HeldPoses {
    let mut held = HeldPoses::default();
    frames.for_each(|n| held.hold(n, &stated(n, moving(n.into(), shake)), &SESSION).unwrap());
    held
}

fn predict(held: &HeldPoses, latent: &Latent) -> Option<Latent> {
    held.predict(latent, SESSION.check().unwrap())
}

fn predicted(held: &HeldPoses, frame: u32, shake: f64) -> Latent {
    predict(held, &stated(frame, moving(frame.into(), shake))).expect("it pays")
}

fn packet_of<'a>(latent: Latent, residual: Residual<'a>) -> Packet<'a> {
    Packet { latent, session: None, render: None, residual, truth: None }
}

#[test]
fn bytes_are_pinned() {
    let latent = predicted(&holding(95..=100, 1.0), 104, 1.0);
    let bytes = packet_of(latent, small(b"difference")).encode().unwrap();
    assert_eq!(hex(&bytes), PINNED);
}

const PINNED: &str = "790168000d0018040062374535646966666572656e6365";

#[test]
fn motion_that_goes_on_takes_few_bytes() {
    // Two bytes of head, two of number, fifteen bits of how it is predicted, six numbers of three bits, two of check.
    let still = holding([7].into_iter(), 0.0);
    let latent = stated(9, moving(7.0, 0.0));
    assert_eq!(predict(&still, &latent).unwrap().encoded_len(), 11);
    let lens = [1, 5, 20].map(|ahead| {
        let held = holding(90..=100, 0.0);
        predicted(&held, 100 + ahead, 0.0).encoded_len()
    });
    assert!(lens[0] <= 12 && lens[2] <= 14, "{lens:?}");
    // The reference alone tells no motion.
    let alone = predicted(&holding([100].into_iter(), 0.0), 105, 0.0).encoded_len();
    assert!(alone > lens[1] + 2, "{alone} {lens:?}");
}

#[test]
fn far_poses_are_stated() {
    let held = holding([100].into_iter(), 0.0);
    assert_eq!(predict(&held, &stated(101, moving(1400.0, 0.0))), None);
    let late = stated(165, moving(100.0, 0.0));
    assert_eq!(predict(&held, &late), None, "the reference lies too far back");
    let other = stated(101, moving(100.0, 0.0));
    assert_eq!(held.predict(&other, SESSION.check().unwrap() + 1), None, "another session");
}

proptest! {
    #[test]
    fn what_is_written_is_read(
        start in any::<u32>(),
        lost in proptest::collection::vec(any::<bool>(), 40),
        shake in 0.0..200.0f64,
        ahead in 1u32..30,
        (portable, code) in (any::<bool>(), 0u8..8),
        payload in proptest::collection::vec(any::<u8>(), 0..40),
    ) {
        let mut held = HeldPoses::default();
        let confidence = Confidence::of_code(code);
        let (uncertain, known) = (confidence.is_uncertain(), confidence.known());
        let latent_of = |k: u32| {
            let pose = moving(f64::from(k) - 30.0, shake);
            Latent { portable, uncertain, known, ..stated(start.wrapping_add(k), pose) }
        };
        for (k, lost) in (0..).zip(&lost) {
            let latent = latent_of(k);
            if !lost {
                held.hold(latent.frame, &latent, &SESSION).unwrap();
            }
        }
        let latent = latent_of(lost.len() as u32 + ahead - 1);
        let Some(predicted) = predict(&held, &latent) else { return Ok(()) };
        prop_assert!(predicted.encoded_len() < latent.encoded_len());
        let payload = without_zeros(&payload);
        let bytes = packet_of(predicted, small(payload)).encode().unwrap();
        prop_assert_eq!(bytes.len(), predicted.encoded_len() + payload.len() + 2);
        let extent = Extent::read(&bytes).unwrap();
        prop_assert_eq!((extent.head, extent.whole), (predicted.encoded_len(), Some(bytes.len())));
        let read = Parsed::with(&bytes, &held).unwrap();
        // All is as if the pose were stated by itself.
        prop_assert_eq!(read.latent(), &latent);
        prop_assert_eq!(read.residual(&bytes), Ok(small(payload)));
    }

    #[test]
    fn any_bytes_are_read_or_refused(
        kind in 0u8..8,
        bytes in proptest::collection::vec(any::<u8>(), 0..60),
    ) {
        let bytes = [&[0b1_1001 | kind << 5][..], &bytes].concat();
        let held = holding(0..128, 3.0);
        let _ = Parsed::with(&bytes, &held);
        let _ = Extent::read(&bytes);
    }
}

#[test]
fn what_is_not_held_is_named() {
    let held = holding(95..=100, 1.0);
    let bytes = packet_of(predicted(&held, 104, 1.0), Residual::None).encode().unwrap();
    assert!(Parsed::with(&bytes, &held).is_ok());
    let reference = (1..=6).map(|d| 100 - d + 1).find(|n| {
        let mut without = held.clone();
        without.forget(*n);
        let missing = PacketError::PoseNotHeld { frame: 104, reference: *n };
        Parsed::with(&bytes, &without).err() == Some(missing)
    });
    assert!(reference.is_some());
    // Without any pose, only the low bits of the number are known.
    assert!(matches!(Packet::decode(&bytes), Err(PacketError::PoseNotHeld { frame: 104, .. })));
    // Of the same numbers, but another vehicle's.
    let others = holding(95..=100, 2.0);
    let refused = Parsed::with(&bytes, &others).err();
    assert_eq!(refused, Some(PacketError::Check(Part::Latent)));
    let mut others = others;
    others.refuse(&bytes, &PacketError::Check(Part::Latent));
    let refused = Parsed::with(&bytes, &others).err();
    assert!(matches!(refused, Some(PacketError::PoseNotHeld { .. })), "it is forgotten");
    let mut session = HeldPoses::default();
    let other = Session { prior: PriorId(1), ..SESSION };
    let hold = |n: u32| session.hold(n, &stated(n, moving(n.into(), 1.0)), &other).unwrap();
    (95..=100).for_each(hold);
    let refused = Parsed::with(&bytes, &session).err();
    assert_eq!(refused, Some(PacketError::Check(Part::Latent)));
}

#[test]
fn damage_is_found() {
    let held = holding(95..=100, 1.0);
    let latent = predicted(&held, 104, 1.0);
    let bytes = packet_of(latent, small(b"difference")).encode().unwrap();
    let len = latent.encoded_len();
    for a in 0..8 * len {
        for b in a..8 * len {
            let bits = if a == b { vec![a] } else { vec![a, b] };
            let read = Parsed::with(&flipped(&bytes, &bits), &held);
            assert!(read.is_err(), "bits {bits:?}: {read:?}");
        }
    }
    for bit in 8 * len..8 * bytes.len() {
        let damaged = flipped(&bytes, &[bit]);
        let read = Parsed::with(&damaged, &held).unwrap();
        assert_eq!(read.latent().pose, latent.pose);
        assert_eq!(read.residual(&damaged), Err(PacketError::Check(Part::Residual)), "bit {bit}");
    }
}

#[test]
fn a_vehicle_predicts_from_what_is_acknowledged() {
    let mut sent = SentPoses::default();
    let latent = |n: u32| stated(n, moving(n.into(), 1.0));
    let add = |sent: &mut SentPoses, n| {
        let written = sent.predicted(&latent(n), &SESSION).unwrap();
        sent.add(&written, &SESSION).unwrap();
        written.predicted.is_some()
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
