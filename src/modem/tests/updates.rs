//! Updates through a sender and a collector.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::{PRIOR, Recipe, noise, packet_of};
use crate::modem::collect::collected::Collected;
use crate::modem::collect::collector::{Collector, CollectorOptions};
use crate::modem::error::ModemError;
use crate::modem::report::Report;
use crate::modem::send::loss::Loss;
use crate::modem::send::rate_control::RateControlOptions;
use crate::modem::send::sender::{Protection, Sender, SenderOptions};
use crate::modem::send::update_options::UpdateOptions;
use crate::packet::PoseProfile;
use crate::prior::{Learnt, NewSplat, StateId, Update, UpdateGrid};
use crate::random::Random;

/// A chain of updates of so many splats, as they travel; other ones for each seed.
fn chain(seed: u32, splats: &[usize]) -> Vec<Vec<u8>> {
    let mut learnt = Learnt::none(PRIOR);
    let next = |(k, count): (usize, &usize)| {
        let numbers = noise(seed + k as u32, 12 * count);
        let splat = |n: &[u8]| NewSplat {
            position: [0, 1, 2].map(|axis| i32::from(n[axis])),
            log_scale: [3, 4, 5].map(|axis| -8 + (n[axis] % 5) as i8),
            rotation: [0; 3],
            opacity: (n[6] % 8) as i8,
            colour: [7, 8, 9].map(|channel| (n[channel] % 20) as i8 - 10),
        };
        let update = Update {
            prior: PRIOR,
            number: learnt.number() + 1,
            before: learnt.state(),
            grid: UpdateGrid { origin: [0.0; 3], exponent: -4 },
            splats: numbers.chunks(12).map(splat).collect(),
            removed: vec![],
            changed: vec![],
            fades: vec![],
            frames: [0, k as u32],
        };
        let mut bytes = Vec::new();
        update.write(&mut bytes).unwrap();
        learnt.add(&update).unwrap();
        bytes
    };
    splats.iter().enumerate().map(next).collect()
}

/// 20 kbit/s, 10 pictures a second.
fn options(mtu: usize, loss: f64, expect_reports: bool) -> SenderOptions {
    let control = RateControlOptions {
        bit_rate: 20_000.0,
        mtu,
        overhead: 0,
        latency: 1.5,
        delay: 0.2,
        spread: 0.3,
        frame_rate: 10.0,
        min_bytes: 40,
        max_shares: 16,
        loss: Loss { chance: loss, burst: 1.0 },
        user: None,
    };
    let updates = Some(UpdateOptions::default());
    SenderOptions { control, stream: 1, protection: Protection::Layers, expect_reports, updates }
}

fn collector(mtu: usize) -> Collector {
    let options = CollectorOptions {
        streams: 2,
        packets: 64,
        update_bytes: 4000,
        ..CollectorOptions::new(mtu)
    };
    Collector::new(options).unwrap()
}

/// The first `count` pieces of an update, sources and parity: those of a sender that knows of no report.
fn pieces(update: &[u8], mtu: usize, loss: f64, count: usize) -> Vec<Vec<u8>> {
    let mut sender = Sender::new(options(mtu, loss, false)).unwrap();
    sender.push_update(0.0, update).unwrap();
    (0..count).map(|k| sender.next(100.0 * k as f64).unwrap().1.to_vec()).collect()
}

/// Pieces that yield an update.
fn sources(piece: &[u8]) -> usize {
    usize::from(piece[4]) + 1
}

/// Which update, which of its pieces, what happens to it, where, and whether its check is made right again.
fn arrival() -> impl Strategy<Value = (usize, usize, usize, u16, bool)> {
    (0_usize..3, 0_usize..256, 0_usize..16, any::<u16>(), any::<bool>())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn any_pieces_as_many_as_there_are_sources_yield_it(
        (mtu, splats, seed) in (16_usize..200, 6_usize..160, any::<u32>()),
        loss in 0.0..0.5_f64,
    ) {
        let update = &chain(seed, &[splats])[0];
        prop_assume!(update.len() < 1500);
        let pieces = pieces(update, mtu, loss, 256);
        let needed = sources(&pieces[0]);
        prop_assert!(pieces.iter().all(|piece| piece.len() <= mtu));
        let mut random = Random::new(seed.into());
        let mut order: Vec<usize> = (0..256).collect();
        order.sort_by_cached_key(|_| random.bits());
        let mut collector = collector(mtu);
        for (k, index) in order[..needed].iter().enumerate() {
            prop_assert_eq!(collector.update(1), None);
            let mut piece = pieces[*index].clone();
            piece.resize(mtu, 0xA5);
            let last = k + 1 == needed;
            let brought = if last { Collected::Update(1) } else { Collected::Kept };
            prop_assert_eq!(collector.push(0.0, &piece), Ok(brought));
            let again = if last { Collected::Surplus } else { Collected::Duplicate };
            prop_assert_eq!(collector.push(0.0, &piece), Ok(again));
        }
        prop_assert_eq!(collector.update(1), Some(&update[..]));
        collector.settle_update(1, true);
        prop_assert_eq!(collector.update(1), None);
        prop_assert_eq!(collector.push(0.0, &pieces[order[needed]]), Ok(Collected::Surplus));
    }

    /// Whatever comes, what goes out is an update that was sent.
    #[test]
    fn damaged_cut_and_mixed_pieces_yield_no_other_update(
        (mtu, seed) in (20_usize..100, any::<u32>()),
        arrivals in proptest::collection::vec(arrival(), 0..300),
    ) {
        // Two updates of one number, and the one after.
        let one = chain(seed, &[20, 30]);
        let sent = [one[0].clone(), chain(seed ^ 1, &[25])[0].clone(), one[1].clone()];
        let pieces: Vec<_> = sent.iter().map(|update| pieces(update, mtu, 0.2, 256)).collect();
        let mut collector = collector(mtu);
        let mut whole = 0;
        for (update, index, how, place, repair) in arrivals {
            let mut piece = pieces[update][index].clone();
            match how {
                0 => piece.truncate(usize::from(place) % piece.len()),
                1 => damage(&mut piece, place.into(), repair),
                _ => {}
            }
            let _ = collector.push(0.0, &piece);
            if let Some(update) = collector.update(1) {
                prop_assert!(sent.iter().any(|sent| sent == update));
                collector.settle_update(1, place % 3 > 0);
                whole += 1;
            }
        }
        let statistics = collector.statistics();
        prop_assert!(statistics.updates <= whole + 4);
    }
}

/// Flips a bit, and may make the check right again.
fn damage(piece: &mut [u8], bit: usize, repair: bool) {
    let bit = bit % (8 * piece.len());
    piece[bit / 8] ^= 1 << (bit % 8);
    let head = 7 + usize::from(piece[6] >= 0x80);
    if repair && head + 2 <= piece.len() {
        let check = crate::packet::bytes::crc16(&[&piece[..head], &piece[head + 2..]]);
        piece[head..head + 2].copy_from_slice(&check.to_le_bytes());
    }
}

#[test]
fn pieces_that_lie_yield_nothing_and_the_right_ones_do_afterwards() {
    let update = &chain(1, &[40])[0];
    let pieces = pieces(update, 64, 0.2, 256);
    let mut collector = collector(64);
    let needed = sources(&pieces[0]);
    for piece in &pieces[..needed - 1] {
        collector.push(0.0, piece).unwrap();
    }
    let mut wrong = pieces[needed - 1].clone();
    damage(&mut wrong, 8 * 20, true);
    let refused = collector.push(0.0, &wrong);
    assert_eq!(refused, Err(ModemError::UpdateCheck { number: 1 }));
    assert_eq!((collector.update(1), collector.statistics().rejected), (None, 1));
    for piece in &pieces[100..100 + needed] {
        collector.push(0.0, piece).unwrap();
    }
    assert_eq!(collector.update(1), Some(&update[..]));
}

#[test]
fn who_takes_no_updates_refuses_their_pieces() {
    let update = &chain(1, &[40])[0];
    let piece = &pieces(update, 64, 0.2, 1)[0];
    let mut deaf =
        Collector::new(CollectorOptions { streams: 2, ..CollectorOptions::new(64) }).unwrap();
    assert_eq!(deaf.push(0.0, piece), Err(ModemError::NotAFrame(piece[0])));
    let small = CollectorOptions { streams: 2, update_bytes: 60, ..CollectorOptions::new(64) };
    let refused = Collector::new(small).unwrap().push(0.0, piece);
    assert!(matches!(refused, Err(ModemError::UpdateRoom { .. })), "{refused:?}");
    let one = CollectorOptions { update_bytes: 4000, ..CollectorOptions::new(64) };
    assert_eq!(Collector::new(one).unwrap().push(0.0, piece), Err(ModemError::Stream(1)));
    let reports = Report::read(piece);
    assert_eq!(reports, Err(ModemError::NotAFrame(piece[0])));
}

#[test]
fn all_memory_is_taken_at_the_start() {
    let options = CollectorOptions { streams: 2, update_bytes: 4000, ..CollectorOptions::new(64) };
    let mut collector = Collector::new(options).unwrap();
    let before = collector.capacity();
    assert!(before <= options.memory().unwrap());
    for (k, update) in chain(3, &[100; 12]).iter().enumerate() {
        pieces(update, 64, 0.2, 40).iter().for_each(|piece| drop(collector.push(0.0, piece)));
        while collector.update(1).is_some() {
            collector.settle_update(1, k % 3 > 0);
        }
    }
    assert_eq!(collector.capacity(), before);
}

/// A vehicle and a topside on a link that loses modem frames by chance, in steps of a tenth of a second.
struct Dive {
    sender: Sender,
    options: SenderOptions,
    collector: Collector,
    /// What the topside holds: states, oldest first.
    states: Vec<(u16, StateId)>,
    random: Random,
    chance: f32,
    tick: u32,
    /// Bytes of pictures and of pieces.
    bytes: [usize; 2],
}

impl Dive {
    fn new(chance: f32, expect_reports: bool) -> Dive {
        let options = options(64, f64::from(chance), expect_reports);
        Dive {
            sender: Sender::new(options).unwrap(),
            options,
            collector: collector(64),
            states: Vec::new(),
            random: Random::new(9),
            chance,
            tick: 0,
            bytes: [0; 2],
        }
    }

    fn now(&self) -> f64 {
        f64::from(self.tick) / 10.0
    }

    /// A frame, what goes with it, and once a second a report.
    fn step(&mut self) {
        let now = self.now();
        if let Some(bytes) = self.sender.plan(now).unwrap() {
            let payload = Some(bytes - 24);
            let profile = PoseProfile::Short;
            let packet = packet_of(Recipe { frame: self.tick, profile, camera: false, payload });
            self.sender.push(now, &packet, None).unwrap();
        }
        while let Some(len) = self.sender.next_len(now) {
            let (due, frame) = self.sender.next(now).unwrap();
            assert!(due <= now && frame.len() == len);
            self.bytes[usize::from(frame[0] >> 6 == 0)] += len;
            if self.random.within(0.0, 1.0) >= self.chance {
                let _ = self.collector.push(now, frame);
            }
        }
        while let Some(update) = self.collector.update(1) {
            let update = Update::read(update).unwrap();
            // As a decoder does: those after the state that it stands on go.
            let all = [(0, PRIOR.into())].into_iter().chain(self.states.iter().copied());
            let held: Vec<_> = all.map(|(_, state)| state).collect();
            let added = held.contains(&update.state());
            let base = held.iter().position(|state| *state == update.before);
            if let (false, Some(base)) = (added, base) {
                self.states.truncate(base);
                self.states.push((update.number, update.state()));
            }
            let added = added || base.is_some();
            self.collector.settle_update(1, added);
        }
        self.tick += 1;
        if self.options.expect_reports && self.tick.is_multiple_of(10) {
            self.report();
        }
    }

    fn report(&mut self) {
        let Some(mut report) = self.collector.report(1, |_| false).unwrap() else { return };
        report.tell_states(self.states.iter().rev().copied());
        let mut bytes = [0; 64];
        let len = report.write(None, &mut bytes).unwrap();
        let (report, _) = Report::read(&bytes[..len]).unwrap();
        self.sender.process_report(self.now(), &report).unwrap();
    }

    fn run(&mut self, seconds: u32) {
        (0..10 * seconds).for_each(|_| self.step());
    }

    fn push(&mut self, update: &[u8]) {
        self.sender.push_update(self.now(), update).unwrap();
    }
}

#[test]
fn with_reports_what_is_missing_comes_and_the_vehicle_knows() {
    for chance in [0.0, 0.2, 0.5] {
        let mut dive = Dive::new(chance, true);
        let chain = chain(5, &[90, 60, 100]);
        for (k, update) in chain.iter().enumerate() {
            dive.push(update);
            assert_ne!(dive.sender.held_update(), Some(k as u16 + 1), "not before a report");
            dive.run(20);
            assert_eq!((dive.states.len(), dive.sender.held_update()), (k + 1, Some(k as u16 + 1)));
        }
        let sent = dive.sender.statistics().pieces;
        dive.run(20);
        assert_eq!(dive.sender.statistics().pieces, sent, "nothing is repeated");
    }
}

#[test]
fn without_loss_no_parity_goes_and_no_picture_waits_for_more_than_a_piece() {
    let mut dive = Dive::new(0.0, true);
    let update = &chain(5, &[90])[0];
    dive.push(update);
    dive.run(10);
    let SentBytes { pieces, bytes } = SentBytes::of(&dive);
    assert!(pieces <= update.len().div_ceil(55) + 1 && bytes < update.len() * 6 / 5, "{bytes}");
}

struct SentBytes {
    pieces: usize,
    bytes: usize,
}

impl SentBytes {
    fn of(dive: &Dive) -> SentBytes {
        let statistics = dive.sender.statistics();
        assert_eq!(statistics.piece_bytes as usize, dive.bytes[1]);
        SentBytes { pieces: statistics.pieces as usize, bytes: dive.bytes[1] }
    }
}

#[test]
fn updates_take_their_share_of_the_rate_and_give_it_back() {
    let mut dive = Dive::new(0.2, true);
    dive.run(20);
    let before = std::mem::take(&mut dive.bytes);
    assert!((45_000..=50_500).contains(&before[0]), "{before:?}");
    for update in chain(6, &[150; 6]) {
        dive.push(&update);
    }
    dive.run(4);
    let during = std::mem::take(&mut dive.bytes);
    // A third of 10,000 bytes, and the rest.
    assert!((2_000..=3_500).contains(&during[1]), "{during:?}");
    assert!(during[0] <= 8_000 && during[0] + during[1] <= 10_400, "{during:?}");
    dive.run(40);
    assert_eq!(dive.sender.held_update(), Some(6));
    dive.bytes = [0; 2];
    dive.run(10);
    assert!(dive.bytes[1] == 0 && dive.bytes[0] > 22_500, "{:?}", dive.bytes);
}

#[test]
fn without_reports_it_counts_as_held_once_all_pieces_went_and_comes_again() {
    let mut came = 0;
    for seed in 0..100 {
        let mut dive = Dive::new(0.2, false);
        dive.random = Random::new(seed);
        dive.push(&chain(7, &[90])[0]);
        assert_eq!(dive.sender.held_update(), None);
        while dive.sender.held_update().is_none() {
            dive.step();
        }
        came += dive.states.len();
    }
    assert!((96..=100).contains(&came), "{came}");
    // A topside that joins late gets all of them, in a twelfth of the rate.
    let mut dive = Dive::new(0.2, false);
    chain(8, &[90, 60, 100]).iter().for_each(|update| dive.push(update));
    dive.run(30);
    assert_eq!(dive.sender.held_update(), Some(3));
    (dive.collector, dive.states, dive.bytes) = (collector(64), Vec::new(), [0; 2]);
    dive.run(40);
    assert_eq!(dive.states.len(), 3);
    let all = 40.0 * 2500.0;
    assert!(
        (dive.bytes[1] as f64) < all / 11.0 && dive.bytes[0] as f64 > 0.8 * all,
        "{:?}",
        dive.bytes
    );
}

#[test]
fn after_restarts_both_sides_come_back_to_one_version() {
    let mut dive = Dive::new(0.2, true);
    let chain = chain(9, &[60, 60, 60, 60, 60]);
    chain.iter().for_each(|update| dive.push(update));
    dive.run(30);
    assert_eq!(dive.sender.held_update(), Some(5));
    // The topside forgets all.
    (dive.collector, dive.states) = (collector(64), Vec::new());
    dive.run(30);
    assert_eq!((dive.sender.held_update(), dive.states.len()), (Some(5), 5));
    // The vehicle restarts with what it had learnt: one report, and it knows; hardly anything is sent.
    dive.sender = Sender::new(dive.options).unwrap();
    chain[..3].iter().for_each(|update| dive.push(update));
    dive.run(3);
    assert_eq!(dive.sender.held_update(), Some(3));
    assert!(dive.sender.statistics().pieces < 50, "{:?}", dive.sender.statistics());
}

/// Both sides go on from an earlier dive. Nothing of it is sent to a topside that holds it; one that does not gets it.
#[test]
fn an_update_of_an_earlier_dive_is_sent_only_to_a_topside_that_lacks_it() {
    let chain = chain(16, &[60, 60, 60]);
    for expect_reports in [false, true] {
        let mut dive = Dive::new(0.0, expect_reports);
        for update in &chain[..2] {
            let read = Update::read(update).unwrap();
            dive.states.push((read.number, read.state()));
            dive.sender.push_held_update(0.0, update).unwrap();
        }
        assert_eq!(dive.sender.held_update(), Some(2));
        dive.run(5);
        // Without reports they are repeated, and no more.
        let pieces = dive.bytes[1];
        assert!(if expect_reports { pieces == 0 } else { pieces * 11 < 5 * 2_500 }, "{pieces}");
        dive.push(&chain[2]);
        assert_eq!(dive.sender.held_update(), Some(2));
        dive.run(10);
        assert_eq!((dive.sender.held_update(), dive.states.len()), (Some(3), 3));
        (dive.collector, dive.states) = (collector(64), Vec::new());
        dive.run(40);
        assert_eq!((dive.sender.held_update(), dive.states.len()), (Some(3), 3));
    }
}

#[test]
fn what_is_held_follows_what_is_held() {
    let mut sender = Sender::new(options(64, 0.0, false)).unwrap();
    let chain = chain(17, &[60, 60]);
    assert_eq!(sender.update_share(), 0.0);
    sender.push_update(0.0, &chain[0]).unwrap();
    assert_eq!(sender.update_share(), UpdateOptions::default().share);
    // The one before it is not there yet.
    sender.push_held_update(0.0, &chain[1]).unwrap();
    assert_eq!(sender.held_update(), None);
    assert!(sender.push_held_update(f64::NAN, &chain[1]).is_err());
    while sender.held_update() != Some(2) {
        assert_eq!(sender.update_share(), UpdateOptions::default().share);
        let due = sender.due().expect("a piece is to come");
        assert_eq!(sender.next(due).map(|(at, _)| at), Some(due));
    }
    assert_eq!(sender.update_share(), UpdateOptions::default().repeat);
}

/// The vehicle drops an update that the topside may hold, and proves another one in its place.
#[test]
fn an_update_takes_the_place_of_one_that_was_dropped() {
    for expect_reports in [false, true] {
        let mut dive = Dive::new(0.1, expect_reports);
        let (dropped, other) = (chain(14, &[60, 60, 40]), chain(14, &[60, 60, 50]));
        dropped.iter().for_each(|update| dive.push(update));
        dive.run(4);
        dive.push(&other[2]);
        assert_ne!(dive.sender.held_update(), Some(3));
        dive.run(30);
        let update = Update::read(&other[2]).unwrap();
        assert_eq!(dive.sender.held_update(), Some(3));
        assert_eq!(dive.states.last(), Some(&(3, update.state())));
        // The first one of all may be another one, too.
        dive.push(&chain(15, &[30])[0]);
        assert_eq!(dive.sender.held_update(), None);
        dive.run(20);
        assert_eq!((dive.sender.held_update(), dive.states.len()), (Some(1), 1));
    }
}

#[test]
fn a_report_that_was_overtaken_changes_nothing() {
    let mut dive = Dive::new(0.0, true);
    dive.push(&chain(10, &[60])[0]);
    dive.run(2);
    let mut old = [0; 64];
    let len = dive.collector.report(1, |_| false).unwrap().unwrap().write(None, &mut old).unwrap();
    dive.run(5);
    assert_eq!(dive.sender.held_update(), Some(1));
    let (old, _) = Report::read(&old[..len]).unwrap();
    dive.sender.process_report(dive.now(), &old).unwrap();
    assert_eq!(dive.sender.held_update(), Some(1));
}

#[test]
fn what_cannot_be_sent_is_refused_and_nothing_changes() {
    let of = |updates| Sender::new(SenderOptions { updates, ..options(64, 0.1, true) });
    let chain = chain(11, &[60, 60, 60]);
    assert_eq!(of(None).unwrap().push_update(0.0, &chain[0]), Err(ModemError::NoUpdates));
    for (share, repeat) in [(0.0, 0.0), (1.0, 0.1), (f64::NAN, 0.1), (0.2, 0.3), (0.2, f64::NAN)] {
        let bad = UpdateOptions { share, repeat, memory: 1 };
        assert!(matches!(of(Some(bad)).map(drop), Err(ModemError::UpdateShare { .. })), "{bad:?}");
    }
    let memory = chain[0].len() * 5 / 2;
    let small = UpdateOptions { memory, ..UpdateOptions::default() };
    let mut sender = of(Some(small)).unwrap();
    assert!(sender.push_update(f64::NAN, &chain[0]).is_err());
    assert!(matches!(sender.push_update(0.0, &chain[0][1..]), Err(ModemError::Update(_))));
    sender.push_update(0.0, &chain[0]).unwrap();
    let refused = sender.push_update(0.0, &chain[2]);
    assert!(matches!(refused, Err(ModemError::UpdateOrder { number: 3, last: 1, .. })));
    sender.push_update(0.0, &chain[1]).unwrap();
    let refused = sender.push_update(0.0, &chain[2]);
    assert!(matches!(refused, Err(ModemError::UpdatesFull { .. })), "{refused:?}");
    assert_eq!(sender.statistics().updates, 2);
    let mut narrow = Sender::new(options(16, 0.1, true)).unwrap();
    let long = &super::updates::chain(12, &[300])[0];
    let refused = narrow.push_update(0.0, long);
    assert!(matches!(refused, Err(ModemError::UpdateTooLong { mtu: 16, .. })), "{refused:?}");
}

/// A sender without a bit rate gives out all pieces at once, and does not repeat them.
#[test]
fn without_a_rate_pieces_go_as_they_come() {
    let control = RateControlOptions { bit_rate: 0.0, ..options(64, 0.0, false).control };
    let plain = SenderOptions {
        control,
        stream: 0,
        protection: Protection::None,
        ..options(64, 0.0, false)
    };
    let mut sender = Sender::new(plain).unwrap();
    let update = &chain(13, &[60])[0];
    sender.push_update(2.0, update).unwrap();
    assert_eq!((sender.due(), sender.next(1.0)), (Some(2.0), None));
    let mut collector = collector(64);
    let mut indices = BTreeSet::new();
    while let Some((_, piece)) = sender.next(2.0) {
        indices.insert(piece[5]);
        let _ = collector.push(2.0, piece);
    }
    assert_eq!((sender.due(), sender.held_update()), (None, Some(1)));
    assert_eq!(collector.update(0), Some(&update[..]));
    assert_eq!(indices.len(), sender.statistics().pieces as usize);
}

#[test]
fn updates_cost_more_the_more_the_link_loses() {
    let price = |mtu, loss, reports| {
        let sender = Sender::new(options(mtu, loss, reports)).unwrap();
        sender.update_price().expect("updates are sent")
    };
    // Headers alone.
    assert!((1.0..1.1).contains(&price(256, 0.0, false)));
    assert!((1.1..1.4).contains(&price(64, 0.0, false)));
    // Parity; less of it if reports ask for what is missing.
    assert!((1.5..3.0).contains(&price(64, 0.2, false)));
    assert!(price(64, 0.2, true) < price(64, 0.2, false));
    let without = SenderOptions { updates: None, ..options(64, 0.2, false) };
    assert_eq!(Sender::new(without).unwrap().update_price(), None);
}
