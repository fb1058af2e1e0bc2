//! Scenes far from the origin of their coordinates, as those in UTM: nothing is lost, and poses are the file's.

mod common;
mod scene;

use common::assert_silent;
use glam::DVec3;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{Extras, KeyFrames, PriorWarning, blocked, ply};
use nvsprior::{Decoder, Encoder, EncoderOptions, Pose, Prior, RenderOverrides};
use scene::{CAMERA, frame, on_device, pose, pose_error, wall};

/// A place in UTM zone 32 N, with a part of a unit.
const PLACE: DVec3 = DVec3::new(512_345.25, 5_932_101.5, -37.125);

/// The wall in a PLY file, moved to `place`. `kind`: of its numbers.
fn file(place: DVec3, kind: &str) -> Vec<u8> {
    let prior = wall(3);
    let splats = prior.splats();
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String =
        names.split(' ').map(|name| format!("property {kind} {name}\n")).collect();
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{properties}end_header\n",
        splats.len()
    );
    let mut bytes = head.into_bytes();
    for i in 0..splats.len() {
        let position = DVec3::from(splats.positions[i].map(f64::from)) + place;
        let others = splats.sh[3 * i..3 * i + 3].iter().chain([&splats.opacity_logits[i]]);
        let others = others.chain(&splats.log_scales[i]).chain(&splats.rotations[i]);
        for value in position.to_array().into_iter().chain(others.map(|v| f64::from(*v))) {
            match kind {
                "double" => bytes.extend(value.to_le_bytes()),
                _ => bytes.extend((value as f32).to_le_bytes()),
            }
        }
    }
    bytes
}

fn read(bytes: &[u8]) -> Prior {
    Prior::from_bytes(bytes, "far.ply", &RenderOverrides::default()).unwrap()
}

fn warning(prior: &Prior) -> (DVec3, Option<f64>) {
    match &prior.report().warnings[..] {
        [PriorWarning::Moved { origin, coarse }] => (DVec3::from(*origin), *coarse),
        others => panic!("{others:?}"),
    }
}

#[test]
fn a_far_scene_is_moved_by_whole_units_and_says_so() {
    let prior = read(&file(PLACE, "double"));
    let (origin, coarse) = warning(&prior);
    assert_eq!((origin, coarse), (prior.origin(), None));
    assert!(origin.round() == origin && (origin - PLACE).abs().max_element() < 5.0, "{origin}");
    for (far, near) in prior.splats().positions.iter().zip(&wall(3).splats().positions) {
        let [far, near] = [far, near].map(|p| DVec3::from(p.map(f64::from)));
        assert!((far + origin - PLACE - near).length() < 1e-6);
    }
    let text = prior.report().notes().next().unwrap();
    assert!(text.contains("5932102") || text.contains("5932101"), "{text}");
    // 32-bit numbers lie half a unit apart there: that is told, too.
    let (_, coarse) = warning(&read(&file(PLACE, "float")));
    assert_eq!(coarse, Some(0.5));
    // A scene near the origin stays as it is, whatever its numbers are.
    let plain = read(&file(DVec3::ZERO, "double"));
    assert_eq!((plain.origin(), plain.report().warnings.len()), (DVec3::ZERO, 0));
    assert_eq!(plain.id(), read(&file(DVec3::ZERO, "float")).id());
    let few = read(&file(DVec3::new(60.0, 0.0, 0.0), "double"));
    assert_eq!(few.origin(), DVec3::ZERO);
}

/// Poses given and got are the world's. The packets are those of the same scene near to its origin.
#[test]
fn poses_go_in_and_come_back_in_the_files_coordinates() {
    let prior = read(&file(PLACE, "double"));
    let (engine, scene) = on_device(&prior);
    let there = |t: f64| pose(t).relative_to(-PLACE);
    let (_, near) = on_device(&wall(3));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    for t in 0..3 {
        let seen = frame(&engine, &near, &pose(f64::from(t)));
        let start = (t == 0).then(|| there(0.0));
        let encoded = encoder.encode(&seen, start).unwrap();
        assert!(encoded.stats.certain, "{:?}", encoded.stats);
        let back = |pose: &Pose| pose.relative_to(PLACE);
        assert!(pose_error(&back(&encoded.pose), &pose(f64::from(t))) < 0.3);
        let decoded = decoder.decode(&encoded.packet).unwrap();
        assert!((decoded.pose.centre() - encoded.pose.centre()).length() < 1e-8);
        assert_eq!(decoder.pose_of(&encoded.packet).unwrap().0, decoded.pose);
        assert_eq!(decoded.picture, encoded.picture);
        let mut drawn = decoded.picture.clone();
        assert!(decoder.draw(&decoded.pose, &mut drawn).unwrap());
        assert!(drawn.psnr(&encoded.render) > 45.0);
    }
    // A hint in the scene's own coordinates is far away.
    assert!(encoder.encode(&frame(&engine, &near, &pose(3.0)), pose(3.0)).is_err());
    assert_silent(&engine);
}

#[test]
fn every_file_of_ours_keeps_the_origin() {
    let key_frames = KeyFrames::new((0..3).map(|t| pose(f64::from(t))).collect()).unwrap();
    let extras = Extras { key_frames: key_frames.clone(), ..Extras::default() };
    let prior = read(&file(PLACE, "double")).with_extras(extras).unwrap();
    let same = |bytes: &[u8], id| {
        let again = read(bytes);
        assert_eq!((again.id(), again.origin()), (id, prior.origin()));
        assert!(again.report().warnings.is_empty(), "{:?}", again.report().warnings);
        let (a, b) = (again.key_frames().poses()[2].centre(), key_frames.poses()[2].centre());
        assert!((a - b).length() < 1e-4, "{a}, {b}");
    };
    let (splats, besides) = (prior.splats(), prior.besides());
    let mut bytes = Vec::new();
    compact::write_exact(splats, &besides, &mut bytes).unwrap();
    same(&bytes, prior.id());
    let mut bytes = Vec::new();
    ply::write_ply(splats, prior.options(), &key_frames, prior.preprocessing(), &mut bytes)
        .unwrap();
    same(&bytes, prior.id());
    let mut bytes = Vec::new();
    let id = compact::write(splats, &besides, &Quantisation::default(), &mut bytes).unwrap();
    same(&bytes, id);
    let writer = blocked::BlockedWriter::default();
    let mut bytes = Vec::new();
    let id = writer.write(splats, &besides, &mut bytes, &mut |_| {}).unwrap().id;
    same(&bytes, id);
    // At another place it is another prior, since poses mean something else.
    assert_ne!(read(&file(PLACE + DVec3::X, "double")).id(), prior.id());
}
