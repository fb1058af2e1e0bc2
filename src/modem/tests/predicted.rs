//! Packets in the predicted form over shares: their frame number and their end are not among their bytes.

use super::{CAMERA, PRIOR, noise};
use crate::Pose;
use crate::modem::{
    Collected, Collector, CollectorOptions, Loss, ModemError, Sharer, Sharing, SharingOptions,
};
use crate::packet::{
    Coder, HeldPoses, Latent, Packet, PoseProfile, QuantisedPose, Residual, valid_len,
};
use crate::prior::CoordinateFrame;

const PRIOR_FRAME: CoordinateFrame = CoordinateFrame { centre: [0.0; 3], spread: 8.0 };
/// Frame numbers in shares are modulo 128.
const FRAME: u32 = 1000;

fn short(frame: u32) -> Latent {
    let along = f64::from(frame % 100) * 0.01;
    let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.1], [along, 0.0, 1.0]).unwrap();
    let pose = QuantisedPose::quantise(&pose, &PRIOR_FRAME, PoseProfile::Short).unwrap();
    let latent = Latent::new(frame, PRIOR, &CAMERA, pose, false).unwrap();
    latent.shortened(PRIOR, &CAMERA).unwrap()
}

fn held() -> HeldPoses {
    let mut held = HeldPoses::default();
    (FRAME - 9..FRAME - 5).for_each(|frame| held.hold(frame, &short(frame), 5));
    held
}

/// A packet with so many bytes of residual; `None`: it has none.
fn packet(payload: Option<usize>) -> Vec<u8> {
    let latent = held().predict(FRAME, &short(FRAME), 5).unwrap();
    let bytes = noise(7, payload.unwrap_or(0));
    let residual = match payload {
        Some(_) => Residual::Coded { coder: Coder::Wavelet, payload: &bytes },
        None => Residual::Omitted,
    };
    Packet { latent, camera: None, render: None, residual, truth: None }.encode().unwrap()
}

fn sharing(packet: &[u8], budget: usize, chance: f64, whole: bool) -> Sharing {
    let loss = Loss { chance, burst: 1.0 };
    Sharing::new(&SharingOptions {
        mtu: 32,
        overhead: 0,
        budget,
        max_shares: 16,
        spread: 0,
        loss,
        picture: 10,
        packet: Some(packet.len() - 1),
        whole,
        user: None,
    })
    .unwrap()
}

fn collector() -> Collector {
    let mut collector = Collector::new(CollectorOptions::new(32)).unwrap();
    // A packet before tells the numbers beyond 128.
    let before = Packet {
        latent: Latent { frame: FRAME - 3, ..short(FRAME - 3) },
        camera: None,
        render: None,
        residual: Residual::None,
        truth: None,
    };
    let mut sharer = Sharer::default();
    let bytes = before.encode().unwrap();
    sharer.share(&bytes, &sharing(&[0; 20], 100, 0.0, true), 0, None).unwrap();
    sharer.shares().for_each(|share| _ = collector.push(0.0, share).unwrap());
    collector
}

#[test]
fn any_shares_yield_the_packet_or_a_start_of_it() {
    for (payload, chance) in [(Some(0), 0.0), (Some(60), 0.0), (Some(60), 0.3), (Some(150), 0.3)] {
        let packet = packet(payload);
        let sharing = sharing(&packet, 3 * packet.len(), chance, true);
        let mut sharer = Sharer::default();
        sharer.share(&packet, &sharing, 0, None).unwrap();
        let count = sharer.count();
        let mut whole = 0;
        for subset in 1u32..1 << count.min(10) {
            let mut collector = collector();
            let chosen = sharer.shares().enumerate().filter(|(k, _)| subset >> (k % 10) & 1 == 1);
            let mut last = None;
            for (_, share) in chosen {
                last = Some(collector.push(0.0, share).unwrap());
            }
            let Some(found) = collector.packet(0, FRAME) else { continue };
            assert_eq!(found.frame, FRAME);
            assert!(matches!(
                last,
                Some(Collected::Complete(0, FRAME) | Collected::Grown(0, FRAME) | Collected::Kept)
                    | Some(Collected::Surplus)
            ));
            let mut start = packet.clone();
            if !found.complete {
                start[1] &= 0x7F;
                start.truncate(found.bytes.len());
            }
            assert_eq!(found.bytes, start);
            let read = Packet::salvage_with(found.bytes, &held()).unwrap();
            assert_eq!(read.latent.pose, short(FRAME).pose);
            assert_eq!(read.residual.is_ok(), found.complete);
            whole += u32::from(found.complete);
        }
        assert!(whole > 0);
    }
}

#[test]
fn padding_and_missing_ends_are_told() {
    let packet = packet(Some(100));
    let mut seen = [0; 3];
    for budget in 60..260 {
        let sharing = sharing(&packet, budget, 0.1, false);
        let mut sharer = Sharer::default();
        sharer.share(&packet, &sharing, 0, None).unwrap();
        let mut collector = collector();
        sharer.shares().for_each(|share| _ = collector.push(0.0, share).unwrap());
        let found = collector.packet(0, FRAME).unwrap();
        let is_cut = sharing.capacity() < packet.len() - 1;
        assert_eq!((found.complete, found.ended), (!is_cut, true), "{budget}");
        match is_cut {
            true => assert_eq!(found.bytes[2..], packet[2..found.bytes.len()]),
            false => assert_eq!(found.bytes, packet),
        }
        let order = sharing.capacity().cmp(&(packet.len() - 1));
        seen[(order as i8 + 1) as usize] += 1;
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
}

#[test]
fn a_packet_without_residual_tells_its_end() {
    let packet = packet(None);
    let mut sharer = Sharer::default();
    sharer.share(&packet, &sharing(&packet, 100, 0.2, true), 0, None).unwrap();
    let mut collector = collector();
    sharer.shares().for_each(|share| _ = collector.push(0.0, share).unwrap());
    let found = collector.packet(0, FRAME).unwrap();
    assert_eq!((found.bytes, found.complete), (&packet[..], true));
}

#[test]
fn it_does_not_go_without_protection() {
    let packet = packet(Some(20));
    assert_eq!(valid_len(&packet), packet.len());
    let refused = Sharer::default().split(&packet, 64);
    assert_eq!(refused, Err(ModemError::UnprotectedPrediction));
    let mut collector = Collector::new(CollectorOptions::new(64)).unwrap();
    assert!(matches!(collector.push(0.0, &packet), Err(ModemError::NotAFrame(_))));
}
