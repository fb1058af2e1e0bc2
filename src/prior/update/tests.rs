use proptest::prelude::*;

use super::super::id::PriorId;
use super::*;
use crate::random::Random;

/// Any number of the chain that begins with prior 7, on the state before it if it is the first: a box of a few colours.
pub(crate) fn sample(number: u16, count: usize) -> Update {
    let mut random = Random::new(u64::from(number));
    let mut small = |low: f32, high: f32| random.within(low, high).round() as i8;
    let splats = (0..count).map(|index| {
        let mut position = [0, 1, 2].map(|_| i32::from(small(-100.0, 100.0)));
        position[index % 3] = 100;
        let log_scale = [0, 1, 2].map(|_| small(-14.0, -10.0));
        let round = log_scale[1] == log_scale[0] && log_scale[2] == log_scale[0];
        let rotation = [0, 1, 2].map(|_| if round { 0 } else { small(-6.0, 6.0) });
        let opacity = small(-1.0, 6.0);
        let colour = [0, 1, 2].map(|channel| 3 * (index % 2) as i8 + channel + small(-1.0, 1.0));
        NewSplat { position, log_scale, rotation, opacity, colour }
    });
    let mut update = Update {
        prior: PriorId(7),
        number,
        before: StateId(if number == 1 { 7 } else { 0x0102_0304 }),
        grid: UpdateGrid { origin: [1.5, -2.0, 8.25], exponent: -6 },
        splats: splats.collect(),
        removed: if number == 1 { vec![] } else { vec![0, 1, 5] },
        changed: if number == 1 { vec![] } else { changes(&mut random) },
        fades: vec![Fade { min: [-4, 0, 0], max: [3, 2, 9], factor: 64 }],
        frames: [100, 160],
    };
    update.splats = update.ordered();
    update
}

/// Some changes of the learnt splats that [`sample`] does not take back.
fn changes(random: &mut Random) -> Vec<Change> {
    let ordinals = [2, 3, 7, 8, 4095];
    let mut small = |most: f32| random.within(-most, most).round() as i8;
    let change = |ordinal| Change {
        ordinal,
        position: [(); 3].map(|()| small(3.0).into()),
        log_scale: [(); 3].map(|()| small(1.0)),
        rotation: [(); 3].map(|()| small(1.0)),
        opacity: small(1.0),
        colour: [1, small(2.0), small(2.0)],
    };
    ordinals.map(change).to_vec()
}

pub(crate) fn written(update: &Update) -> Vec<u8> {
    let mut bytes = Vec::new();
    update.write(&mut bytes).unwrap();
    bytes
}

/// Makes the check at the end right, so that a reader looks at the rest.
fn checked(mut bytes: Vec<u8>) -> Vec<u8> {
    let content = bytes.len().saturating_sub(4);
    let check = crc32fast::hash(&bytes[..content]);
    bytes[content..].copy_from_slice(&check.to_le_bytes());
    bytes
}

pub(crate) fn splat() -> impl Strategy<Value = NewSplat> {
    let near = proptest::array::uniform3(-200_i32..200);
    let position = prop_oneof![8 => near, 1 => any::<[i32; 3]>()];
    let turn = proptest::array::uniform3(-ROTATION_STEPS..=ROTATION_STEPS);
    let small = proptest::array::uniform3(-20_i8..20);
    let numbers = prop_oneof![4 => small, 1 => any::<[i8; 3]>()];
    (position, numbers.clone(), turn, LOGITS, numbers).prop_map(
        |(position, log_scale, rotation, opacity, colour)| {
            let splat = NewSplat { position, log_scale, rotation, opacity, colour };
            if splat.is_round() { NewSplat { rotation: [0; 3], ..splat } } else { splat }
        },
    )
}

/// A change of no certain splat, which changes something.
fn change() -> impl Strategy<Value = Change> {
    let near = proptest::array::uniform3(-5_i32..5);
    let position = prop_oneof![8 => near, 1 => any::<[i32; 3]>()];
    let few = proptest::array::uniform3(-2_i8..3);
    let small = prop_oneof![8 => few, 1 => any::<[i8; 3]>()];
    let opacity = prop_oneof![8 => -2_i8..3, 1 => any::<i8>()];
    let change = (position, small.clone(), small.clone(), opacity, small).prop_map(
        |(position, log_scale, rotation, opacity, colour)| Change {
            ordinal: 0,
            position,
            log_scale,
            rotation,
            opacity,
            colour,
        },
    );
    change.prop_filter("it changes something", |change| !change.is_nothing())
}

fn fade() -> impl Strategy<Value = Fade> {
    (any::<[i32; 3]>(), any::<[i32; 3]>(), any::<u8>()).prop_map(|(a, b, factor)| {
        let pick = |of: fn(i32, i32) -> i32| std::array::from_fn(|axis| of(a[axis], b[axis]));
        Fade { min: pick(Ord::min), max: pick(Ord::max), factor }
    })
}

prop_compose! {
    fn update()(
        prior in any::<u32>(),
        (number, before) in prop_oneof![Just((1, None)), (2_u16.., any::<u32>().prop_map(Some))],
        origin in proptest::array::uniform3(-1e6_f32..1e6),
        exponent in EXPONENTS,
        splats in proptest::collection::vec(splat(), 0..60),
        removed in proptest::collection::btree_set(0_u16..4096, 0..20),
        changed in proptest::collection::btree_map(0_u16..4096, change(), 0..20),
        fades in proptest::collection::vec(fade(), 0..6),
        frames in proptest::array::uniform2(0..=MAX_FRAME),
    ) -> Update {
        let changed = changed.into_iter().filter(|(ordinal, _)| !removed.contains(ordinal));
        let changed = changed.map(|(ordinal, change)| Change { ordinal, ..change }).collect();
        Update {
            prior: PriorId(prior),
            number,
            before: StateId(before.unwrap_or(prior)),
            grid: UpdateGrid { origin, exponent },
            splats,
            removed: removed.into_iter().collect(),
            changed,
            fades,
            frames,
        }
    }
}

proptest! {
    #[test]
    fn updates_come_back(update in update()) {
        let bytes = written(&update);
        let read = Update::read(&bytes).unwrap();
        prop_assert_eq!(read.state(), update.state());
        let expected = Update { splats: update.ordered(), ..update };
        prop_assert_eq!(&read, &expected);
        prop_assert_eq!(written(&read), bytes);
    }

    #[test]
    fn the_order_of_splats_does_not_count(update in update(), turn in any::<prop::sample::Index>()) {
        let mut other = update.clone();
        if !other.splats.is_empty() {
            other.splats.rotate_left(turn.index(update.splats.len()));
        }
        // Splats at one place keep their order.
        let mut places: Vec<_> = update.splats.iter().map(|splat| splat.position).collect();
        places.sort_unstable();
        places.dedup();
        prop_assume!(places.len() == update.splats.len());
        prop_assert_eq!(written(&other), written(&update));
        prop_assert_eq!(other.state(), update.state());
    }

    #[test]
    fn any_bytes_are_an_update_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = Update::read(&bytes);
        let mut file = MAGIC.to_vec();
        file.push(1);
        file.extend(bytes);
        reads_or_refuses(&checked(file));
    }
}

/// What can be read is written to the same bytes.
fn reads_or_refuses(bytes: &[u8]) -> bool {
    let Ok(update) = Update::read(bytes) else { return false };
    assert_eq!(written(&update), bytes);
    true
}

#[test]
fn the_bytes_are_part_of_the_format() {
    let update = sample(2, 40);
    let bytes = written(&update);
    let check = u32::from_le_bytes(*bytes.last_chunk().unwrap());
    assert_eq!(
        (bytes.len(), check, update.state().to_string()),
        (319, 3_247_468_457, "7e698bb4".into())
    );
}

#[test]
fn an_update_may_be_empty_or_full() {
    for count in [0, 1, MAX_LEARNT] {
        let (removed, changed) = ((0..4096).collect(), vec![]);
        let update = Update { removed, changed, ..sample(2, count) };
        assert_eq!(Update::read(&written(&update)).unwrap(), update);
    }
    let change = |ordinal| Change { ordinal, opacity: 1, ..Change::default() };
    let changed = (0..MAX_LEARNT as u16).map(change).collect();
    let update = Update { removed: vec![], changed, ..sample(2, 3) };
    assert_eq!(Update::read(&written(&update)).unwrap(), update);
    let alike = Update { splats: vec![NewSplat::default(); MAX_LEARNT], ..sample(1, 0) };
    let bytes = written(&alike);
    assert_eq!(Update::read(&bytes).unwrap(), alike);
    assert!(bytes.len() < 700, "{} bytes", bytes.len());
}

#[test]
fn every_cut_and_every_changed_bit_is_refused() {
    let bytes = written(&sample(2, 40));
    for length in 0..bytes.len() {
        assert!(Update::read(&bytes[..length]).is_err(), "{length} bytes");
    }
    for bit in 0..8 * bytes.len() {
        let mut other = bytes.clone();
        other[bit / 8] ^= 1 << (bit % 8);
        assert!(Update::read(&other).is_err(), "bit {bit}");
    }
    let longer = checked([bytes.as_slice(), &[0; 4]].concat());
    assert!(
        matches!(Update::read(&longer), Err(UpdateError::Field { .. })),
        "bytes behind the end"
    );
}

#[test]
fn mutated_updates_with_a_right_check_are_read_or_refused() {
    let files = [sample(1, 0), sample(2, 3), sample(3, 12), sample(4, 40)].map(|u| written(&u));
    let mut random = Random::new(1);
    let mut read = 0;
    for round in 0..100_000 {
        let mut bytes = files[round % files.len()].clone();
        for _ in 0..1 + random.bits() % 4 {
            let at = 5 + random.bits() as usize % (bytes.len() - 5);
            match random.bits() % 4 {
                0 => bytes[at] = random.bits() as u8,
                1 => bytes[at] ^= 1 << (random.bits() % 8),
                2 => bytes.truncate(at.max(20)),
                _ => bytes.insert(at, random.bits() as u8),
            }
        }
        read += usize::from(reads_or_refuses(&checked(bytes)));
    }
    assert!((1000..99_000).contains(&read), "{read} could be read");
}

#[test]
fn refusals_name_what_is_wrong() {
    let bytes = written(&sample(1, 5));
    let refused = |bytes: &[u8]| Update::read(bytes).unwrap_err();
    assert!(matches!(refused(b""), UpdateError::UnknownFormat));
    assert!(matches!(refused(&bytes[..18]), UpdateError::Truncated { needed: 19, found: 18 }));
    let mut newer = bytes.clone();
    newer[4] = 2;
    assert!(matches!(refused(&checked(newer)), UpdateError::Newer { version: 2, known: 1 }));
    let mut other = bytes.clone();
    other[9] = 0;
    let error = refused(&checked(other)).to_string();
    assert_eq!(error, "the update has the number 0; the first one of a chain has 1");
    let mut other = bytes;
    other[11] ^= 1;
    let error = refused(&checked(other)).to_string();
    assert!(
        error.contains("is the first, but stands on 00000006, not on prior 00000007"),
        "{error}"
    );
}

#[test]
fn what_no_update_can_hold_is_not_written() {
    let good = sample(2, 3);
    let refused = |change: fn(&mut Update)| {
        let mut update = good.clone();
        change(&mut update);
        let mut bytes = vec![9];
        let error = update.write(&mut bytes).unwrap_err();
        assert_eq!(bytes, [9]);
        error.to_string()
    };
    for (error, expected) in [
        (refused(|u| u.grid.exponent = 41), "a grid with positions in steps of 2^41"),
        (refused(|u| u.grid.origin[0] = f32::NAN), "a grid with origin NaN is not finite"),
        (refused(|u| u.frames[1] = 1 << 24), "frame number of 16777216"),
        (
            refused(|u| u.splats[2].opacity = 9),
            "splat 2 of the update: opacity of 9 steps: -5 to 8",
        ),
        (refused(|u| u.splats[1].rotation[0] = -13), "splat 1 of the update: rotation of -13"),
        (refused(|u| u.removed = vec![3, 3]), "removed splat 1 of the update: they do not rise"),
        (refused(|u| u.removed = vec![4096]), "removed splat 0 of the update: 4096 of 4096"),
        (refused(|u| u.changed[1].ordinal = 2), "changed splat 1 of the update: they do not rise"),
        (refused(|u| u.changed[4].ordinal = 4096), "changed splat 4 of the update: 4096 of 4096"),
        (
            refused(|u| u.changed = vec![u.changed[0]; 4097]),
            "changed splat 1 of the update: they do not rise",
        ),
        (
            refused(|u| u.changed[2].ordinal = 5),
            "changed splat 2 of the update: splat 5 is taken back, too",
        ),
        (
            refused(|u| u.changed[3] = Change { ordinal: 8, ..Change::default() }),
            "changed splat 3 of the update: it stays as it is; leave it out",
        ),
        (refused(|u| u.fades[0].max[1] = -1), "fade 0 of the update: its highest cell lies below"),
        (refused(|u| u.fades = vec![u.fades[0]; 257]), "257 fades in all updates: at most 256"),
        (refused(|u| u.splats = vec![u.splats[0]; 4097]), "4097 learnt splats: at most 4096"),
    ] {
        assert!(error.contains(expected), "{error}");
    }
}
