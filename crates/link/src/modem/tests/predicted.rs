//! Packets with predicted poses over shares: their frame number is not among their bytes.

use super::{SESSION, latent_of, noise};
use crate::modem::{Collected, Collector, CollectorOptions, Loss, Sharer, Sharing, SharingOptions};
use nvsprior::Pose;
use nvsprior::packet::{
    Extent, HeldPoses, Latent, Packet, Parsed, PoseProfile, QuantisedPose, Residual, SentPoses,
};
use nvsprior::prior::CoordinateFrame;

const PRIOR_FRAME: CoordinateFrame = CoordinateFrame { centre: [0.0; 3], spread: 8.0 };
/// Frame numbers in shares are modulo 256.
const FRAME: u32 = 1000;

fn stated(frame: u32) -> Latent {
    let along = f64::from(frame % 100) * 0.01;
    let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.1], [along, 0.0, 1.0]).unwrap();
    latent_of(frame, QuantisedPose::quantise(&pose, &PRIOR_FRAME, PoseProfile::Short).unwrap())
}

const HELD: std::ops::Range<u32> = FRAME - 9..FRAME - 5;

fn held() -> HeldPoses {
    let mut held = HeldPoses::default();
    HELD.for_each(|frame| held.hold(frame, &stated(frame), &SESSION).unwrap());
    held
}

fn of(latent: Latent, residual: Residual) -> Vec<u8> {
    Packet { latent, session: None, render: None, residual, truth: None }.encode().unwrap()
}

/// A packet with so many bytes of residual; `None`: it has none.
fn packet(payload: Option<usize>) -> Vec<u8> {
    let mut sent = SentPoses::default();
    HELD.for_each(|frame| sent.add(&stated(frame), &SESSION).unwrap());
    HELD.for_each(|frame| sent.acknowledge(frame, true));
    let latent = sent.predicted(&stated(FRAME), &SESSION).unwrap();
    assert!(latent.predicted.is_some());
    let payload = payload.map(|len| noise(7, len));
    match &payload {
        Some(payload) => of(latent, Residual::Coded { small_blocks: false, payload }),
        None => of(latent, Residual::Omitted),
    }
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
        picture: Extent::read(packet).unwrap().head,
        packet: Some(packet.len() - 2),
        whole,
        user: None,
    })
    .unwrap()
}

fn collector() -> Collector {
    let mut collector = Collector::new(CollectorOptions::new(32)).unwrap();
    // A packet before tells the numbers beyond 256.
    let mut sharer = Sharer::default();
    let bytes = of(stated(FRAME - 3), Residual::None);
    sharer.share(&bytes, &sharing(&bytes, 100, 0.0, false), 0, None).unwrap();
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
            assert_eq!(found.bytes, &packet[..found.bytes.len()]);
            let read = Parsed::with(found.bytes, &held()).unwrap();
            assert_eq!(read.latent().pose, stated(FRAME).pose);
            assert_eq!(read.residual(found.bytes).is_ok(), found.complete);
            whole += u32::from(found.complete);
        }
        assert!(whole > 0);
    }
}

#[test]
fn padding_is_none_of_it_and_missing_ends_are_told() {
    let packet = packet(Some(100));
    let mut seen = [0; 3];
    for budget in 60..260 {
        let sharing = sharing(&packet, budget, 0.1, false);
        let mut sharer = Sharer::default();
        sharer.share(&packet, &sharing, 0, None).unwrap();
        let mut collector = collector();
        sharer.shares().for_each(|share| _ = collector.push(0.0, share).unwrap());
        let found = collector.packet(0, FRAME).unwrap();
        let is_cut = sharing.capacity() < packet.len() - 2;
        assert_eq!((found.complete, found.ended), (!is_cut, true), "{budget}");
        assert_eq!(found.bytes, &packet[..found.bytes.len()]);
        assert_eq!(found.bytes.len() == packet.len(), !is_cut);
        let order = sharing.capacity().cmp(&(packet.len() - 2));
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
fn it_goes_without_protection_at_any_mtu() {
    for mtu in [8, 12, 16, 31, 64] {
        for payload in [None, Some(20)] {
            let packet = packet(payload);
            let mut collector = Collector::new(CollectorOptions::new(mtu)).unwrap();
            let mut sharer = Sharer::default();
            let mut last = None;
            for packet in [&of(stated(FRAME - 3), Residual::None), &packet] {
                sharer.split(packet, mtu).unwrap();
                last = sharer.shares().map(|share| collector.push(0.0, share).unwrap()).last();
            }
            assert_eq!(last, Some(Collected::Complete(0, FRAME)), "{mtu}");
            let found = collector.packet(0, FRAME).unwrap();
            assert_eq!(found.bytes, packet, "{mtu}");
            assert!(Parsed::with(found.bytes, &held()).is_ok());
        }
    }
}
