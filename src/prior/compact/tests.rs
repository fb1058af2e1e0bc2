use proptest::prelude::*;

use super::super::key_frames::tests::sample_key_frames;
use super::super::tests::{bare, sample_splats, sample_tables};
use super::super::{
    CoordinateFrame, Fault, INFINITE_LOGIT, Prior, RenderOptions, RenderOverrides,
    with_coder_tables, with_extras,
};
use super::*;
use crate::coder_tables::Tables;

fn written(splats: &Splats, options: &RenderOptions, q: &Quantisation) -> (PriorId, Vec<u8>) {
    let mut bytes = Vec::new();
    let id = write(splats, &bare(options), q, &mut bytes).unwrap();
    (id, bytes)
}

/// A file of this many splats of degree 1.
fn sample(count: usize) -> (PriorId, Vec<u8>) {
    written(&sample_splats(count, 1), &RenderOptions::INRIA, &Quantisation::default())
}

fn open(bytes: &[u8]) -> Prior {
    Prior::from_bytes(bytes, "p.nvsg", &RenderOverrides::default()).unwrap()
}

/// One of everything.
fn sample_extras(splats: usize) -> Extras {
    Extras {
        key_frames: sample_key_frames(5),
        doubt: Some((0..splats).map(|splat| splat as u8).collect()),
        record: Some("a record".into()),
        ..Extras::default()
    }
}

/// The file with what a reader must find changed in its head.
fn forged(bytes: &[u8], change: impl FnOnce(Head) -> Head) -> Vec<u8> {
    let head = change(Head::read(bytes, Format::Compact, u64::MAX).unwrap());
    [&head.to_bytes()[..], &bytes[Head::BYTES..]].concat()
}

/// Splats of any kind that a prior may hold, from random words.
fn any_splats(words: &[u32], sh_degree: u32) -> Splats {
    let mut splats = Splats { sh_degree, ..Splats::default() };
    let stride = splats.sh_stride();
    for row in words.chunks_exact(11 + stride) {
        let unit = |i: usize| row[i] as f32 / u32::MAX as f32 * 2.0 - 1.0;
        // Most are near, some lie anywhere up to the limits of f32.
        let size = if row[0] & 7 == 0 { 10_f32.powf(38.0 * unit(1)) } else { 5.0 };
        splats.positions.push([0, 1, 2].map(|i| unit(i) * size));
        splats.log_scales.push([3, 4, 5].map(|i| unit(i) * 40.0));
        splats.rotations.push([6, 7, 8, 9].map(|i| unit(i) + 1e-3));
        splats.opacity_logits.push(unit(10) * 25.0);
        splats.sh.extend((11..row.len()).map(|i| unit(i) * 4.0));
    }
    splats
}

/// R diag(exp(2 s)) Rᵀ of a splat, and its largest variance.
fn covariance(splats: &Splats, index: usize) -> (glam::DMat3, f64) {
    let [w, x, y, z] = splats.unit_rotation(index).map(f64::from);
    let turn = glam::DMat3::from_quat(glam::DQuat::from_xyzw(x, y, z, w).normalize());
    let scales = glam::DVec3::from(splats.log_scales[index].map(|s| (2.0 * f64::from(s)).exp()));
    (turn * glam::DMat3::from_diagonal(scales) * turn.transpose(), scales.max_element())
}

#[test]
fn errors_are_half_a_step_at_most() {
    let mut splats = sample_splats(300, 2);
    for (i, position) in splats.positions.iter_mut().enumerate() {
        position.rotate_left(i % 3);
    }
    let q = Quantisation::default();
    let file = read(&written(&splats, &RenderOptions::GSPLAT, &q).1).unwrap();
    assert_eq!((file.splats.len(), file.options), (300, RenderOptions::GSPLAT));
    let step = CoordinateFrame::of(&splats.positions).unit() as f32 * q.position;
    let mut left: Vec<usize> = (0..splats.len()).collect();
    for i in 0..splats.len() {
        // The order is the file's own: a splat is found by its place.
        let found = left.iter().position(|from| {
            let pairs = splats.positions[*from].iter().zip(&file.splats.positions[i]);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) <= step / 2.0
        });
        let from = left.swap_remove(found.expect("its place"));
        let logit = splats.opacity_logits[from].min(INFINITE_LOGIT);
        assert!((logit - file.splats.opacity_logits[i]).abs() <= 0.501 * q.opacity_logit);
        for c in 0..27 {
            let limit = 0.501 * if c < 3 { q.colour } else { q.sh };
            let (a, b) = (splats.sh[27 * from + c], file.splats.sh[27 * i + c]);
            assert!((a - b).abs() <= limit, "splat {i}: {a} {b}");
        }
        let ((before, largest), (after, _)) =
            (covariance(&splats, from), covariance(&file.splats, i));
        let errors = (before - after).to_cols_array().map(f64::abs);
        // Scales off by half a step, a rotation by √3 half steps of half its angle.
        let limit = 1.1 * f64::from(q.log_scale) + 4.0 * f64::from(q.rotation);
        assert!(errors.iter().all(|e| *e <= limit * largest), "splat {i}: {errors:?}");
    }
}

#[test]
fn opened_by_content_as_the_prior_that_was_written() {
    let background = [0.1, 0.2, 0.3];
    let trained_focal = Some(270.25);
    let options =
        RenderOptions { antialiased: true, background, trained_focal, ..RenderOptions::INRIA };
    for degree in 0..=3 {
        for count in [1, 2, 50] {
            let splats = sample_splats(count, degree);
            let (id, bytes) = written(&splats, &options, &Quantisation::default());
            let prior = open(&bytes);
            assert_eq!((prior.id(), prior.len()), (id, count));
            assert_eq!(*prior.options(), options);
            assert_eq!(prior.report().format, PriorFormat::Compact);
            assert!(prior.report().dropped.is_empty());
        }
    }
}

#[test]
fn far_and_extreme_splats_stay_where_they_are() {
    let mut splats = sample_splats(9, 0);
    splats.positions[4] = [1e30, -1e30, 1e-30];
    splats.positions[5] = [-3e38, 0.0, 3e38];
    splats.log_scales[6] = [40.0, -40.0, 39.99];
    splats.opacity_logits[7] = -1e30;
    let (_, bytes) = written(&splats, &RenderOptions::INRIA, &Quantisation::default());
    let file = read(&bytes).unwrap();
    for far in [splats.positions[4], splats.positions[5]] {
        let close = |p: &&[f32; 3]| (p[0] / far[0] - 1.0).abs() <= 2e-6;
        assert_eq!(file.splats.positions.iter().filter(close).count(), 1, "{far:?}");
    }
    let prior = Prior::from_splats(file.splats, file.options).unwrap();
    assert!(prior.report().dropped.is_empty());
}

#[test]
fn invalid_splats_and_senseless_steps_are_named() {
    let attempt = |change: fn(&mut Splats), q: &Quantisation| {
        let mut splats = sample_splats(5, 1);
        change(&mut splats);
        write(&splats, &bare(&RenderOptions::INRIA), q, Vec::new()).unwrap_err()
    };
    let q = Quantisation::default();
    let error = attempt(|s| s.positions[3][1] = f32::NAN, &q);
    assert!(matches!(error, PriorError::Invalid { splat: 3, fault: Fault::NonFinite }), "{error}");
    let error = attempt(|s| s.log_scales[2][0] = 41.0, &q);
    assert!(matches!(error, PriorError::Invalid { splat: 2, fault: Fault::Scale }), "{error}");
    let error = attempt(|s| s.sh[12 * 4 + 7] = 1e30, &q);
    assert!(matches!(error, PriorError::Invalid { splat: 4, fault: Fault::Colour }), "{error}");
    let error = attempt(|s| s.sh[12 * 4] = 9e5, &Quantisation { colour: 1e-3, ..q });
    assert!(matches!(error, PriorError::OutOfSteps { splat: 4, .. }), "{error}");
    let error = attempt(|s| *s = Splats::default(), &q);
    assert!(matches!(error, PriorError::Empty), "{error}");
    for step in [0.0, -1.0, f32::NAN, f32::INFINITY, 1.5] {
        let error = attempt(|_| (), &Quantisation { colour: step, ..q });
        assert!(matches!(error, PriorError::Step { name: "colour", .. }), "{error}");
    }
}

#[test]
fn splats_that_are_kept_exactly_keep_their_identity() {
    for degree in 0..=3 {
        let (splats, options) = (sample_splats(40, degree), RenderOptions::GSPLAT);
        let foreign = Prior::from_splats(splats, options).unwrap();
        let extras = sample_extras(40);
        let foreign = foreign.with_extras(extras.clone()).unwrap();
        let mut bytes = Vec::new();
        let id = write_exact(foreign.splats(), &foreign.besides(), &mut bytes).unwrap();
        let own = open(&bytes);
        assert_eq!((id, own.id()), (foreign.id(), foreign.id()));
        assert_eq!(own.splats(), foreign.splats());
        assert_eq!((&own.extras().doubt, &own.extras().record), (&extras.doubt, &extras.record));
        every_cut_is_noticed(&bytes);
    }
}

#[test]
fn extras_travel_with_the_splats_and_change_nothing_of_them() {
    let (id, without) = sample(7);
    let with = with_extras(&without, &sample_extras(7)).unwrap();
    let prior = open(&with);
    assert_eq!((prior.id(), prior.splats()), (id, open(&without).splats()));
    assert_eq!(prior.key_frames().len(), 5);
    assert_eq!(prior.extras().doubt, sample_extras(7).doubt);
    // Put in again, and taken out.
    assert_eq!(with_extras(&with, prior.extras()).unwrap(), with);
    assert_eq!(with_extras(&with, &Extras::default()).unwrap(), without);
    let refused = with_extras(&without, &sample_extras(6));
    assert!(matches!(refused, Err(PriorError::Shape { array: "doubt", .. })));
    assert!(matches!(with_extras(&with[1..], prior.extras()), Err(PriorError::UnknownFormat)));
}

#[test]
fn doubt_follows_its_splat() {
    let mut splats = sample_splats(60, 0);
    for (i, position) in splats.positions.iter_mut().enumerate() {
        *position = [(i * 37 % 60) as f32, 0.0, 0.0];
    }
    let doubt = splats.positions.iter().map(|position| position[0] as u8).collect();
    let extras = Extras { doubt: Some(doubt), ..Extras::default() };
    let besides = Besides { extras: &extras, ..bare(&RenderOptions::INRIA) };
    let mut bytes = Vec::new();
    write(&splats, &besides, &Quantisation::default(), &mut bytes).unwrap();
    let prior = open(&bytes);
    assert_ne!(prior.splats().positions, splats.positions);
    let doubt = prior.extras().doubt.as_ref().unwrap();
    for (position, doubt) in prior.splats().positions.iter().zip(doubt) {
        assert_eq!(position[0].round() as u8, *doubt);
    }
}

#[test]
fn coder_tables_travel_with_the_splats_and_name_another_prior() {
    let (id, without) = sample(7);
    let without = with_extras(&without, &sample_extras(7)).unwrap();
    let tables = sample_tables(1);
    let with = with_coder_tables(&without, Some(&tables)).unwrap();
    let (plain, prior) = (open(&without), open(&with));
    assert_eq!((prior.splats(), prior.extras()), (plain.splats(), plain.extras()));
    assert_eq!(prior.coder_tables().map(|t| &**t), Some(&tables));
    assert!(plain.coder_tables().is_none() && plain.id() == id && prior.id() != id);
    assert_eq!(plain.with_coder_tables(Some(tables.clone())).id(), prior.id());
    // They can be replaced and removed.
    let other = with_coder_tables(&with, Some(&sample_tables(2))).unwrap();
    assert!(open(&other).id() != id && open(&other).id() != prior.id());
    assert_eq!(with_coder_tables(&other, Some(&tables)).unwrap(), with);
    assert_eq!(with_coder_tables(&with, None).unwrap(), without);
    assert!(matches!(with_coder_tables(&with[1..], None), Err(PriorError::UnknownFormat)));
    // A weight more or less is another prior.
    let mut changed = tables.write();
    changed[100] ^= 1;
    let changed = with_coder_tables(&with, Some(&Tables::read(&changed).unwrap())).unwrap();
    let changed = forged(&changed, |head| Head { id: prior.id(), ..head });
    assert!(matches!(read(&changed), Err(PriorError::Identity { .. })));
}

#[test]
fn every_flipped_bit_and_every_cut_is_noticed() {
    let (_, bytes) = sample(4);
    for bit in 0..bytes.len() * 8 {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(read(&damaged).is_err(), "bit {bit}");
    }
    every_cut_is_noticed(&bytes);
}

fn every_cut_is_noticed(bytes: &[u8]) {
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length]).is_err(), "{length} bytes");
    }
    assert!(read(&[bytes, &[0]].concat()).is_err());
}

#[test]
fn another_prior_under_the_same_name_is_noticed() {
    let (id, bytes) = sample(4);
    let other = forged(&bytes, |head| Head { id: PriorId(id.0 ^ 1), ..head });
    let error = read(&other).unwrap_err();
    assert!(matches!(error, PriorError::Identity { found, .. } if found == id), "{error}");
}

#[test]
fn forged_counts_are_refused() {
    for count in [u32::MAX, 1 << 20, 1000] {
        let error = read(&forged(&sample(4).1, |h| Head { splats: count, ..h })).unwrap_err();
        assert!(error.to_string().contains("truncated"), "{error}");
    }
    let none = read(&forged(&sample(4).1, |head| Head { splats: 0, ..head }));
    assert!(matches!(none, Err(PriorError::Empty)));
    for degree in [0, 2, 4] {
        assert!(read(&forged(&sample(4).1, |h| Head { sh_degree: degree, ..h })).is_err());
    }
}

#[test]
fn a_file_without_splats_or_options_is_refused() {
    let (_, bytes) = sample(4);
    for (part, text) in [(PartName::SPLATS, "splats"), (PartName::OPTIONS, "options")] {
        let mut file = Container::read(&bytes, Format::Compact).unwrap();
        file.set(part, None);
        let error = read(&file.to_bytes()).unwrap_err();
        assert!(error.to_string().contains(&format!("no part \"{text}\"")), "{error}");
    }
}

proptest! {
    #[test]
    fn what_was_read_is_written_the_same_again(
        words in proptest::collection::vec(any::<u32>(), 23..600),
        degree in 0..=1_u32,
        factor in 0.01..2.0_f32,
    ) {
        let splats = any_splats(&words, degree);
        let q = Quantisation::default().scaled(factor);
        let (id, bytes) = written(&splats, &RenderOptions::INRIA, &q);
        let file = read(&bytes).unwrap();
        prop_assert_eq!(identity_of(&file.splats, &file.options, None, None), id);
        let (again, bytes) = written(&file.splats, &file.options, &q);
        prop_assert_eq!(read(&bytes).unwrap().splats, file.splats);
        prop_assert_eq!(again, id);
    }

    #[test]
    fn arbitrary_splats_are_an_error(
        content in proptest::collection::vec(any::<u8>(), 0..300),
        forged in any::<bool>(),
        exact in any::<bool>(),
    ) {
        let (_, bytes) = sample(20);
        let mut file = Container::read(&bytes, Format::Compact).unwrap();
        let own = file.part(PartName::SPLATS).unwrap().content[..40].to_vec();
        let content = if forged { [own, content].concat() } else { content };
        file.set(if exact { PartName::EXACT } else { PartName::SPLATS }, Some(content));
        prop_assert!(read(&file.to_bytes()).is_err());
    }

    #[test]
    fn any_position_has_its_rank(code in proptest::array::uniform3(-(1_i32 << 29)..1 << 29)) {
        prop_assert_eq!(stream::unrank(stream::rank(code)), code);
    }
}
