use nvsprior::{Camera, Picture};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::*;
use nvsprior_runs::write_png;

use crate::frame_file::read_frame;
use nvsprior::geometry::Distortion;

/// A folder with pictures `images/a.png`, `images/b.png` of 40×30, grey of 50 and 200.
fn dive() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("images")).unwrap();
    for (name, grey) in [("a", 50), ("b", 200)] {
        let picture = Picture::from_rgb(40, 30, vec![grey; 40 * 30 * 3]).unwrap();
        write_png(&folder.path().join("images").join(name).with_extension("png"), &picture)
            .unwrap();
    }
    folder
}

fn cameras() -> Value {
    let image = |name: &str, split: &str| {
        json!({"file": format!("images/{name}.png"), "split": split, "qvec": [1, 0, 0, 0],
            "tvec": [0, 0, 1]})
    };
    json!({"width": 40, "height": 30, "fx": 30.0, "fy": 30.0, "cx": 20.0, "cy": 15.0,
        "images": [image("a", "train"), image("b", "test")]})
}

fn with_cameras(folder: &TempDir, value: &Value) -> PathBuf {
    let path = folder.path().join("cameras.json");
    std::fs::write(&path, value.to_string()).unwrap();
    path
}

fn with_model(folder: &Path, camera: &str) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("cameras.txt"), format!("1 {camera}\n")).unwrap();
    let images = "1 1 0 0 0 0 0 1 1 b.png\n\n2 1 0 0 0 0 0 2 1 a.png\n\n";
    std::fs::write(folder.join("images.txt"), images).unwrap();
    std::fs::write(folder.join("points3D.txt"), "1 1 2 3 255 0 0 0.5 1 0 2 0\n").unwrap();
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
    property float z\nend_header\n4 5 6\n";

fn message<T: std::fmt::Debug>(result: Result<T, PosedError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn camera_files_give_pictures_by_split() {
    let folder = dive();
    let path = with_cameras(&folder, &cameras());
    let mut options = PosedOptions::default();
    let all = posed_pictures(&path, &options).unwrap();
    assert_eq!((all.inputs.len(), all.points.is_none()), (2, true));
    assert_eq!(all.inputs[0].file, folder.path().join("images/a.png"));
    options.split = Some("test".into());
    let ply = folder.path().join("points.ply");
    std::fs::write(&ply, PLY).unwrap();
    options.points = Some(ply);
    let test = posed_pictures(&path, &options).unwrap();
    assert_eq!(test.inputs[0].name, "images/b.png");
    assert_eq!(test.points.unwrap()[0].position.z, 6.0);
    options.split = Some("val".into());
    assert!(message(posed_pictures(&path, &options)).contains("there are: test, train"));
    options =
        PosedOptions { pictures: Some(folder.path().join("elsewhere")), ..Default::default() };
    let error = message(posed_pictures(&path, &options));
    assert!(error.contains("cameras.json") && error.contains("elsewhere/images/a.png"), "{error}");
}

#[test]
fn nerfstudios_points_are_read_with_its_pictures() {
    let folder = dive();
    let mut frame = json!({"file_path": "images/a", "transform_matrix":
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]});
    let file = |frame: &Value| {
        json!({"w": 40, "h": 30, "fl_x": 30.0, "fl_y": 30.0, "cx": 20.0, "cy": 15.0, "k1": 0.1,
            "ply_file_path": "cloud.ply", "frames": [frame]})
    };
    let path = with_cameras(&folder, &file(&frame));
    let options = PosedOptions::default();
    assert!(message(posed_pictures(&path, &options)).contains("cloud.ply"), "it is missing");
    std::fs::write(folder.path().join("cloud.ply"), PLY).unwrap();
    let found = posed_pictures(&path, &options).unwrap();
    assert_eq!(found.points.unwrap().len(), 1);
    assert_eq!(found.inputs[0].file, folder.path().join("images/a.png"));
    frame["transform_matrix"][0][0] = Value::Null;
    let error = message(posed_pictures(&with_cameras(&folder, &file(&frame)), &options));
    assert!(error.contains("view 0 images/a: \"transform_matrix\""), "{error}");
}

#[test]
fn models_are_found_with_their_pictures() {
    let folder = dive();
    let sparse = folder.path().join("sparse/0");
    with_model(&sparse, "SIMPLE_RADIAL 40 30 30 20 15 0.1");
    let options = PosedOptions::default();
    for given in [folder.path(), &sparse] {
        let PosedPictures { inputs, points } = posed_pictures(given, &options).unwrap();
        assert_eq!((inputs[0].name.as_str(), inputs[0].pose.translation.z), ("a.png", 2.0));
        assert_eq!(
            inputs[1].file.canonicalize().unwrap(),
            folder.path().join("images/b.png").canonicalize().unwrap()
        );
        assert_ne!(inputs[0].lens.distortion(), &Distortion::None);
        assert_eq!(points.unwrap()[0].track, Some(2));
    }
    let split = PosedOptions { split: Some("test".into()), ..PosedOptions::default() };
    assert!(message(posed_pictures(&sparse, &split)).contains("there are: none"));
    std::fs::remove_file(folder.path().join("images/b.png")).unwrap();
    assert!(message(posed_pictures(&sparse, &options)).contains("images/b.png"));
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    assert!(matches!(posed_pictures(&sparse, &options), Err(PosedError::NoFolder { .. })));
    std::fs::remove_dir_all(&sparse).unwrap();
    assert!(matches!(posed_pictures(folder.path(), &options), Err(PosedError::NoModel { .. })));
    assert!(message(posed_pictures(&sparse, &options)).contains("no such file"));
}

#[test]
fn pictures_come_at_the_cameras_size() {
    let folder = dive();
    let path = with_cameras(&folder, &cameras());
    let input = &posed_pictures(&path, &PosedOptions::default()).unwrap().inputs[1];
    let small = input.lens.pinhole_at(20);
    assert_eq!((small.width, small.height), (20, 15));
    let frame = read_frame(&input.file, 20, 15).unwrap();
    assert_eq!(input.load(&small).unwrap(), frame);
    let (picture, mask) = input.load_masked(&Camera { cx: 12.0, ..small }).unwrap();
    assert_eq!(picture.data[3 * 5], 200);
    assert_eq!(mask.data.iter().filter(|counts| !**counts).count(), 2 * 15);
    assert!(message(input.load(&Camera { width: 0, ..small })).contains("b.png: picture size"));
}

#[test]
fn pictures_of_another_size_are_taken_with_scaled_intrinsics() {
    let folder = dive();
    with_model(&folder.path().join("sparse"), "RADIAL 80 60 60 40 30 0.1 0.01");
    let input = &posed_pictures(folder.path(), &PosedOptions::default()).unwrap().inputs[1];
    let (picture, mask) = input.load_masked(&input.lens.pinhole_at(20)).unwrap();
    assert_eq!((picture, mask.share()), (Picture::from_rgb(20, 15, vec![200; 900]).unwrap(), 1.0));
    write_png(&input.file, &Picture::new(30, 30)).unwrap();
    let error = message(input.load(&input.lens.pinhole_at(20)));
    assert!(error.contains("b.png: 30×30 is of another shape"), "{error}");
    std::fs::write(&input.file, "no picture").unwrap();
    assert!(message(input.load(&input.lens.pinhole())).contains("b.png"));
}

#[test]
fn masks_go_by_name_and_white_counts() {
    let folder = dive();
    let path = with_cameras(&folder, &cameras());
    let masks = folder.path().join("masks");
    let options = PosedOptions { masks: Some(masks.clone()), ..PosedOptions::default() };
    let error = message(posed_pictures(&path, &options));
    assert!(error.contains("masks/images/b.png"), "{error}");
    std::fs::create_dir_all(masks.join("images")).unwrap();
    // Half of the mask is black; it is half as large as the picture.
    let half =
        image::GrayImage::from_fn(20, 15, |x, _| image::Luma([if x < 10 { 0 } else { 255 }]));
    for name in ["b.png", "images/b.png.png", "images/b.png"] {
        half.save(masks.join(name)).unwrap();
        let inputs = posed_pictures(&path, &options).unwrap().inputs;
        assert_eq!((&inputs[0].mask, &inputs[1].mask), (&None, &Some(masks.join(name))));
        let (_, mask) = inputs[1].load_masked(&inputs[1].lens.pinhole()).unwrap();
        assert!(mask.data.iter().enumerate().all(|(i, counts)| *counts == (i % 40 >= 20)));
        assert_eq!(inputs[0].load_masked(&inputs[0].lens.pinhole()).unwrap().1.share(), 1.0);
    }
    std::fs::write(masks.join("images/b.png"), "no picture").unwrap();
    let input = &posed_pictures(&path, &options).unwrap().inputs[1];
    assert!(message(input.load_masked(&input.lens.pinhole())).contains("masks/images/b.png"));
}

/// Alpha is a mask, not a colour; a frame that is encoded has none.
#[test]
fn what_is_transparent_does_not_count() {
    let folder = dive();
    let path = folder.path().join("images/a.png");
    let half = |x: u32| if x < 20 { 255 } else { 0 };
    let pixel = |x, _| image::Rgba([50, 50, 50, half(x)]);
    image::RgbaImage::from_fn(40, 30, pixel).save(&path).unwrap();
    let cameras = with_cameras(&folder, &cameras());
    let listed = posed_pictures(&cameras, &PosedOptions::default()).unwrap();
    let camera = listed.inputs[0].lens.pinhole();
    for camera in [camera, camera.reduced(2)] {
        let (_, counts) = listed.inputs[0].load_masked(&camera).unwrap();
        let at = |x: u32| counts.data[(camera.width * 5 + x) as usize];
        assert!(at(1) && at(camera.width / 2 - 2));
        assert!(!at(camera.width / 2 + 1) && !at(camera.width - 1));
    }
    let error = read_frame(&path, 40, 30).unwrap_err().to_string();
    assert!(error.contains("a.png") && error.contains("transparent"), "{error}");
    image::RgbaImage::from_pixel(40, 30, image::Rgba([50, 50, 50, 255])).save(&path).unwrap();
    assert_eq!(read_frame(&path, 40, 30).unwrap().data[..3], [50; 3]);
}

#[test]
fn a_broken_jpeg_is_told_by_name() {
    let folder = dive();
    let path = folder.path().join("images/a.png");
    let picture = image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([(x * 6) as u8, y as u8, 9]));
    picture.save_with_format(&path, image::ImageFormat::Jpeg).unwrap();
    assert!(read_frame(&path, 40, 30).is_ok());
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 100]).unwrap();
    let error = read_frame(&path, 40, 30).unwrap_err().to_string();
    assert!(error.contains("a.png") && error.contains("cut off"), "{error}");
    let cameras = with_cameras(&folder, &cameras());
    let listed = posed_pictures(&cameras, &PosedOptions::default()).unwrap();
    let camera = listed.inputs[0].lens.pinhole();
    assert!(message(listed.inputs[0].load(&camera)).contains("cut off"));
}
