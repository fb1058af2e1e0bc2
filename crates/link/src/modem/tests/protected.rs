use proptest::prelude::*;

use super::{Recipe, hex, packet_of};
use crate::modem::wire::share::{self, Header};
use crate::modem::{
    Collected, Collector, CollectorOptions, Loss, ModemError, PacketState, Sharer, Sharing,
    SharingOptions,
};
use nvsprior::packet::PoseProfile;
use nvsprior::random::Random;

const LOSS: Loss = Loss { chance: 0.2, burst: 1.0 };

fn short(frame: u32, payload: usize) -> Vec<u8> {
    let (profile, payload) = (PoseProfile::Short, Some(payload));
    packet_of(Recipe { frame, profile, stated: false, payload })
}

fn options(mtu: usize, budget: usize, packet: &[u8]) -> SharingOptions {
    let packet = Some(packet.len());
    SharingOptions {
        mtu,
        overhead: 0,
        budget,
        max_shares: 16,
        spread: 0,
        loss: LOSS,
        picture: 19,
        packet,
        whole: false,
        user: None,
    }
}

fn shares(packet: &[u8], options: &SharingOptions) -> (Sharing, Vec<Vec<u8>>) {
    let sharing = Sharing::new(options).unwrap();
    let user = options.user.map(|len| vec![0xA5; len]);
    let mut sharer = Sharer::default();
    sharer.share(packet, &sharing, 0, user.as_deref()).unwrap();
    (sharing, sharer.shares().map(<[u8]>::to_vec).collect())
}

fn collector(mtu: usize) -> Collector {
    Collector::new(CollectorOptions::new(mtu)).unwrap()
}

fn shuffled<T>(mut all: Vec<T>, random: &mut Random) -> Vec<T> {
    for last in (1..all.len()).rev() {
        all.swap(last, (random.bits() % (last as u64 + 1)) as usize);
    }
    all
}

#[test]
fn any_shares_yield_as_much_as_the_sharing_says() {
    let packet = short(300, 160);
    let mut random = Random::new(1);
    for (mtu, budget) in [(16, 240), (31, 220), (64, 256), (64, 400), (256, 220), (1024, 1000)] {
        let (sharing, shares) = shares(&packet, &options(mtu, budget, &packet));
        assert!(
            shares.iter().all(|share| share.len() <= mtu && share.len() == sharing.share_len())
        );
        assert!(shares.iter().map(Vec::len).sum::<usize>() <= budget, "{mtu} {budget}");
        assert!(sharing.prefix(shares.len()) >= sharing.capacity().min(packet.len()));
        for _ in 0..20 {
            let mut collector = collector(mtu);
            for (arrived, share) in shuffled(shares.clone(), &mut random).iter().enumerate() {
                collector.push(0.0, share).unwrap();
                // The low byte of the frame number does not travel.
                let there = sharing.prefix(arrived + 1);
                let expected = if there > 0 { (there + 1).min(packet.len()) } else { 0 };
                let bytes = collector.packet(0, 300).map_or(&[][..], |packet| packet.bytes);
                assert_eq!(bytes, &packet[..expected], "{mtu} {budget} {arrived} {sharing:?}");
                let complete = collector.packet(0, 300).is_some_and(|packet| packet.complete);
                assert_eq!(complete, expected == packet.len());
                if complete {
                    break;
                }
            }
        }
    }
}

#[test]
fn without_loss_nothing_is_repeated() {
    let packet = short(1, 900);
    let loss = SharingOptions { loss: Loss::NONE, ..options(64, 640, &packet) };
    let (sharing, shares) = shares(&packet, &loss);
    let headers = shares.len()
        * (sharing.share_len() - sharing.layers().iter().map(|l| l.chunk).sum::<usize>());
    // The rest is what the first layer says, and rounding.
    assert!(sharing.capacity() + headers + 24 >= 640, "{} {headers}", sharing.capacity());
}

#[test]
fn a_sharing_is_worth_more_than_others() {
    let packet = short(1, 900);
    for chance in [0.05, 0.2, 0.4] {
        let loss = Loss { chance, burst: 1.0 };
        let options = SharingOptions { loss, ..options(64, 256, &packet) };
        let own = Sharing::new(&options).unwrap();
        // Made for another loss, each is a division that could have been chosen.
        for other in [0.0, 0.01, 0.1, 0.3, 0.6] {
            let other = Loss { chance: other, burst: 1.0 };
            let other = Sharing::new(&SharingOptions { loss: other, ..options }).unwrap();
            let other = other.expect(&options, &loss.arrivals(other.count()));
            assert!(own.worth() >= other - 1e-9, "{chance}: {} {other}", own.worth());
        }
        // A plain division into frames, of which each needs all before it, yields all of 234 bytes or nothing more.
        let whole = (1.0 - chance).powi(4) * (1.0 + 0.85 * (1.0 + 215.0 / 0.7_f64).log2());
        assert!(own.worth() > whole, "{chance}: {} {whole}", own.worth());
    }
}

#[test]
fn shares_that_are_spread_stand_bursts_better() {
    let packet = short(1, 900);
    let loss = Loss { chance: 0.2, burst: 4.0 };
    let together = SharingOptions { loss, ..options(64, 256, &packet) };
    let spread = SharingOptions { spread: 4000, ..together };
    let [together, spread] =
        [together, spread].map(|options| Sharing::new(&options).unwrap().worth());
    assert!(spread > together + 0.3, "{spread} {together}");
}

#[test]
fn user_bytes_travel_with_the_picture() {
    let packet = short(9, 100);
    let with = SharingOptions { user: Some(20), ..options(64, 300, &packet) };
    let (sharing, shares) = shares(&packet, &with);
    let mut collector = collector(64);
    for share in &shares[..sharing.layers()[0].threshold] {
        collector.push(0.0, share).unwrap();
    }
    assert_eq!(collector.packet(0, 9).unwrap().user, Some(&[0xA5; 20][..]));
    let mut sharer = Sharer::default();
    let refused = sharer.share(&packet, &sharing, 0, Some(&[1, 2]));
    assert_eq!(refused, Err(ModemError::UserBytes(2)));
}

#[test]
fn packets_do_not_displace_each_other() {
    let mut collector = collector(64);
    let packets: Vec<_> = (120..136).map(|frame| short(frame, 150)).collect();
    let all: Vec<_> =
        packets.iter().flat_map(|packet| shares(packet, &options(64, 600, packet)).1).collect();
    for share in shuffled(all, &mut Random::new(3)) {
        let _ = collector.push(0.0, &share);
    }
    for (frame, packet) in (120..136).zip(&packets) {
        let held = collector.packet(0, frame).unwrap();
        assert!(held.complete && held.bytes == packet && held.frame == frame);
    }
    assert_eq!(collector.newest(0).unwrap().frame, 135);
    assert_eq!(collector.statistics().completed, 16);
}

#[test]
fn two_streams_are_two() {
    let options_of_two = CollectorOptions { streams: 2, ..CollectorOptions::new(64) };
    let mut collector = Collector::new(options_of_two).unwrap();
    let packets = [short(5, 80), short(5, 60)];
    for (stream, packet) in packets.iter().enumerate() {
        let sharing = Sharing::new(&options(64, 400, packet)).unwrap();
        let mut sharer = Sharer::default();
        sharer.share(packet, &sharing, stream as u8, None).unwrap();
        (0..sharer.count()).for_each(|k| drop(collector.push(0.0, sharer.get(k))));
    }
    for (stream, packet) in packets.iter().enumerate() {
        assert_eq!(collector.packet(stream as u8, 5).unwrap().bytes, packet);
    }
    let sharing = Sharing::new(&options(64, 256, &packets[0])).unwrap();
    let mut sharer = Sharer::default();
    sharer.share(&packets[0], &sharing, 2, None).unwrap();
    assert_eq!(collector.push(0.0, sharer.get(0)), Err(ModemError::Stream(2)));
}

#[test]
fn missing_shares_are_named_per_packet() {
    let (one, two) = (short(7, 120), short(8, 120));
    let (_, first) = shares(&one, &options(64, 256, &one));
    let (_, second) = shares(&two, &options(64, 256, &two));
    let mut collector = collector(64);
    collector.push(0.0, &first[2]).unwrap();
    collector.push(0.0, &second[0]).unwrap();
    let others = |but: usize, count: usize| (0..count).filter(move |k| *k != but);
    assert!(collector.missing(0, 7).eq(others(2, first.len())));
    assert!(collector.missing(0, 8).eq(others(0, second.len())));
    assert_eq!(collector.missing(0, 9).count(), 0);
    first.iter().for_each(|share| drop(collector.push(0.0, share)));
    assert_eq!(collector.missing(0, 7).count(), 0);
}

#[test]
fn old_shares_are_refused_and_a_restart_is_understood() {
    let mut collector = collector(64);
    let send = |collector: &mut Collector, frame| {
        let packet = short(frame, 60);
        let (_, shares) = shares(&packet, &options(64, 200, &packet));
        shares.iter().map(|share| collector.push(0.0, share)).collect::<Vec<_>>()
    };
    for frame in 50..90 {
        send(&mut collector, frame);
    }
    let late = send(&mut collector, 60);
    assert!(late.iter().all(|taken| *taken == Err(ModemError::Late(60))), "{late:?}");
    send(&mut collector, 90);
    // The vehicle starts anew: after a few shares it is believed.
    for frame in 50..56 {
        send(&mut collector, frame);
    }
    assert!(collector.packet(0, 55).is_some_and(|packet| packet.complete));
    assert!(collector.packet(0, 90).is_none());
}

/// A packet of 256 frames before has the same number. Once it is stale it is not taken for the new one.
#[test]
fn after_a_blackout_of_any_length_the_next_packet_counts() {
    for silent in [20, 70, 76, 128, 150, 256, 512, 1000] {
        let mut collector = collector(64);
        let mut shown = 0;
        for frame in (0..60).chain(60 + silent..120 + silent) {
            let packet = short(frame, 60);
            for share in shares(&packet, &options(64, 200, &packet)).1 {
                let _ = collector.push(f64::from(frame) / 15.0, &share);
            }
            let held = collector.packet(0, frame);
            assert!(held.is_none_or(|held| held.frame == frame && packet.starts_with(held.bytes)));
            shown += usize::from(held.is_some());
        }
        assert_eq!(shown, 120, "{silent}");
        assert_eq!(collector.statistics().damaged, 0);
    }
}

/// Shares name a packet by seven bits of its frame number, a short packet itself by sixteen.
#[test]
fn a_packet_is_found_by_its_whole_frame_number() {
    let mut collector = collector(64);
    let push = |collector: &mut Collector, now: f64, packet: &[u8]| {
        let (_, shares) = shares(packet, &options(64, 400, packet));
        let taken = shares.iter().filter_map(|share| collector.push(now, share).ok());
        taken.last().unwrap()
    };
    push(&mut collector, 0.0, &short(65_530, 60));
    // 65,540 is stated as 4. The packet before completes it.
    let (profile, payload) = (PoseProfile::Short, Some(60));
    let packet = packet_of(Recipe { frame: 65_540, profile, stated: false, payload });
    assert_eq!(packet[2], 4);
    push(&mut collector, 0.5, &packet);
    let held = collector.packet(0, 65_540).unwrap();
    assert!(held.frame == 65_540 && held.complete && held.ended && held.bytes == packet);
    assert_eq!(collector.newest(0).unwrap().frame, 65_540);
    assert!(collector.packet(0, 4).is_some(), "it states no more than 16 bits");
    for other in [65_540 - 256, 65_540 + 256, 4 + 256, 65_541, 132] {
        assert!(collector.packet(0, other).is_none(), "{other}");
        assert_eq!((collector.known(0, other), collector.arrived(0, other).count()), (0, 0));
    }
    // Of one share only the number modulo 256 is known.
    let next = short(65_542, 200);
    let (_, all) = shares(&next, &options(64, 400, &next));
    collector.push(0.7, &all[0]).unwrap();
    assert!(collector.packet(0, 65_542).is_none());
    assert!(collector.arrived(0, 65_542).eq(0..1) && collector.arrived(0, 65_542 % 256).eq(0..1));
    assert!(collector.push(f64::NAN, &all[1]).is_err());
    assert_eq!(collector.statistics().rejected, 0, "a wrong time says nothing of the link");
}

#[test]
fn a_packet_whose_end_is_not_sent_ends() {
    let packet = short(9, 900);
    let (sharing, shares) = shares(&packet, &options(64, 256, &packet));
    assert!(sharing.capacity() < packet.len());
    let last = sharing.layers().last().unwrap().threshold;
    let mut collector = collector(64);
    for (arrived, share) in shares.iter().enumerate() {
        collector.push(0.0, share).unwrap();
        let held = collector.packet(0, 9);
        assert!(held.is_none_or(|held| !held.complete && held.ended == (arrived + 1 >= last)));
    }
    assert!(collector.packet(0, 9).unwrap().ended);
}

#[test]
fn the_loss_is_known_afterwards() {
    let mut collector = collector(64);
    let mut random = Random::new(8);
    let mut complete = 0;
    for frame in 0..3000 {
        let packet = short(frame, 100);
        for share in shares(&packet, &options(64, 400, &packet)).1 {
            if random.within(0.0, 1.0) >= 0.2 {
                complete +=
                    u64::from(matches!(collector.push(0.0, &share), Ok(Collected::Complete(..))));
            }
        }
    }
    let statistics = collector.statistics();
    let loss = 1.0 - (statistics.arrived as f64 / statistics.sent as f64);
    assert!((loss - 0.2).abs() < 0.02, "{loss} {statistics:?}");
    assert_eq!(statistics.completed, complete);
    assert!(statistics.repaired > 500 && statistics.lost < 40, "{statistics:?}");
}

#[test]
fn damage_is_found() {
    let packet = short(40, 120);
    let (_, shares) = shares(&packet, &options(64, 400, &packet));
    let mut collector = collector(64);
    for share in &shares {
        for bit in 0..8 * share.len() {
            let mut damaged = share.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(collector.push(0.0, &damaged).is_err(), "bit {bit}");
        }
    }
    // Damage that a share's check has missed: the packet's own finds it.
    let (header, data) = share::read(&shares[0]).unwrap();
    let (mut forged, mut data) = (Vec::new(), data.to_vec());
    *data.last_mut().unwrap() ^= 1;
    data[0] ^= 0x40;
    share::write(&header, &data, &mut forged);
    let mut outcomes: Vec<_> = std::iter::once(&forged)
        .chain(&shares[1..])
        .map(|share| collector.push(0.0, share))
        .collect();
    outcomes.retain(|outcome| matches!(outcome, Ok(Collected::Damaged(0, 40))));
    assert_eq!(outcomes.len(), 1);
    // It heals when the shares come again.
    for share in &shares {
        let _ = collector.push(0.0, share);
    }
    assert_eq!(collector.packet(0, 40).unwrap().bytes, packet);
}

#[test]
fn padding_and_other_frames_do_no_harm() {
    let packet = short(12, 120);
    let (_, shares) = shares(&packet, &options(64, 400, &packet));
    let mut collector = collector(64);
    let mut refused = 0;
    for share in &shares {
        let mut padded = share.clone();
        padded.resize(80, 0xEE);
        let _ = collector.push(0.0, &padded);
        for other in [&packet[..], &[], &[0x40], &[0x7F; 64]] {
            refused += u32::from(collector.push(0.0, other).is_err());
        }
    }
    assert_eq!(refused, 4 * shares.len() as u32);
    assert_eq!(collector.packet(0, 12).unwrap().bytes, packet);
}

#[test]
fn options_are_checked() {
    let packet = short(12, 120);
    let good = options(64, 256, &packet);
    let refused = |options| Sharing::new(&options).unwrap_err();
    assert_eq!(refused(SharingOptions { mtu: 15, ..good }), ModemError::ShareMtu(15));
    assert_eq!(refused(SharingOptions { max_shares: 0, ..good }), ModemError::ShareCount(0));
    assert_eq!(refused(SharingOptions { user: Some(256), ..good }), ModemError::UserBytes(256));
    let budget = ModemError::Budget { budget: 20, picture: 19 };
    assert_eq!(refused(SharingOptions { budget: 20, ..good }), budget);
    for (shares, packets, streams) in [(0, 1, 1), (4097, 1, 1), (1, 65, 1), (1, 1, 5)] {
        let options = CollectorOptions { shares, packets, streams, ..CollectorOptions::new(64) };
        assert!(matches!(Collector::new(options).map(drop), Err(ModemError::Collector { .. })));
    }
}

/// Pins the wire format: a change here is a new version of it.
#[test]
fn golden_shares() {
    let packet = short(0x1F5, 30);
    let (_, shares) =
        shares(&packet, &SharingOptions { user: Some(2), ..options(31, 150, &packet) });
    let shares: Vec<_> = shares.iter().map(|share| hex(share)).collect();
    assert_eq!(shares, GOLDEN);
}

const GOLDEN: [&str; 6] = [
    "4f52051200e5741802a5a560000174490a0238fdcbcdafe849",
    "4f52151200b7cf931e1270572e9d9e1ecd54dd922b42e132c4",
    "4f522512007cb07739f993976a1071de555a620ea3670f3c56",
    "4f523512002e0bfc254e46a0448c9b89920c876143e841e6db",
    "4f5245120008a24b78a1f7cd0cf3699ea34582b2f51a02b417",
    "4f525512005a19c0641622fa226f83c9641367dd15954c6e9a",
];

proptest! {
    #[test]
    fn any_bytes_are_taken_or_refused(
        frames in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 0..60),
        repair in any::<bool>(),
    ) {
        let options = CollectorOptions {
            shares: 20,
            packets: 4,
            streams: 2,
            age: 1.0,
            ..CollectorOptions::new(64)
        };
        let mut collector = Collector::new(options).unwrap();
        for mut frame in frames {
            if repair && let Some(first) = frame.first_mut() {
                *first = 0x40 | *first & 0x1F;
                repair_check(&mut frame);
            }
            let _ = collector.push(0.0, &frame);
        }
        for stream in 0..2 {
            for number in 0..128 {
                let _ = collector.packet(stream, number);
                let _ = collector.missing(stream, number).count();
            }
        }
    }

    #[test]
    fn any_budget_yields_a_sharing_within_it_or_an_error(
        mtu in 16usize..300,
        overhead in 0usize..40,
        budget in 0usize..3000,
        max_shares in 1usize..40,
        chance in 0.0..0.95,
        burst in 1.0..8.0,
        payload in 0usize..800,
    ) {
        let packet = short(77, payload);
        let loss = Loss { chance, burst };
        let options = SharingOptions { overhead, max_shares, loss, ..options(mtu, budget, &packet) };
        let Ok(sharing) = Sharing::new(&options) else { return Ok(()) };
        prop_assert!(sharing.count() * (sharing.share_len() + overhead) <= budget);
        prop_assert!(sharing.share_len() <= mtu && sharing.count() <= max_shares);
        prop_assert!(sharing.prefix(sharing.layers()[0].threshold) >= 19);
        prop_assert!(sharing.layers().windows(2).all(|pair| pair[0].threshold < pair[1].threshold));
        let mut sharer = Sharer::default();
        sharer.share(&packet, &sharing, 0, None).unwrap();
        let all = CollectorOptions { shares: 40, ..CollectorOptions::new(mtu) };
        let mut collector = Collector::new(all).unwrap();
        for index in (0..sharer.count()).rev() {
            collector.push(0.0, sharer.get(index)).unwrap();
        }
        let held = collector.packet(0, 77).unwrap();
        // The low byte of the frame number does not travel.
        prop_assert_eq!(held.bytes, &packet[..(sharing.capacity() + 1).min(packet.len())]);
    }
}

/// Makes the check right if the bytes have the room for a header.
fn repair_check(frame: &mut [u8]) {
    let Some(&[_, second, _]) = frame.get(..3).and_then(|start| start.first_chunk::<3>()) else {
        return;
    };
    let at = if second & 8 == 0 { 3 } else { 4 };
    let Some(numbers) = frame.get_mut(at..at + 2) else { return };
    // Short chunks, so that the data is there.
    numbers[0] = 1 + numbers[0] % 8;
    numbers[1] %= 8;
    let (chunk, others) = (numbers[0] as usize, numbers[1] as usize);
    let end = at + 4 + chunk + others;
    let Some(whole) = frame.get(..end) else { return };
    let check = nvsprior::packet::crc16(&[&whole[..at + 2], &whole[at + 4..]]);
    frame[at + 2..at + 4].copy_from_slice(&check.to_le_bytes());
}

#[test]
fn headers_come_back() {
    for (count, index, chunk, others) in
        [(1, 0, 1, 0), (16, 15, 127, 128), (17, 16, 128, 0), (256, 255, 300, 70)]
    {
        let packet = share::PacketHeader {
            stream: 3,
            number: 101,
            count,
            threshold: count.min(8),
            chunk,
            others,
        };
        let header = Header { packet, index };
        let (data, mut share) = (vec![7; chunk + others], Vec::new());
        share::write(&header, &data, &mut share);
        assert_eq!(share.len(), share::header_len(count, chunk, others) + data.len());
        assert_eq!(share::read(&share), Ok((header, &data[..])));
        for len in 0..share.len() {
            assert!(share::read(&share[..len]).is_err());
        }
    }
}

#[test]
fn a_report_tells_what_came_of_the_newest_packets() {
    let mut collector = collector(64);
    assert_eq!(collector.report(0, |_| false), Ok(None), "nothing came");
    let start = 0xFFFE;
    let packets: Vec<_> = (start..start + 5).map(|frame| short(frame & 0xFFFF, 300)).collect();
    let whole = |packet: &[u8]| SharingOptions { whole: true, ..options(64, 640, packet) };
    let shares: Vec<_> = packets.iter().map(|packet| shares(packet, &whole(packet)).1).collect();
    // All shares of the first and fourth packet come, none of the second, and one each of the third and fifth.
    let push = |collector: &mut Collector, share: &[u8]| collector.push(0.0, share).unwrap();
    shares[0].iter().for_each(|share| _ = push(&mut collector, share));
    push(&mut collector, &shares[2][3]);
    shares[3].iter().for_each(|share| _ = push(&mut collector, share));
    push(&mut collector, &shares[4][0]);
    let report = collector.report(0, |frame| frame & 0xFFFF == 1).unwrap().unwrap();
    assert_eq!(report.newest(), 2);
    let state = |frame: u32| report.packet(frame).unwrap().state;
    use PacketState::{Kept, Nothing, Part, Whole};
    let states: Vec<_> = (start..start + 5).map(state).collect();
    assert_eq!(states, [Whole, Nothing, Part, Kept, Part]);
    let third = report.packet(0).unwrap();
    assert_eq!((third.arrived, third.shares.sent()), (1, shares[2].len()));
    assert!(third.shares.contains(3) && !third.shares.contains(2));
    assert_eq!(report.packet(start).unwrap().arrived, shares[0].len());
}
