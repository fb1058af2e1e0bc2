use proptest::prelude::*;

use super::*;
use nvsprior::RenderOverrides;

fn packed(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    read(bytes).unwrap_or_else(|| ply::read_ply(bytes))
}

/// A file of two splats in a chunk, with or without bounds of colours and spherical harmonics.
fn file(coloured: bool, sh: bool) -> Vec<u8> {
    let list = |kind: &str, names: &[&str]| -> String {
        names.iter().map(|n| format!("property {kind} {n}\n")).collect()
    };
    let bounds = &BOUNDS[..if coloured { 18 } else { 12 }];
    let rest: Vec<String> = (0..9).map(|i| format!("f_rest_{i}")).collect();
    let rest: Vec<&str> = rest.iter().map(String::as_str).collect();
    let (chunk, vertex) = (list("float", bounds), list("uint", &PACKED));
    let rest = if sh { format!("element sh 2\n{}", list("uchar", &rest)) } else { String::new() };
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\n{chunk}element vertex 2\n\
         {vertex}{rest}end_header\n"
    );
    #[rustfmt::skip]
    let values: [f32; 18] = [
        -1.0, 0.0, 5.0, 1.0, 2.0, 5.0, -8.0, -7.0, -6.0, -4.0, -3.0, -2.0,
        0.5, 0.5, 0.5, 1.5, 2.5, 3.5,
    ];
    let mut bytes = header.into_bytes();
    bytes.extend(values[..bounds.len()].iter().flat_map(|v| v.to_le_bytes()));
    let first = [0xffe0_0000, 3 << 30 | 1023 << 20 | 1023, 0x0000_07ff, 0xff00_ff80];
    let second = [0, 512 << 20 | 512 << 10 | 511, 0xffff_ffff, 0x0000_00ff_u32];
    bytes.extend([first, second].as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    if sh {
        bytes.extend([0, 127, 128, 1, 2, 3, 253, 254, 255, 9, 8, 7, 6, 5, 4, 3, 2, 1]);
    }
    bytes
}

#[test]
fn values_are_those_of_the_format() {
    for coloured in [false, true] {
        let scene = packed(&file(coloured, true)).unwrap();
        assert_eq!(scene.format, FORMAT);
        let s = &scene.splats;
        assert_eq!(s.positions, [[1.0, 0.0, 5.0], [-1.0, 0.0, 5.0]]);
        assert_eq!(s.log_scales, [[-8.0, -7.0, -2.0], [-4.0, -3.0, -2.0]]);
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let expected = [half, -half, half, 0.0];
        assert!(s.rotations[0].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6));
        assert!(s.rotations[1][0] > 0.999, "{:?}", s.rotations);
        assert!((s.opacity_logits[0] - (128.0_f32 / 127.0).ln()).abs() < 1e-6);
        assert_eq!(s.opacity_logits[1], f32::INFINITY);
        let rgb = if coloured { [1.5, 0.5, 3.5] } else { [1.0, 0.0, 1.0] };
        assert_eq!(s.sh[..3], rgb.map(|v: f64| ((v - 0.5) / SH_C0) as f32));
        // Red, green and blue of the first coefficient, then of the second.
        let value = |byte: f32| (byte - 127.5) / 32.0;
        let expected = [-4.0, value(1.0), value(253.0), value(127.0), value(2.0), value(254.0)];
        assert_eq!(s.sh[3..9], expected);
        assert_eq!(s.sh[11], 4.0);
    }
    assert_eq!(packed(&file(true, false)).unwrap().splats.sh_degree, 0);
}

#[test]
fn what_is_missing_or_too_short_is_named() {
    let whole = file(true, true);
    let refused = |from: &str, to: &str| {
        let at = whole.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        packed(&[&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat()).unwrap_err()
    };
    let missing = |error, name| match error {
        PriorError::MissingProperty { property } => property == name,
        _ => false,
    };
    assert!(missing(refused("float max_scale_x", "float max_scale_w"), "max_scale_x"));
    assert!(missing(refused("uint packed_scale", "int packed_scale"), "packed_scale"));
    let error = refused("element vertex 2", "element vertex 999999999999");
    assert!(matches!(error, PriorError::Truncated { .. }), "{error}");
    for (from, to) in [
        ("element chunk 1", "element chunk 0"),
        ("element sh 2", "element sh 1"),
        ("binary_little", "binary_big"),
    ] {
        let error = refused(from, to);
        assert!(matches!(error, PriorError::Header { .. }), "{error}");
    }
    for length in 0..whole.len() {
        assert!(packed(&whole[..length]).is_err(), "{length} bytes");
    }
}

proptest! {
    #[test]
    fn damaged_files_never_panic(
        coloured in any::<bool>(),
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = file(coloured, true);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let _ = crate::from_bytes(&bytes, "damaged", &RenderOverrides::default());
    }
}
