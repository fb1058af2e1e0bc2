use glam::DVec3;
use proptest::prelude::*;

use super::*;
use nvsprior::geometry::{Distortion, Intrinsics};

/// A model's files' contents: cameras, images, points3D.
type Files = [Vec<u8>; 3];

const CAMERAS: [(u32, i32, &str, &[f64]); 7] = [
    (1, 0, "SIMPLE_PINHOLE", &[600.0, 320.0, 240.5]),
    (2, 1, "PINHOLE", &[600.0, 610.0, 320.0, 240.0]),
    (3, 2, "SIMPLE_RADIAL", &[600.0, 320.0, 240.0, 0.125]),
    (7, 3, "RADIAL", &[600.0, 320.0, 240.0, 0.125, -0.0625]),
    (8, 4, "OPENCV", &[600.0, 610.0, 320.0, 240.0, 0.125, -0.0625, 0.001, -0.002]),
    (9, 5, "OPENCV_FISHEYE", &[600.0, 610.0, 320.0, 240.0, 0.02, -0.01, 0.003, -0.004]),
    (
        10,
        6,
        "FULL_OPENCV",
        &[600.0, 610.0, 320.0, 240.0, 0.125, -0.0625, 0.001, -0.002, 0.01, 0.02, 0.03, 0.04],
    ),
];

/// Number, quaternion, translation, camera, name, number of observations.
type Image = (u32, [f64; 4], [f64; 3], u32, &'static str, usize);

const IMAGES: [Image; 3] = [
    (5, [0.5, 0.5, -0.5, 0.5], [1.0, -2.5, 3.0], 8, "b/two words.jpg", 2),
    (2, [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1e-3], 1, "a.png", 0),
    (9, [0.8, 0.0, 0.6, 0.0], [0.0, 7.0, 0.0], 9, "c.png", 1),
];

/// Number, position, colour, error, length of the track.
type Cloud = (u64, [f64; 3], [u8; 3], f64, usize);

const POINTS: [Cloud; 2] =
    [(11, [1.0, 2.0, 3.5], [0, 51, 255], 0.75, 3), (12, [-1.0, 0.0, 9.0], [1, 2, 3], -1.0, 2)];

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn binary_files() -> Files {
    let mut files = [CAMERAS.len(), IMAGES.len(), POINTS.len()].map(|n| n.to_le_bytes().to_vec());
    for (id, model, _, parameters) in CAMERAS {
        files[0].extend([id.to_le_bytes(), model.to_le_bytes()].concat());
        files[0].extend([640u64.to_le_bytes(), 480u64.to_le_bytes()].concat());
        files[0].extend(floats(parameters));
    }
    for (id, q, t, camera, name, observations) in IMAGES {
        files[1].extend(id.to_le_bytes());
        files[1].extend([floats(&q), floats(&t)].concat());
        files[1].extend(camera.to_le_bytes());
        files[1].extend([name.as_bytes(), &[0], &observations.to_le_bytes()].concat());
        files[1].extend(vec![7; 24 * observations]);
    }
    for (id, position, rgb, error, track) in POINTS {
        files[2].extend(id.to_le_bytes());
        files[2].extend([floats(&position), rgb.to_vec(), floats(&[error])].concat());
        files[2].extend(track.to_le_bytes());
        files[2].extend(vec![7; 8 * track]);
    }
    files
}

fn text_files() -> Files {
    let words = |values: &[f64]| values.iter().map(|v| format!(" {v}")).collect::<String>();
    let mut files = ["# CAMERA_ID\n", "# IMAGE_ID\n#\n", "\n# POINT3D_ID\n"].map(str::to_owned);
    for (id, _, model, parameters) in CAMERAS {
        files[0] += &format!("{id} {model} 640 480{}\n", words(parameters));
    }
    for (id, q, t, camera, name, observations) in IMAGES {
        let observations = "1.5 2.5 -1 ".repeat(observations);
        files[1] += &format!("{id}{}{} {camera} {name}\n{observations}\n", words(&q), words(&t));
    }
    for (id, position, [r, g, b], error, track) in POINTS {
        let track = " 5 17".repeat(track);
        files[2] += &format!("{id}{} {r} {g} {b} {error}{track}\r\n", words(&position));
    }
    files.map(String::into_bytes)
}

fn open(files: &Files, ending: &str) -> Result<ColmapModel, ColmapError> {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in ["cameras", "images", "points3D"].iter().zip(files) {
        std::fs::write(folder.path().join(name).with_extension(ending), content).unwrap();
    }
    ColmapModel::open(folder.path())
}

/// One file's content, parsed without a file system.
fn parse(which: usize, bytes: &[u8], text: bool) -> Result<(), Wrong> {
    let all = |_: u32| lenses(&binary::cameras(&binary_files()[0])?);
    match (which, text) {
        (0, false) => binary::cameras(bytes).and_then(|cameras| lenses(&cameras)).map(drop),
        (0, true) => text::cameras(bytes).and_then(|cameras| lenses(&cameras)).map(drop),
        (1, false) => binary::images(bytes).and_then(|i| views(i, &all(0)?)).map(drop),
        (1, true) => text::images(bytes).and_then(|i| views(i, &all(0)?)).map(drop),
        (_, false) => binary::points(bytes).map(drop),
        (_, true) => text::points(bytes).map(drop),
    }
}

#[test]
fn both_forms_give_the_model_that_was_written() {
    let model = open(&binary_files(), "bin").unwrap();
    assert_eq!(model, open(&text_files(), "txt").unwrap());
    let names: Vec<&str> = model.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["a.png", "b/two words.jpg", "c.png"]);
    let view = &model.views[1];
    assert_eq!(view.pose.wxyz(), [0.5, 0.5, -0.5, 0.5]);
    assert_eq!(view.pose.translation, DVec3::new(1.0, -2.5, 3.0));
    let brown = [0.125, -0.0625, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(view.lens.distortion(), &Distortion::Brown(brown));
    let intrinsics =
        Intrinsics { width: 640, height: 480, fx: 600.0, fy: 610.0, cx: 320.0, cy: 240.0 };
    assert_eq!(view.lens.intrinsics(), &intrinsics);
    let fisheye = Distortion::Fisheye([0.02, -0.01, 0.003, -0.004]);
    assert_eq!(model.views[2].lens.distortion(), &fisheye);
    let point = model.points[0];
    assert_eq!((point.position, point.rgb), (DVec3::new(1.0, 2.0, 3.5), Some([0.0, 0.2, 1.0])));
    assert_eq!((point.error, point.track), (Some(0.75), Some(3)));
    assert_eq!(model.points[1].error, None);
}

#[test]
fn simple_models_have_one_focal_length_and_radial_terms() {
    let cameras = binary::cameras(&binary_files()[0]).ok().unwrap();
    let lenses = lenses(&cameras).ok().unwrap();
    let mut k = [0.0; 8];
    assert_eq!(lenses[&1].distortion(), &Distortion::None);
    assert_eq!((lenses[&1].intrinsics().fy, lenses[&1].intrinsics().cy), (600.0, 240.5));
    assert_eq!(lenses[&2].intrinsics().fy, 610.0);
    let full = [0.125, -0.0625, 0.001, -0.002, 0.01, 0.02, 0.03, 0.04];
    assert_eq!(lenses[&10].distortion(), &Distortion::Brown(full));
    k[0] = 0.125;
    assert_eq!(lenses[&3].distortion(), &Distortion::Brown(k));
    k[1] = -0.0625;
    assert_eq!(lenses[&7].distortion(), &Distortion::Brown(k));
}

#[test]
fn pictures_without_observations_are_all_read() {
    let names = |text: &str| {
        let read = text::images(text.as_bytes())
            .and_then(|images| views(images, &lenses(&binary::cameras(&binary_files()[0])?)?));
        let read = read.map_err(|wrong| wrong.of(Path::new("images.txt")).to_string());
        read.map(|views| views.into_iter().map(|view| view.name).collect::<Vec<_>>())
    };
    let pose = "1 0 0 0 0 0 0 1";
    for (lines, found) in [
        (
            format!("1 {pose} a.png\n2 {pose} b.png\n3 {pose} c.png\n"),
            vec!["a.png", "b.png", "c.png"],
        ),
        // Twelve words, a multiple of three.
        (
            format!("1 {pose} dive one 1.png\n2 {pose} dive one 2.png"),
            vec!["dive one 1.png", "dive one 2.png"],
        ),
        (
            format!(
                "\u{feff}# a comment\r\n1 {pose} cam\\a.png\r\n\r\n2 {pose} b.png\r\n1 2 3\r\n"
            ),
            vec!["b.png", "cam/a.png"],
        ),
        (format!("1 {pose} a.png\n# between\n2 {pose} b.png\n\n"), vec!["a.png", "b.png"]),
    ] {
        assert_eq!(names(&lines).unwrap(), found, "{lines}");
    }
    let broken = names(&format!("1 {pose} a.png\n2 1 0 0 b.png\n")).unwrap_err();
    assert!(broken.contains("images.txt: line 2: 5 words"), "{broken}");
}

#[test]
fn errors_name_file_and_place() {
    let binary = |which: usize, at: usize, value: &[u8]| {
        let mut files = binary_files();
        files[which][at..at + value.len()].copy_from_slice(value);
        open(&files, "bin").unwrap_err().to_string()
    };
    let text = |which: usize, old: &str, new: &str| {
        let mut files = text_files();
        let file = String::from_utf8(files[which].clone()).unwrap();
        assert!(file.contains(old));
        files[which] = file.replacen(old, new, 1).into_bytes();
        open(&files, "txt").unwrap_err().to_string()
    };
    let nan = f64::NAN.to_le_bytes();
    for (error, named) in [
        (binary(0, 12, &[7]), "cameras.bin: byte 8: camera model FOV is not read"),
        (binary(0, 12, &[99]), "cameras.bin: byte 8: camera model number 99"),
        (binary(0, 0, &[255; 8]), "cameras.bin: byte 0: the file ends before all cameras"),
        (binary(0, 0, &[5]), "more bytes follow"),
        (binary(0, 32, &nan), "cameras.bin: byte 8: lens fx"),
        (binary(1, 12, &nan), "images.bin: byte 8: b/two words.jpg: its quaternion"),
        (binary(1, 68, &[44]), "b/two words.jpg: camera 44 is not"),
        (binary(1, 72, &[255]), "images.bin: byte 72: the text is not UTF-8"),
        (binary(2, 16, &nan), "points3D.bin: byte 8: a point whose"),
        (text(0, "PINHOLE", "DIVISION"), "cameras.txt: line 2: camera model SIMPLE_DIVISION"),
        (text(0, "240.5", ""), "cameras.txt: line 2: 2 camera parameters; SIMPLE_PINHOLE has 3"),
        (text(0, "\n2 PIN", "\n1 PIN"), "cameras.txt: line 3: camera 1 stands there twice"),
        (text(1, "0.5 0.5", "0.5 0.9"), "images.txt: line 3: b/two words.jpg: its quaternion"),
        (text(1, "a.png", "c.png"), "images.txt: line 7: c.png stands there twice"),
        (text(1, "a.png", ""), "images.txt: line 5: the picture has no name"),
        (text(1, "1.5 2.5 -1 ", "1.5 2.5 "), "images.txt: line 4: 5 words: neither observations"),
        (text(2, "255", "256"), "points3D.txt: line 3: \"256\" as blue"),
        (text(2, " 5 17", " 5"), "points3D.txt: line 3: half of a track"),
    ] {
        assert!(error.contains(named), "{error} / {named}");
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(ColmapModel::open(folder.path()), Err(ColmapError::Missing { .. })));
    std::fs::write(folder.path().join("cameras.txt"), "").unwrap();
    let error = ColmapModel::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("images.txt"), "{error}");
}

proptest! {
    #[test]
    fn cut_files_are_refused_and_flipped_ones_never_panic(
        which in 0usize..3, cut: prop::sample::Index, at: prop::sample::Index, value: u8,
        text: bool,
    ) {
        let files = if text { text_files() } else { binary_files() };
        let whole = &files[which];
        let kept = &whole[..cut.index(whole.len())];
        // A text may end after any line.
        prop_assert!(parse(which, kept, text).is_err() || text);
        let mut flipped = whole.clone();
        flipped[at.index(whole.len())] = value;
        let _ = parse(which, &flipped, text);
    }

    #[test]
    fn noise_is_no_model(bytes: Vec<u8>, which in 0usize..3, text: bool) {
        let _ = parse(which, &bytes, text);
    }
}
