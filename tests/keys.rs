//! A topside with keys, and strangers on its link: nothing of theirs is shown.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use nvsprior::packet::{Latent, PoseProfile, QuantisedPose, Residual, Session};
use nvsprior::prior::CoordinateFrame;
use nvsprior::random::Random;
use nvsprior::{Camera, Packet, Pose, PriorId};
use nvsprior_link::keys::{Key, Keys, Refusal};
use nvsprior_link::modem::{
    Collected, Collector, CollectorOptions, Loss, ModemError, Protection, RateControlOptions,
    Report, Sender, SenderOptions,
};
use proptest::prelude::*;

const MTU: usize = 64;

fn keys(byte: u8) -> Keys {
    Keys::new([Key::new([byte; 32])]).unwrap()
}

/// A packet of a frame number, whose payload is filled with a byte.
fn packet(frame: u32, fill: u8, bytes: usize) -> Vec<u8> {
    let camera = Camera { width: 64, height: 36, fx: 60.0, fy: 60.0, cx: 32.0, cy: 18.0 };
    let prior_frame = CoordinateFrame { centre: [0.0; 3], spread: 1.0 };
    let pose = Pose::exp(&[0.001; 6]);
    let pose = QuantisedPose::quantise(&pose, &prior_frame, PoseProfile::Compact).unwrap();
    let latent = Latent::new(frame, &Session { prior: PriorId(7), camera }, pose, false).unwrap();
    let payload = vec![fill; bytes.saturating_sub(45)];
    let residual = Residual::Coded { small_blocks: false, payload: &payload };
    Packet { latent, session: None, render: None, residual, truth: None }.encode().unwrap()
}

fn options(protection: Protection) -> SenderOptions {
    let control = RateControlOptions {
        bit_rate: 20_000.0,
        mtu: MTU,
        overhead: 0,
        latency: 1.5,
        delay: 0.1,
        spread: 0.3,
        frame_rate: 5.0,
        min_bytes: 40,
        max_shares: 16,
        loss: Loss { chance: 0.1, burst: 1.0 },
        user: None,
    };
    SenderOptions { control, stream: 0, protection, expect_reports: true }
}

/// The modem frames of so many camera frames, whose payloads are filled with a byte.
fn dive(keys: Option<&Keys>, protection: Protection, frames: u32, fill: u8) -> Vec<Vec<u8>> {
    let mut sender = match keys {
        Some(keys) => Sender::with_keys(options(protection), keys).unwrap(),
        None => Sender::new(options(protection)).unwrap(),
    };
    let mut sent = Vec::new();
    for frame in 0..frames {
        let now = f64::from(frame) / 5.0;
        if let Some(bytes) = sender.plan(now).unwrap() {
            sender.push(now, &packet(frame, fill, bytes), None).unwrap();
        }
        while let Some(len) = sender.next_len(now) {
            let (_, share) = sender.next(now).unwrap();
            assert_eq!(share.len(), len);
            assert!(len <= MTU);
            sent.push(share.to_vec());
        }
    }
    sent
}

fn collector(keys: &Keys) -> Collector {
    let options = CollectorOptions { packets: 64, ..CollectorOptions::new(MTU) };
    Collector::with_keys(options, keys).unwrap()
}

/// What came out of a collector: the bytes of packets, whole and in part.
#[derive(Default)]
struct Shown {
    payloads: BTreeSet<u8>,
    complete: usize,
}

impl Shown {
    fn take(&mut self, collector: &mut Collector, collected: Collected) {
        match collected {
            Collected::Complete(stream, frame) | Collected::Grown(stream, frame) => {
                let held = collector.packet(stream, frame).unwrap();
                self.complete += usize::from(held.complete);
                self.payloads.extend(held.bytes.get(40..held.bytes.len() - 6).unwrap_or_default());
            }
            _ => {}
        }
    }
}

/// What a stranger sends: any bytes, frames without keys, with other keys and of another epoch, frames of the vehicle
/// with a bit flipped, cut, with their numbers changed, and once more.
fn strange(random: &mut Random, own: &[Vec<u8>], others: &[Vec<Vec<u8>>]) -> Vec<u8> {
    let mut pick = |count: usize| random.within(0.0, count as f32) as usize % count.max(1);
    let mut frame = own[pick(own.len())].clone();
    match pick(7) {
        0 => {
            let len = pick(MTU + 8);
            frame = (0..len).map(|_| pick(256) as u8).collect();
        }
        1 | 2 => {
            let other = &others[pick(others.len())];
            frame = other[pick(other.len())].clone();
        }
        3 => {
            let bit = pick(8 * frame.len());
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        4 => {
            // Zeros at the end are padding: a frame without them is the frame.
            let len = pick(frame.iter().rposition(|byte| *byte != 0).unwrap_or(0) + 1);
            frame.truncate(len);
        }
        5 => frame[pick(2)] = pick(256) as u8,
        _ => frame.extend(std::iter::repeat_n(0, pick(5))),
    }
    frame
}

/// 100,000 frames of strangers between those of the vehicle. The time is told and not tested.
#[test]
fn nothing_of_strangers_is_shown() {
    let own_keys = keys(1).with_epoch(5);
    for protection in [Protection::Layers, Protection::None] {
        let own = dive(Some(&own_keys), protection, 120, 0xAA);
        let others = [
            dive(None, protection, 20, 0x55),
            dive(Some(&keys(2).with_epoch(5)), protection, 20, 0x55),
            dive(Some(&keys(1).with_epoch(4)), protection, 20, 0x55),
            dive(Some(&own_keys.clone().with_tag_bytes(5).unwrap()), protection, 20, 0x55),
        ];
        // What was sent so far may come once more; what is still to come may not have come.
        let (mut topside, mut shown) = (collector(&own_keys), Shown::default());
        let (mut random, mut strangers) = (Random::new(3), 0u64);
        let (mut longest, mut all) = (Duration::ZERO, Duration::ZERO);
        for (index, frame) in own.iter().enumerate() {
            let now = index as f64 / 40.0;
            let pushed = topside.push(now, frame).unwrap();
            shown.take(&mut topside, pushed);
            for _ in 0..50_000 / own.len() + 1 {
                let strange = strange(&mut random, &own[..=index], &others);
                let begin = Instant::now();
                let refused = topside.push(now, &strange);
                let took = begin.elapsed();
                (longest, all) = (longest.max(took), all + took);
                let key = matches!(refused, Err(ModemError::Key(_)));
                assert!(key, "{refused:?} of {strange:?}");
                strangers += 1;
            }
        }
        let counts = topside.statistics();
        assert_eq!(counts.foreign + counts.replayed, strangers);
        assert!(counts.foreign > strangers / 2 && counts.replayed > strangers / 20, "{counts:?}");
        assert_eq!((counts.rejected, counts.duplicates), (0, 0));
        assert_eq!(shown.payloads, BTreeSet::from([0xAA]), "a picture that nobody sent");
        assert!(shown.complete > 100, "{}", shown.complete);
        let mean = all.as_secs_f64() * 1e6 / strangers as f64;
        println!(
            "{protection:?}: {strangers} frames of strangers, {mean:.2} µs each, at most {longest:?}"
        );
    }
}

/// The same frames without keys come out the same, and keys take the bytes that they state and no more.
#[test]
fn keys_take_as_many_bytes_as_they_state() {
    for tag_bytes in [2, 4, 8, 16] {
        let keys = keys(1).with_tag_bytes(tag_bytes).unwrap();
        let mut wider = options(Protection::Layers);
        wider.control.mtu += keys.overhead();
        let mut keyed = Sender::with_keys(wider, &keys).unwrap();
        let mut plain = options(Protection::Layers);
        // What tags take is not there for pictures.
        plain.control.overhead = keys.overhead();
        let mut plain = Sender::new(plain).unwrap();
        for sender in [&mut keyed, &mut plain] {
            let bytes = sender.plan(0.0).unwrap().unwrap();
            sender.push(0.0, &packet(0, 1, bytes), None).unwrap();
        }
        let mut count = 0;
        while let Some((_, frame)) = plain.next(1.0) {
            let frame = frame.to_vec();
            let (_, with_tag) = keyed.next(1.0).unwrap();
            assert_eq!(with_tag.len(), frame.len() + 2 + tag_bytes);
            assert_eq!(with_tag[2 + tag_bytes..], frame);
            count += 1;
        }
        assert!(keyed.next(1.0).is_none() && count > 3);
        assert_eq!(keyed.statistics(), plain.statistics());
        assert_eq!(keyed.next_number(), Some(count));
    }
}

#[test]
fn an_mtu_without_room_for_tags_is_refused() {
    let keys = keys(1);
    let of = |mtu, protection| {
        let mut options = options(protection);
        options.control.mtu = mtu;
        Sender::with_keys(options, &keys).map(drop)
    };
    let too_small = |mtu, needed| Err(ModemError::KeyedMtu { mtu, needed });
    assert_eq!(of(21, Protection::Layers), too_small(21, 22));
    assert_eq!(of(22, Protection::Layers), Ok(()));
    assert_eq!(of(13, Protection::None), too_small(13, 14));
    assert_eq!(of(14, Protection::None), Ok(()));
    let tiny = Collector::with_keys(CollectorOptions::new(6), &keys).map(drop);
    assert_eq!(tiny, too_small(6, 14));
    assert!(Collector::with_keys(CollectorOptions::new(0), &keys).is_err());
}

/// Reports have tags, too: a stranger's does not reach the rate control.
#[test]
fn reports_of_strangers_are_refused() {
    let keys = keys(1);
    let mut sender = Sender::with_keys(options(Protection::Layers), &keys).unwrap();
    let mut topside = collector(&keys);
    let bytes = sender.plan(0.0).unwrap().unwrap();
    sender.push(0.0, &packet(0, 1, bytes), None).unwrap();
    while let Some((_, frame)) = sender.next(1.0) {
        topside.push(1.0, frame).unwrap();
    }
    let report = topside.report(0, |_| false).unwrap().unwrap();
    let mut bytes = [0; MTU];
    let len = topside.write_report(&report, Some(b"pilot"), &mut bytes).unwrap();
    let (read, user) = sender.read_report(&bytes).expect("zeros behind it are padding");
    assert_eq!((read, user), (report, Some(&b"pilot"[..])));
    sender.process_report(1.0, &read).unwrap();
    let refused = |sender: &mut Sender, bytes: &[u8]| sender.read_report(bytes).map(drop);
    assert_eq!(refused(&mut sender, &bytes[..len]), Err(Refusal::Replayed.into()));
    let mut plain = [0; MTU];
    let plain_len = report.write(None, &mut plain).unwrap();
    assert_eq!(refused(&mut sender, &plain[..plain_len]), Err(Refusal::Foreign.into()));
    // What the vehicle itself sent is no report, even if a stranger sends it back.
    sender.plan(1.0).unwrap();
    sender.push(1.0, &packet(1, 1, 100), None).unwrap();
    let own = sender.next(2.0).unwrap().1.to_vec();
    assert_eq!(refused(&mut sender, &own), Err(Refusal::Foreign.into()));
    assert_eq!((sender.statistics().foreign, sender.statistics().replayed), (2, 1));
    let small = topside.write_report(&report, None, &mut [0; 5]);
    assert_eq!(small, Err(ModemError::ReportMtu { mtu: 5, needed: 12 }));
    assert!(Report::read(&bytes).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// A link that loses, swaps and repeats frames: each is taken once, and what is lost is all that is missing.
    #[test]
    fn a_bad_link_is_no_stranger(seed in any::<u64>(), loss in 0.0f32..0.5) {
        let keys = keys(9);
        let sent = dive(Some(&keys), Protection::Layers, 10, 3);
        let (mut topside, mut random) = (collector(&keys), Random::new(seed));
        let (mut late, mut came) = (Vec::new(), 0u64);
        let mut repeated = 0;
        for frame in sent.iter().chain(&sent[sent.len() - 1..]) {
            if random.within(0.0, 1.0) < loss {
                continue;
            }
            if random.within(0.0, 1.0) < 0.2 && late.len() < 20 {
                late.push(frame);
                continue;
            }
            for frame in [frame].into_iter().chain(late.drain(..)) {
                came += 1;
                if topside.push(0.0, frame) == Err(ModemError::Key(Refusal::Replayed)) {
                    repeated += 1;
                }
            }
        }
        let counts = topside.statistics();
        prop_assert_eq!(counts.foreign, 0);
        prop_assert_eq!(counts.replayed, repeated);
        prop_assert!(repeated <= 1, "{}", repeated);
        prop_assert_eq!(counts.accepted + repeated, came);
    }
}
