use nvsprior::PriorId;
use nvsprior::modem::{Collected, Collector, CollectorOptions};
use nvsprior::prior::{Learnt, NewSplat, Update, UpdateGrid};

use super::*;

const PRIOR: PriorId = PriorId(7);
const LINK: PieceLink = PieceLink {
    bit_rate: 8_000.0,
    mtu: 64,
    overhead: 0,
    loss: Loss { chance: 0.1, burst: 1.0 },
    stream: 2,
    share: 0.25,
    expect_reports: false,
};

/// A chain of updates; other ones for each seed.
fn chain(seed: i32, count: usize) -> Vec<SentUpdate> {
    let mut learnt = Learnt::none(PRIOR);
    let next = |_| {
        let splat = |k: i32| NewSplat {
            position: [k * 7 % 31, seed + k % 5, k],
            log_scale: [-6; 3],
            ..NewSplat::default()
        };
        let update = Update {
            prior: PRIOR,
            number: learnt.number() + 1,
            before: learnt.state(),
            grid: UpdateGrid { origin: [0.0; 3], exponent: -4 },
            splats: (0..40).map(splat).collect(),
            removed: vec![],
            changed: vec![],
            fades: vec![],
            frames: [0, 1],
        };
        learnt.add(&update).unwrap();
        let mut bytes = Vec::new();
        update.write(&mut bytes).unwrap();
        SentUpdate::new(bytes, false).unwrap()
    };
    (0..count).map(next).collect()
}

/// Takes the pieces that are due before `until`, seconds. Returns their bytes, and the updates that they yield.
fn take(pieces: &mut Pieces, collector: &mut Collector, until: f64) -> (usize, Vec<Vec<u8>>) {
    let (mut bytes, mut updates) = (0, Vec::new());
    while let Some(due) = pieces.due().filter(|due| *due < until) {
        let piece = pieces.next(due).unwrap();
        bytes += piece.len();
        if let Ok(Collected::Update(stream)) = collector.push(until, &piece) {
            updates.push(collector.update(stream).unwrap().to_vec());
            collector.settle_update(stream, true);
        }
    }
    (bytes, updates)
}

fn collector() -> Collector {
    let options = CollectorOptions { streams: 3, update_bytes: 4000, ..CollectorOptions::new(64) };
    Collector::new(options).unwrap()
}

fn held(update: &SentUpdate) -> Answer {
    Answer::Held { name: update.name, over_link: true }
}

#[test]
fn an_update_goes_in_its_share_of_the_rate_and_is_held_then() {
    let (mut pieces, mut collector, chain) = (Pieces::default(), collector(), chain(1, 2));
    // Before the link is known it waits.
    pieces.push(0.0, chain[0].clone());
    assert_eq!((pieces.due(), pieces.answers()), (None, vec![]));
    pieces.follow(1.0, LINK).unwrap();
    let told = pieces.answers();
    assert!(
        matches!(told[..], [Answer::Link { share: 0.25, price }] if (1.0..3.0).contains(&price)),
        "{told:?}"
    );
    let (mut bytes, mut came, mut now) = (0, Vec::new(), 1.0);
    let mut answers = Vec::new();
    while answers.is_empty() {
        now += 0.1;
        let (more, updates) = take(&mut pieces, &mut collector, now);
        bytes += more;
        came.extend(updates);
        answers = pieces.answers();
    }
    assert_eq!(came, [chain[0].bytes.to_vec()]);
    // 250 bytes a second.
    let expected = 250.0 * (now - 1.0);
    assert!((bytes as f64 - expected).abs() < 100.0, "{bytes} of {expected}");
    // A twelfth for repetitions.
    let told = answers.iter().find_map(|answer| match answer {
        Answer::Link { share, .. } => Some(*share),
        _ => None,
    });
    assert!(answers.contains(&held(&chain[0])) && told.is_some_and(|share| share < 0.1));
    assert!(pieces.answers().is_empty(), "once");
    pieces.tell_again();
    assert_eq!(pieces.answers()[1..], [held(&chain[0])]);
    pieces.push(now, chain[0].clone());
    assert!(pieces.answers().is_empty(), "it is there already");
    pieces.push(now, chain[1].clone());
    assert!(matches!(pieces.answers()[..], [Answer::Link { share: 0.25, .. }]));
}

#[test]
fn another_link_takes_the_updates_over() {
    let (mut pieces, chain) = (Pieces::default(), chain(2, 3));
    pieces.follow(0.0, LINK).unwrap();
    pieces.push(0.0, SentUpdate { held: true, ..chain[0].clone() });
    let told = pieces.answers();
    assert!(told.contains(&held(&chain[0])), "both sides begin with it: {told:?}");
    pieces.push(0.0, chain[1].clone());
    let slower = PieceLink { bit_rate: 4_000.0, loss: Loss { chance: 0.3, burst: 2.0 }, ..LINK };
    for (now, link) in [(1.0, slower), (2.0, PieceLink { mtu: 40, ..slower })] {
        pieces.follow(now, link).unwrap();
        assert!(!pieces.answers().contains(&held(&chain[1])));
    }
    let mut collector = collector();
    let (_, came) = take(&mut pieces, &mut collector, 100.0);
    assert!(came.contains(&chain[1].bytes.to_vec()), "in pieces of 40 bytes");
    assert!(pieces.answers().contains(&held(&chain[1])));
    assert!(pieces.follow(3.0, PieceLink { share: 0.0, ..LINK }).is_err());
    assert!(Pieces::default().follow(3.0, PieceLink { mtu: 3, ..LINK }).is_err());
}

#[test]
fn what_cannot_be_sent_is_told_once() {
    let (mut pieces, chain) = (Pieces::default(), chain(3, 3));
    pieces.follow(0.0, LINK).unwrap();
    pieces.push(0.0, chain[0].clone());
    pieces.answers();
    pieces.push(0.0, chain[2].clone());
    assert!(matches!(pieces.take_refusal(), Some(ModemError::UpdateOrder { .. })));
    assert_eq!(pieces.take_refusal(), None);
    assert_eq!(pieces.answers(), [Answer::Refused(chain[2].name)]);
    assert!(pieces.answers().is_empty());
    // Another one of that number takes its place.
    let other = self::chain(4, 1).remove(0);
    pieces.push(0.0, other.clone());
    take(&mut pieces, &mut collector(), 100.0);
    assert_eq!(pieces.held(), Some(other.name));
}

#[test]
fn reports_tell_what_is_held() {
    let (mut pieces, mut collector, chain) = (Pieces::default(), collector(), chain(5, 1));
    let report = |collector: &Collector, states: &[(u16, nvsprior::prior::StateId)]| {
        let mut report = Report::new(2, 9, std::iter::empty()).unwrap();
        assert!(collector.report(2, |_| false).unwrap().is_none(), "no packet has come");
        report.tell_states(states.iter().copied());
        let mut bytes = vec![0; 64];
        let len = report.write(None, &mut bytes).unwrap();
        bytes.truncate(len);
        bytes
    };
    assert_eq!(pieces.report(0.0, &report(&collector, &[])), Err(ModemError::NoUpdates));
    pieces.follow(0.0, PieceLink { expect_reports: true, ..LINK }).unwrap();
    pieces.push(0.0, chain[0].clone());
    take(&mut pieces, &mut collector, 20.0);
    assert_eq!((pieces.held(), pieces.due()), (None, None), "a report must tell it");
    // It was lost: more pieces go.
    pieces.report(20.0, &report(&collector, &[])).unwrap();
    assert!(pieces.due().is_some());
    take(&mut pieces, &mut collector, 40.0);
    let name = chain[0].name;
    pieces.report(40.0, &report(&collector, &[(name.number, name.state)])).unwrap();
    assert!(pieces.answers().contains(&held(&chain[0])));
    assert!(pieces.report(40.0, b"junk").is_err());
    let mut deaf = Pieces::default();
    deaf.follow(0.0, LINK).unwrap();
    assert_eq!(deaf.report(0.0, &report(&collector, &[])), Err(ModemError::NoReports));
}
