//! Memory that reading an update takes: bounded, whatever the bytes are.

use std::alloc::System;

use nvsprior::PriorId;
use nvsprior::prior::update::{LOGITS, MAX_FADES, MAX_LEARNT, ROTATION_STEPS};
use nvsprior::prior::{Change, Fade, NewSplat, StateId, Update, UpdateGrid};
use nvsprior::random::Random;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes that were allocated to read it, those of buffers that grow counted each time.
fn taken(bytes: &[u8]) -> (usize, bool) {
    let region = Region::new(ALLOCATOR);
    let read = Update::read(bytes).is_ok();
    let change = region.change();
    (change.bytes_allocated + change.bytes_reallocated.unsigned_abs(), read)
}

fn update(splats: Vec<NewSplat>, removed: Vec<u16>, fades: Vec<Fade>) -> Vec<u8> {
    written(&Update { splats, removed, fades, ..empty() })
}

fn empty() -> Update {
    Update {
        prior: PriorId(1),
        number: 2,
        before: StateId(2),
        grid: UpdateGrid { origin: [0.0; 3], exponent: 0 },
        splats: vec![],
        removed: vec![],
        changed: vec![],
        fades: vec![],
        frames: [0, 0],
    }
}

fn written(update: &Update) -> Vec<u8> {
    let mut bytes = Vec::new();
    update.write(&mut bytes).unwrap();
    bytes
}

/// The largest update, of numbers that nothing predicts.
fn largest() -> Vec<u8> {
    let mut random = Random::new(1);
    let mut any = |from: i32, to: i32| {
        let count = (i64::from(to) - i64::from(from) + 1) as u64;
        (i64::from(from) + (random.bits() % count) as i64) as i32
    };
    let mut small = |from: i8, to: i8| any(from.into(), to.into()) as i8;
    let looks: Vec<NewSplat> = (0..MAX_LEARNT)
        .map(|_| NewSplat {
            position: [0; 3],
            log_scale: [(); 3].map(|()| small(i8::MIN, i8::MAX)),
            rotation: [(); 3].map(|()| small(-ROTATION_STEPS, ROTATION_STEPS)),
            opacity: small(*LOGITS.start(), *LOGITS.end()),
            colour: [(); 3].map(|()| small(i8::MIN, i8::MAX)),
        })
        .collect();
    let mut place = || [(); 3].map(|()| any(i32::MIN, i32::MAX));
    let splats = looks.into_iter().map(|splat| NewSplat { position: place(), ..splat }).collect();
    let removed = (0..MAX_LEARNT as u16).collect();
    let fade = |_| Fade { min: place(), max: [i32::MAX; 3], factor: 9 };
    update(splats, removed, (0..MAX_FADES).map(fade).collect())
}

/// An update that changes all splats that there can be, by numbers that nothing predicts.
fn all_change() -> Vec<u8> {
    let mut random = Random::new(3);
    let mut byte = || random.bits() as i8;
    let change = |ordinal| Change {
        ordinal,
        position: [(); 3].map(|()| i32::from(byte()) << 23),
        log_scale: [(); 3].map(|()| byte()),
        rotation: [(); 3].map(|()| byte()),
        opacity: 1,
        colour: [(); 3].map(|()| byte()),
    };
    written(&Update { changed: (0..MAX_LEARNT as u16).map(change).collect(), ..empty() })
}

/// What one update may take. The splats of the largest one take 98 kB, each of a few copies.
const MOST: usize = 2 << 20;

// One test: what others allocate at the same time would count.
#[test]
fn no_update_takes_more_than_two_megabytes() {
    let largest = largest();
    let (bytes, read) = taken(&largest);
    assert!(read && bytes < MOST, "{bytes} bytes for {} of a file", largest.len());
    let changes = all_change();
    let (bytes, read) = taken(&changes);
    assert!(read && bytes < MOST, "{bytes} bytes for {} of a file", changes.len());
    // A few hundred bytes that stand for as many splats.
    let alike = update(vec![NewSplat::default(); MAX_LEARNT], vec![], vec![]);
    let (bytes, read) = taken(&alike);
    assert!(read && bytes < MOST, "{bytes} bytes for {} of a file", alike.len());
    bytes_at_random_take_no_more();
}

fn bytes_at_random_take_no_more() {
    let start = update(vec![], vec![], vec![]);
    let mut random = Random::new(2);
    for length in (0..2000).map(|round| round % 64 * 16) {
        let mut file = start[..15].to_vec();
        file.extend((0..length).map(|_| random.bits() as u8));
        file.extend(crc32fast::hash(&file).to_le_bytes());
        let (bytes, _) = taken(&file);
        assert!(bytes < MOST, "{bytes} bytes");
    }
    // Bytes without a right check take nothing at all.
    assert_eq!(taken(&vec![b'n'; 1 << 20]), (0, false));
}
