//! A blocked prior in blocks draws, searches and encodes as the whole prior does, within the memory that it is given.

mod common;

use std::path::Path;
use std::sync::Arc;

use common::{assert_silent, camera, engine, random_splats, write_blocked};
use glam::{DQuat, DVec3};
use nvsprior::prior::Splats;
use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::render::{BlockReader, Plan, Residency, Scene};
use nvsprior::vulkan::Error as VulkanError;
use nvsprior::{
    Camera, Decoder, Encoder, EncoderOptions, Engine, Error, Picture, Pose, Prior, Rate,
    RenderOptions, RenderOverrides,
};

/// Distance from part to part, and their number.
const STEP: f32 = 7.0;
const PARTS: u64 = 10;
/// Splats of a part.
const EACH: usize = 1200;

/// A wall along the x axis, 2 to 8 units in front of cameras that fly along it.
fn wall() -> Prior {
    let mut splats = Splats { sh_degree: 1, ..Splats::default() };
    for part in 0..PARTS {
        let mut own = random_splats(part + 1, EACH, 1);
        own.positions.iter_mut().for_each(|p| p[0] += STEP * part as f32);
        own.log_scales.iter_mut().flatten().for_each(|s| *s -= 0.7);
        splats.append(&mut own);
    }
    Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap()
}

/// The camera of frame `i` of a flight along the wall.
fn pose(i: u32) -> Pose {
    at(f64::from(i))
}

fn at(t: f64) -> Pose {
    let centre = DVec3::new(0.3 * t, 0.2 * (0.3 * t).sin(), 0.15 * (0.2 * t).cos());
    Pose::from_centre(DQuat::from_rotation_y(0.15 * (0.11 * t).sin()), centre)
}

struct Wall {
    engine: Engine,
    whole: Arc<Scene>,
    blocked: Arc<BlockedPrior>,
    _folder: tempfile::TempDir,
}

fn blocked_at(path: &Path, prior: &Prior, block: usize) -> BlockedPrior {
    write_blocked(path, prior, block);
    BlockedPrior::open(path).unwrap()
}

fn scenes() -> Wall {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall.nvsb");
    let blocked = Arc::new(blocked_at(&path, &wall(), 256));
    let engine = engine();
    let whole = Prior::open(&path, &RenderOverrides::default()).unwrap();
    assert_eq!(whole.id(), blocked.id());
    let whole = engine.upload(&whole).unwrap();
    Wall { engine, whole, blocked, _folder: folder }
}

/// Bytes for about so many splats.
fn limit(splats: u64) -> u64 {
    splats * 332
}

const CAMERA: Camera = Camera { width: 160, height: 90, fx: 137.0, fy: 137.0, cx: 80.0, cy: 45.0 };

#[test]
fn pictures_have_the_same_bytes() {
    let Wall { engine, whole, blocked, _folder } = scenes();
    for (splats, spawn) in [(6000, BlockReader::threaded()), (4000, BlockReader::when_needed())] {
        let scene = engine.open_blocked(&blocked, limit(splats), spawn).unwrap();
        assert_eq!(scene.id(), whole.id());
        let mut pictures = [Picture::new(160, 90), Picture::new(160, 90)];
        let mut renderers =
            [&whole, &scene].map(|s| engine.renderer(s, &CAMERA, Plan::picture()).unwrap());
        // Along the wall, back by leaps, turned away, and from far behind.
        let away = Pose::from_centre(DQuat::from_rotation_y(3.0), DVec3::new(9.0, 0.0, 0.0));
        let poses = (0..200).step_by(7).chain([3, 150, 80, 199, 0]).map(pose).chain([away]);
        let mut most = 0;
        for pose in poses {
            for (renderer, picture) in renderers.iter_mut().zip(&mut pictures) {
                renderer.picture(&pose, picture).unwrap();
            }
            assert_eq!(pictures[0].data, pictures[1].data, "{pose:?}");
            most = most.max(scene.residency().unwrap().splats);
        }
        let Residency { changes, room, host_bytes, .. } = scene.residency().unwrap();
        assert!(most <= room && room <= blocked.len() / 2, "{most} of {room} of {}", blocked.len());
        assert!(changes > 3, "{changes}");
        assert!(host_bytes <= limit(splats));
    }
    assert_silent(&engine);
}

/// Encodes a flight and decodes it again, with a scene for each side.
fn flight(engine: &Engine, scenes: [&Arc<Scene>; 2], frames: &[Picture]) -> Vec<Vec<u8>> {
    let options = EncoderOptions { rate: Some(Rate::Bytes(300)), ..EncoderOptions::default() };
    let mut encoder = Encoder::new(engine, scenes[0], &CAMERA, options).unwrap();
    let mut decoder = Decoder::new(engine, scenes[1]);
    let mut packets = Vec::new();
    for (i, frame) in (0..).zip(frames) {
        let hint = (i == 0).then(|| pose(0));
        let encoded = encoder.encode(frame, hint).unwrap();
        assert!(encoded.stats.certain, "frame {i}");
        let decoded = decoder.decode(&encoded.packet).unwrap();
        assert_eq!(decoded.picture.data, encoded.picture.data, "frame {i}");
        packets.push(encoded.packet);
    }
    packets
}

#[test]
fn a_flight_gives_the_same_packets() {
    let Wall { engine, whole, blocked, _folder } = scenes();
    let mut renderer = engine.renderer(&whole, &CAMERA, Plan::picture()).unwrap();
    let frames: Vec<Picture> = (0..100)
        .map(|i| {
            let mut frame = Picture::new(160, 90);
            renderer.picture(&at(0.6 * f64::from(i)), &mut frame).unwrap();
            // What the prior does not show: a shade, and something in front of the camera.
            for (at, byte) in frame.data.iter_mut().enumerate() {
                let (x, y) = (at / 3 % 160, at / 480);
                *byte = (u32::from(*byte) * 9 / 10) as u8;
                if (60..90).contains(&x) && (50..70).contains(&y) {
                    *byte = 40;
                }
            }
            frame
        })
        .collect();
    let expected = flight(&engine, [&whole, &whole], &frames);
    let scenes = [0; 2]
        .map(|_| engine.open_blocked(&blocked, limit(7000), BlockReader::threaded()).unwrap());
    let packets = flight(&engine, [&scenes[0], &scenes[1]], &frames);
    assert!(packets == expected, "packets of a blocked in blocks");
    for scene in scenes {
        let residency = scene.residency().unwrap();
        assert_eq!(residency.incomplete, 0);
        assert!(residency.changes > 3, "{residency:?}");
    }
    // One side whole, the other in blocks, on one scene for both.
    let scene = engine.open_blocked(&blocked, limit(7000), BlockReader::when_needed()).unwrap();
    assert!(flight(&engine, [&scene, &scene], &frames) == expected, "one scene for both sides");
    assert_silent(&engine);
}

#[test]
fn too_little_memory_is_refused_and_recovered_from() {
    let Wall { engine, blocked, _folder, .. } = scenes();
    let scene = engine.open_blocked(&blocked, limit(600), BlockReader::when_needed()).unwrap();
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let mut picture = Picture::new(160, 90);
    let error = renderer.picture(&pose(60), &mut picture).unwrap_err();
    assert!(matches!(error, VulkanError::TooManySplats { .. }), "{error}");
    assert!(Error::from(error).to_string().contains("raise its limit"));
    // Where less is seen, it draws.
    let beyond = Pose::from_centre(DQuat::IDENTITY, DVec3::new(0.0, 0.0, 40.0));
    renderer.picture(&beyond, &mut picture).unwrap();
    assert!(picture.data.iter().all(|byte| *byte == 0));
}

#[test]
fn a_block_that_cannot_be_read_fails_its_frame_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall.nvsb");
    let blocked = Arc::new(blocked_at(&path, &wall(), 256));
    let block = blocked.blocks()[blocked.blocks().len() / 2];
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[(block.offset + u64::from(block.bytes) / 2) as usize] ^= 1;
    // In place: the file stays open.
    std::os::unix::fs::FileExt::write_all_at(
        &std::fs::OpenOptions::new().write(true).open(&path).unwrap(),
        &bytes,
        0,
    )
    .unwrap();
    let engine = engine();
    let scene = engine.open_blocked(&blocked, limit(6000), BlockReader::threaded()).unwrap();
    let mut renderer = engine.renderer(&scene, &camera(64, 36), Plan::picture()).unwrap();
    let mut picture = Picture::new(64, 36);
    let drawn = (0..220).step_by(5).map(|i| renderer.picture(&pose(i), &mut picture));
    let results: Vec<_> = drawn.collect();
    let failed = results.iter().filter(|result| result.is_err()).count();
    assert!(failed > 0 && failed < results.len() / 2, "{failed} of {}", results.len());
    let error = results.into_iter().find_map(Result::err).unwrap().to_string();
    assert!(error.contains("wall.nvsb: block") && error.contains("damaged"), "{error}");
}
