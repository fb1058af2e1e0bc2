use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;

use super::*;
use nvsprior::RenderOverrides;

/// Two splats of degree 1 as version 2 or 3 has them, before gzip.
fn plain(version: u32) -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend([1, 12, 1, 0]);
    for value in [4096_i32, -8192, 1, -1, 0, 0x7f_ffff] {
        bytes.extend(&value.to_le_bytes()[..3]);
    }
    bytes.extend([255, 51]);
    bytes.extend([0, 128, 255, 10, 20, 30]);
    bytes.extend([160, 0, 255, 96, 97, 98]);
    if version == 2 {
        bytes.extend([255, 128, 128, 0, 128, 128]);
    } else {
        bytes.extend((3_u32 << 30 | 100 << 20 | (512 | 200) << 10 | 300).to_le_bytes());
        bytes.extend((1_u32 << 30).to_le_bytes());
    }
    bytes.extend([192, 128, 64, 0, 0, 0, 255, 128, 1]);
    bytes.extend([128; 9]);
    bytes
}

fn zipped(plain: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(plain).unwrap();
    encoder.finish().unwrap()
}

/// The streams of version 3 as version 4 has them, in frames of a raw block each.
fn framed(plain: &[u8]) -> Vec<u8> {
    let mut bytes = plain[..15].to_vec();
    bytes[4] = 4;
    bytes.push(6);
    bytes.extend(32_u32.to_le_bytes());
    bytes.extend([0; 12]);
    let (mut frames, mut at) = (Vec::new(), HEADER);
    for size in [18, 2, 6, 6, 8, 18] {
        // Magic, a single segment whose size takes one byte, the head of the last block.
        let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x20, size as u8];
        frame.extend(&((size as u32) << 3 | 1).to_le_bytes()[..3]);
        frame.extend(&plain[at..at + size]);
        at += size;
        bytes.extend((frame.len() as u64).to_le_bytes());
        bytes.extend((size as u64).to_le_bytes());
        frames.extend(frame);
    }
    [bytes, frames].concat()
}

#[test]
fn values_are_those_of_the_format_turned_to_y_down() {
    for (file, version) in [(zipped(&plain(2)), 2), (zipped(&plain(3)), 3), (framed(&plain(3)), 4)]
    {
        let scene = read(&file).unwrap();
        assert_eq!(scene.format, PriorFormat::Foreign("SPZ", Some(version)));
        assert_eq!(scene.options, RenderOptions { antialiased: true, ..RenderOptions::INRIA });
        let s = &scene.splats;
        assert_eq!(s.positions[0], [1.0, 2.0, -1.0 / 4096.0]);
        assert_eq!(s.positions[1][0], -1.0 / 4096.0);
        assert_eq!(s.log_scales, [[0.0, -10.0, 5.9375], [-4.0, -3.9375, -3.875]]);
        assert_eq!(s.opacity_logits[0], f32::INFINITY);
        assert!((s.opacity_logits[1] + 4_f32.ln()).abs() < 1e-6);
        assert!((s.sh[0] + 0.5 / 0.15).abs() < 1e-6);
        let last = 127.0 / 128.0;
        assert_eq!(s.sh[3..12], [-0.5, 0.0, 0.5, 1.0, 1.0, 1.0, last, 0.0, -last]);
        let q = s.rotations[0];
        if version == 2 {
            assert!((q[1] - 1.0).abs() < 1e-6, "{q:?}");
        } else {
            let part = |v: f32| v / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
            let expected = [part(100.0), part(200.0), -part(300.0)];
            assert!(q[1..].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{q:?}");
            assert!((q.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-6);
            assert_eq!(s.rotations[1].map(f32::abs), [0.0, 0.0, 1.0, 0.0]);
        }
    }
}

#[test]
fn headers_that_lie_are_refused() {
    let refused = |change: fn(&mut Vec<u8>)| {
        let mut bytes = plain(3);
        change(&mut bytes);
        read(&zipped(&bytes)).unwrap_err()
    };
    assert!(matches!(refused(|b| b[8..12].fill(0xff)), PriorError::Truncated { .. }));
    assert!(matches!(refused(|b| b[8..12].fill(0)), PriorError::Empty));
    assert!(matches!(refused(|b| b[12] = 4), PriorError::ShDegree { degree: 4 }));
    assert!(matches!(refused(|b| b[4] = 1), PriorError::Field { offset: 4, .. }));
    assert!(matches!(refused(|b| b[13] = 25), PriorError::Field { offset: 13, .. }));
    assert!(matches!(refused(|b| b[0] = 0), PriorError::UnknownFormat));
    assert!(matches!(refused(|b| b.truncate(60)), PriorError::Field { .. }));
}

#[test]
fn cut_files_are_refused() {
    for file in [zipped(&plain(2)), framed(&plain(3))] {
        for length in 0..file.len() {
            assert!(read(&file[..length]).is_err(), "{length} bytes");
        }
    }
}

proptest! {
    #[test]
    fn damaged_files_never_panic(
        version in 2..=4_u32,
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..6),
        inside in any::<bool>(),
    ) {
        let damage = |bytes: &mut Vec<u8>| {
            for (at, value) in &changes {
                let at = at.index(bytes.len());
                bytes[at] = *value;
            }
        };
        let mut bytes = plain(version.min(3));
        if inside {
            damage(&mut bytes);
        }
        let mut file = if version == 4 { framed(&bytes) } else { zipped(&bytes) };
        if !inside {
            damage(&mut file);
        }
        let _ = crate::from_bytes(&file, "damaged", &RenderOverrides::default());
    }

    #[test]
    fn arbitrary_bytes_never_panic(
        magic in 0..2_usize,
        rest in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        let _ = read(&[MAGICS[magic], &rest[..]].concat());
    }
}

/// The plain file of version 3 with extensions: their types and contents.
fn extended(records: &[(u32, &[u8])]) -> Vec<u8> {
    let mut bytes = plain(3);
    bytes[14] |= EXTENSIONS;
    for (kind, content) in records {
        bytes.extend(kind.to_le_bytes());
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(*content);
    }
    bytes
}

#[test]
fn stated_axes_count() {
    let usual = read(&zipped(&plain(3))).unwrap().splats;
    let stated = |code: u32| read(&zipped(&extended(&[(COORDINATES, &code.to_le_bytes())])));
    for code in [0, 4] {
        assert_eq!(stated(code).unwrap().splats, usual, "right, up, backwards");
    }
    // Right, down, forwards: nothing is turned.
    let plain = stated(6).unwrap().splats;
    assert_eq!(plain.positions[0], [1.0, -2.0, 1.0 / 4096.0], "as in the file");
    assert_eq!(plain.log_scales, usual.log_scales);
    for (a, b) in plain.rotations.iter().zip(&usual.rotations) {
        assert_eq!(*a, [b[0], b[1], -b[2], -b[3]]);
    }
    // Of degree 1 they are y, z and x.
    let turned = |sh: &[f32]| {
        [-1.0, -1.0, 1.0]
            .into_iter()
            .zip(sh.as_chunks::<3>().0)
            .flat_map(|(sign, rgb)| rgb.map(|v| sign * v))
            .collect::<Vec<_>>()
    };
    assert_eq!(plain.sh[3..12], turned(&usual.sh[3..12]));
    let refused = stated(16).unwrap_err().to_string();
    assert!(refused.contains("save it as RUB"), "{refused}");
}

#[test]
fn extensions_that_no_list_names_are_told() {
    let file = read(&zipped(&extended(&[(0xadbe_0002, &[0; 12]), (0x1234_0001, &[7])]))).unwrap();
    let told: Vec<String> = file.warnings.iter().map(ToString::to_string).collect();
    assert!(told.len() == 1 && told[0].contains("12340001"), "{told:?}");
    let mut cut = extended(&[(COORDINATES, &[4, 0, 0, 0])]);
    cut.pop();
    assert!(read(&zipped(&cut)).is_err());
}
