use proptest::prelude::*;

use super::super::key_frames::tests::sample_key_frames;
use super::super::tables_file::tests::sample_tables;
use super::super::tests::sample_splats;
use super::super::{CoordinateFrame, Fault, INFINITE_LOGIT, PartSource, Prior, RenderOverrides};
use super::*;
use crate::image::Clahe;

fn written(splats: &Splats, options: &RenderOptions, q: &Quantisation) -> (PriorId, Vec<u8>) {
    let mut bytes = Vec::new();
    let id = write(splats, options, &KeyFrames::NONE, q, &mut bytes).unwrap();
    (id, bytes)
}

/// A file of this many splats of degree 1.
fn sample(count: usize) -> (PriorId, Vec<u8>) {
    written(&sample_splats(count, 1), &RenderOptions::INRIA, &Quantisation::default())
}

/// Writes a file with key frames.
fn sample_with_key_frames(count: usize) -> (PriorId, Vec<u8>) {
    let (splats, key_frames) = (sample_splats(count, 1), sample_key_frames(5));
    let (options, q, mut bytes) = (RenderOptions::INRIA, Quantisation::default(), Vec::new());
    (write(&splats, &options, &key_frames, &q, &mut bytes).unwrap(), bytes)
}

/// The same with coder tables, too.
fn sample_with_tables(count: usize) -> (PriorId, Vec<u8>) {
    let (_, bytes) = sample_with_key_frames(count);
    let bytes = with_coder_tables(&bytes, Some(&sample_tables(1))).unwrap();
    let prior = Prior::from_bytes(&bytes, "p.nvsg", &RenderOverrides::default()).unwrap();
    (prior.id(), bytes)
}

/// The content with a check that fits.
fn checked(content: &[u8]) -> Vec<u8> {
    [content, &crc32fast::hash(content).to_le_bytes()].concat()
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
    let options = RenderOptions { antialiased: true, background, ..RenderOptions::INRIA };
    for degree in 0..=3 {
        for count in [1, 2, 50] {
            let splats = sample_splats(count, degree);
            let (id, bytes) = written(&splats, &options, &Quantisation::default());
            let prior = Prior::from_bytes(&bytes, "p.nvsg", &RenderOverrides::default()).unwrap();
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
        write(&splats, &RenderOptions::INRIA, &KeyFrames::NONE, q, Vec::new()).unwrap_err()
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

/// Files of the version before key frames, and what they hold.
#[test]
fn files_without_key_frames_are_as_they_ever_were() {
    #[rustfmt::skip]
    let first = [
        110, 118, 115, 103, 1, 0, 0, 0, 1, 0, 0, 0, 30, 17, 250, 37, 10, 215, 35, 60, 164, 112, 125, 63,
        0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 128, 61, 0, 0, 0, 62, 0, 0, 64, 62, 244, 255, 255, 255,
        0, 0, 128, 57, 143, 194, 117, 61, 66, 96, 229, 59, 10, 215, 163, 61, 10, 215, 35, 61, 205, 204,
        76, 61, 0, 0, 108, 65, 77, 241, 22, 60, 216, 57, 124, 21, 64, 233, 123, 69, 18, 24, 27, 103, 10,
        223, 21, 234, 93, 120, 179, 92,
    ];
    assert!(read(&first).unwrap().key_frames.is_empty());
    for (degree, count, size, id, hash) in [
        (
            0,
            1,
            104,
            0x25fa_111e,
            "fb7ae52f9b5a6fd75f36df8dc0a24ac2b2a9d9679f98f9612b96b72b4e181d85",
        ),
        (
            1,
            7,
            226,
            0xfc7a_8116,
            "c6d4d55aafa2d1a31048350175c827f1cf11e4732f4c39afdcfda127ccaebff9",
        ),
        (
            3,
            300,
            1910,
            0x8ea5_bb9d,
            "329861d415afa1e04aedc941e3759878772d92878bb6c18028f728b766266ee9",
        ),
    ] {
        let splats = sample_splats(count, degree);
        let written = written(&splats, &RenderOptions::GSPLAT, &Quantisation::default());
        assert_eq!((written.0, written.1.len()), (PriorId(id), size));
        assert_eq!(blake3::hash(&written.1).to_hex().as_str(), hash, "{degree}, {count}");
        assert!(count > 1 || written.1 == first);
    }
}

#[test]
fn key_frames_travel_with_the_splats_and_change_nothing_of_them() {
    let (id, without) = sample(7);
    let (same, with) = sample_with_key_frames(7);
    assert_eq!((same, with.len()), (id, without.len() + 28 + 10 * 5));
    assert_eq!(read(&with).unwrap().splats, read(&without).unwrap().splats);
    let prior = Prior::from_bytes(&with, "p.nvsg", &RenderOverrides::default()).unwrap();
    assert_eq!((prior.id(), prior.key_frames().len()), (id, 5));
    // Put in, replaced and taken out of a file.
    assert_eq!(with_key_frames(&without, &sample_key_frames(5)).unwrap(), with);
    assert_eq!(with_key_frames(&with, prior.key_frames()).unwrap(), with);
    assert_eq!(with_key_frames(&with, &KeyFrames::NONE).unwrap(), without);
    assert!(matches!(
        with_key_frames(&with[1..], &KeyFrames::NONE),
        Err(PriorError::UnknownFormat)
    ));
}

#[test]
fn coder_tables_travel_with_the_splats_and_name_another_prior() {
    let (id, without) = sample_with_key_frames(7);
    let tables = sample_tables(1);
    let with = with_coder_tables(&without, Some(&tables)).unwrap();
    assert_eq!(with.len(), without.len() + 4 + Tables::encoded_len());
    let open = |bytes: &[u8]| Prior::from_bytes(bytes, "p", &RenderOverrides::default()).unwrap();
    let (plain, prior) = (open(&without), open(&with));
    assert_eq!((prior.splats(), prior.key_frames()), (plain.splats(), plain.key_frames()));
    assert_eq!(prior.coder_tables().map(|t| &**t), Some(&tables));
    assert_eq!(prior.report().coder_tables, PartSource::InFile);
    assert!(plain.coder_tables().is_none() && plain.id() == id && prior.id() != id);
    assert_eq!(plain.clone().with_coder_tables(Some(tables.clone())).id(), prior.id());
    // They can be replaced and removed, and a change of the key frames leaves them alone.
    let other = with_coder_tables(&with, Some(&sample_tables(2))).unwrap();
    assert!(open(&other).id() != id && open(&other).id() != prior.id());
    assert_eq!(with_coder_tables(&other, Some(&tables)).unwrap(), with);
    assert_eq!(with_coder_tables(&with, None).unwrap(), without);
    let bare = with_key_frames(&with, &KeyFrames::NONE).unwrap();
    assert_eq!((open(&bare).id(), bare.len()), (prior.id(), with.len() - 28 - 10 * 5));
    assert_eq!(with_key_frames(&bare, prior.key_frames()).unwrap(), with);
    assert!(matches!(with_coder_tables(&with[1..], None), Err(PriorError::UnknownFormat)));
    assert!(matches!(with_coder_tables(&with[..90], None), Err(PriorError::Damaged { .. })));
}

#[test]
fn coder_tables_that_are_none_are_named_by_their_place() {
    let (_, bytes) = sample_with_tables(4);
    let at = Header::BYTES + 28 + 10 * 5;
    let error = |change: &dyn Fn(&mut [u8])| {
        let mut content = bytes[..bytes.len() - CHECK].to_vec();
        change(&mut content[at..]);
        read(&checked(&content)).unwrap_err()
    };
    let magic = error(&|b| b[4] = b'n');
    assert!(matches!(magic, PriorError::Field { offset, .. } if offset == at as u64 + 4));
    assert!(matches!(error(&|b| b[..4].fill(255)), PriorError::Truncated { .. }));
    // A weight more or less is another prior.
    assert!(matches!(error(&|b| b[100] ^= 1), PriorError::Identity { .. }));
}

#[test]
fn unknown_flags_are_refused() {
    let mut content = sample(4).1[..70].to_vec();
    content[7] = 8;
    content.resize(200, 0);
    let error = read(&checked(&content)).unwrap_err();
    assert!(matches!(error, PriorError::Field { offset: 6, .. }), "{error}");
}

#[test]
fn every_flipped_bit_and_every_cut_is_noticed() {
    every_damage_is_noticed(&sample(4).1);
    every_damage_is_noticed(&sample_with_key_frames(4).1);
    let preprocessing = Preprocessing { clahe: Some(Clahe::default()), ..Preprocessing::NONE };
    every_damage_is_noticed(&with_preprocessing(&sample(4).1, &preprocessing).unwrap());
}

#[test]
fn every_damage_to_the_coder_tables_is_noticed() {
    every_damage_is_noticed(&sample_with_tables(4).1);
}

fn every_damage_is_noticed(bytes: &[u8]) {
    for bit in 0..bytes.len() * 8 {
        let mut damaged = bytes.to_vec();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(read(&damaged).is_err(), "bit {bit}");
    }
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length]).is_err(), "{length} bytes");
    }
    assert!(matches!(read(&[bytes, &[0]].concat()), Err(PriorError::Damaged { .. })));
}

#[test]
fn another_prior_under_the_same_name_is_noticed() {
    let (id, bytes) = sample(4);
    let mut content = bytes[..bytes.len() - CHECK].to_vec();
    content[20] ^= 1; // The clamp of alpha, in its last bit.
    let error = read(&checked(&content)).unwrap_err();
    assert!(matches!(error, PriorError::Identity { stated, .. } if stated == id), "{error}");
}

#[test]
fn forged_counts_are_refused() {
    let (_, bytes) = sample_with_key_frames(4);
    // A wrong count of key frames: the rest of the file is too short for them, or makes no splats.
    for count in [0, 4, 6, 65_536, u32::MAX] {
        let mut content = bytes[..bytes.len() - CHECK].to_vec();
        content[76..80].copy_from_slice(&u32::to_le_bytes(count));
        assert!(read(&checked(&content)).is_err(), "{count}");
    }
    for count in [u32::MAX, 1 << 20, 1000] {
        let mut content = bytes[..bytes.len() - CHECK].to_vec();
        content[8..12].copy_from_slice(&count.to_le_bytes());
        let error = read(&checked(&content)).unwrap_err();
        assert!(matches!(error, PriorError::Truncated { .. }), "{error}");
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
    fn arbitrary_content_is_an_error(
        header in proptest::collection::vec(any::<u8>(), Header::BYTES),
        stream in proptest::collection::vec(any::<u8>(), 0..300),
        forged in any::<bool>(),
        parts in 0..3,
    ) {
        let sample = match parts {
            0 => sample(20).1,
            1 => sample_with_key_frames(20).1,
            _ => sample_with_tables(20).1,
        };
        let header = if forged { sample[..Header::BYTES].to_vec() } else { header };
        let mut content = [&header[..], &stream[..]].concat();
        content[..4].copy_from_slice(MAGIC);
        prop_assert!(read(&checked(&content)).is_err());
    }

    #[test]
    fn any_position_has_its_rank(code in proptest::array::uniform3(-(1_i32 << 29)..1 << 29)) {
        prop_assert_eq!(stream::unrank(stream::rank(code)), code);
    }
}
