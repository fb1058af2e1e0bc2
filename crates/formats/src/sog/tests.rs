use std::io::{Cursor, Write};

use image_webp::{ColorType, WebPEncoder};
use proptest::prelude::*;
use serde_json::{Value, json};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::*;
use nvsprior::RenderOverrides;

/// A lossless picture, two pixels high.
fn webp(pixels: &[[u8; 4]]) -> Vec<u8> {
    picture(pixels.as_flattened(), pixels.len() as u32 / 2, 2, ColorType::Rgba8)
}

fn picture(data: &[u8], width: u32, height: u32, colour: ColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    WebPEncoder::new(&mut bytes).encode(data, width, height, colour).unwrap();
    bytes
}

/// An archive of `meta.json` and the pictures.
fn archive(meta: &Value, pictures: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let deflated = stored.compression_method(CompressionMethod::Deflated);
    zip.start_file("meta.json", deflated).unwrap();
    zip.write_all(meta.to_string().as_bytes()).unwrap();
    for (name, content) in pictures {
        zip.start_file(*name, stored).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// Three splats of degree 1; the fourth pixel belongs to none.
fn plain() -> (Value, Vec<(&'static str, Vec<u8>)>) {
    let table = |scale: f64| (0..256).map(|i| scale * f64::from(i - 128)).collect::<Vec<_>>();
    let meta = json!({
        "version": 2, "asset": {"generator": "a test"}, "count": 3, "antialias": true,
        "means": {"mins": [-1.0, 0.0, 0.0], "maxs": [1.0, 2.0, 0.0], "files": ["l", "u"]},
        "scales": {"codebook": table(0.0625), "files": ["s"]},
        "quats": {"files": ["q"]},
        "sh0": {"codebook": table(0.01), "files": ["c"]},
        "shN": {"count": 2, "bands": 1, "codebook": table(0.125), "files": ["p", "i"]},
    });
    let palette: Vec<u8> = (0..64 * 3).flat_map(|i| [i as u8, 128, 129]).collect();
    let pictures = vec![
        ("l", webp(&[[255, 0, 0, 255], [0, 0, 0, 255], [255, 255, 255, 255], [0; 4]])),
        ("u", webp(&[[255, 0, 0, 255], [0, 128, 0, 255], [127, 255, 0, 255], [0; 4]])),
        ("s", webp(&[[128, 0, 255, 255], [1, 2, 3, 255], [4, 5, 6, 255], [0; 4]])),
        ("q", webp(&[[255, 0, 128, 252], [128, 128, 128, 253], [0, 255, 128, 255], [0; 4]])),
        ("c", webp(&[[0, 128, 255, 51], [128, 128, 128, 255], [1, 2, 3, 0], [0; 4]])),
        ("p", picture(&palette, 64 * 3, 1, ColorType::Rgb8)),
        ("i", webp(&[[1, 0, 0, 255], [0, 0, 0, 255], [1, 0, 0, 255], [9; 4]])),
    ];
    (meta, pictures)
}

fn near(a: &[f32], b: &[f32]) {
    assert_eq!(a.len(), b.len());
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?} {b:?}");
}

#[test]
fn values_are_those_of_the_format() {
    let (meta, pictures) = plain();
    let file = read(&archive(&meta, &pictures)).unwrap();
    assert_eq!(file.format, FORMAT);
    assert_eq!(file.options, RenderOptions { antialiased: true, ..RenderOptions::INRIA });
    let s = &file.splats;
    assert_eq!((s.len(), s.sh_degree, s.check_shape().is_ok()), (3, 1, true));
    let e = std::f32::consts::E;
    near(&s.positions[0], &[e - 1.0, 0.0, 0.0]);
    let middle = (2.0 * 32_768.0 / 65_535.0_f64).exp_m1() as f32;
    near(&s.positions[1], &[1.0 - e, middle, 0.0]);
    assert_eq!(s.log_scales[0], [0.0, -8.0, 127.0 * 0.0625]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    near(&s.rotations[0], &[0.0, half, -half, half / 255.0]);
    let small = half / 255.0;
    near(&s.rotations[1], &[small, (1.0 - 3.0 * small * small).sqrt(), small, small]);
    near(&s.rotations[2], &[-half, half, small, 0.0]);
    assert!((s.opacity_logits[0] + 4_f32.ln()).abs() < 1e-6);
    assert_eq!(s.opacity_logits[1..], [f32::INFINITY, f32::NEG_INFINITY]);
    near(&s.sh[..3], &[-1.28, 0.0, 1.27]);
    // Entry 1 of the palette: its coefficients are pixels 3, 4 and 5.
    near(&s.sh[3..12], &[-15.625, 0.0, 0.125, -15.5, 0.0, 0.125, -15.375, 0.0, 0.125]);
    near(&s.sh[15..18], &[-16.0, 0.0, 0.125]);
}

#[test]
fn without_spherical_harmonics_the_degree_is_zero() {
    let (mut meta, pictures) = plain();
    meta.as_object_mut().unwrap().remove("shN");
    let s = read(&archive(&meta, &pictures)).unwrap().splats;
    assert_eq!((s.sh_degree, s.sh.len()), (0, 9));
}

#[test]
fn wrong_files_are_refused_by_name() {
    let reason = |meta: &Value, pictures: &[(&str, Vec<u8>)]| {
        read(&archive(meta, pictures)).unwrap_err().to_string()
    };
    for (at, value, expected) in [
        ("/version", json!(3), "version 3"),
        ("/count", json!(0), "no splats"),
        ("/count", json!(5), "l: 2×2 pixels"),
        ("/count", json!(1 << 30), "splats in"),
        ("/means/files", json!(["l"]), "meta.json: "),
        ("/scales/codebook", json!([1.0]), "a codebook of 1 values"),
        ("/quats/files", json!(["../../etc/passwd"]), "../../etc/passwd: "),
        ("/shN/bands", json!(4), "degree 4"),
        ("/shN/count", json!(1), "splat 0 has entry 1 of 1"),
        ("/shN/count", json!(65), "p: 192×1 pixels"),
    ] {
        let (mut meta, pictures) = plain();
        *meta.pointer_mut(at).unwrap() = value;
        let found = reason(&meta, &pictures);
        assert!(found.contains(expected), "{at}: {found}");
    }
    let (mut meta, mut pictures) = plain();
    meta.as_object_mut().unwrap().remove("version");
    assert!(reason(&meta, &pictures).contains("version 1"));
    let (meta, _) = plain();
    pictures[3].1 = webp(&[[0, 0, 0, 252], [0, 0, 0, 7], [0; 4], [0; 4]]);
    assert!(reason(&meta, &pictures).contains("q: splat 1 has the mode 7"));
    pictures[3].1 = b"RIFF".to_vec();
    assert!(reason(&meta, &pictures).contains("q: "));
    pictures.truncate(3);
    assert!(reason(&meta, &pictures).contains("q: "));
}

proptest! {
    #[test]
    fn damaged_archives_are_errors_or_valid(at in 0_usize..9000, byte: u8, end in 0_usize..9000) {
        let (meta, pictures) = plain();
        let mut file = archive(&meta, &pictures);
        let (at, end) = (at % file.len(), end % file.len());
        prop_assert!(read(&file[..end]).is_err());
        file[at] = byte;
        let _ = crate::from_bytes(&file, "x", &RenderOverrides::default());
    }
}

#[test]
fn the_model_counts_and_unknown_fields_are_told() {
    let file = |model: Option<&str>| {
        let (mut meta, pictures) = plain();
        meta.as_object_mut().unwrap().remove("antialias");
        if let Some(model) = model {
            meta["model"] = json!(model);
        }
        let file = read(&archive(&meta, &pictures)).unwrap();
        (file.options.antialiased, file.warnings.len())
    };
    assert_eq!(file(None), (false, 0));
    assert_eq!(file(Some("antialiased")), (true, 0));
    assert_eq!(file(Some("2dgs")), (false, 0), "its scales tell");
    assert_eq!(file(Some("other")), (false, 1));
    let (mut meta, pictures) = plain();
    meta["blur"] = json!(1);
    let told = read(&archive(&meta, &pictures)).unwrap().warnings[0].to_string();
    assert!(told.contains("SOG field \"blur\""), "{told}");
}
