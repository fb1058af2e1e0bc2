//! Doubt through the public API: a wall of splats. Pictures contradict a part of it, and do not see another. A third
//! part is missing.

#[path = "../../../tests/common/mod.rs"]
mod common;

use nvsprior::prior::{Extras, RenderOptions, Splats};
use nvsprior::render::Plan;
use nvsprior::{Camera, DoubtLevel, DoubtMap, DoubtView, Picture, Pose, Prior};
use nvsprior_train::PosedPicture;
use nvsprior_train::doubt::doubt_of;

const CAMERA: Camera = Camera { width: 96, height: 64, fx: 48.0, fy: 48.0, cx: 48.0, cy: 32.0 };

/// A wall at z = 2 from x = -2 to 1: grey splats that cover it.
fn wall() -> Prior {
    let mut splats = Splats::default();
    for column in -20..10 {
        for row in -30..15 {
            splats.positions.push([column as f32 * 0.1, row as f32 * 0.1, 2.0]);
            splats.log_scales.push([-2.6, -2.6, -4.0]);
            splats.rotations.push([1.0, 0.0, 0.0, 0.0]);
            splats.opacity_logits.push(4.0);
            splats.sh.extend([0.0; 3]);
        }
    }
    Prior::from_splats(splats, RenderOptions::INRIA).unwrap()
}

fn drawn(prior: &Prior, pose: &Pose) -> Picture {
    let engine = common::engine();
    let scene = engine.upload(prior).unwrap();
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    renderer.picture(pose, &mut picture).unwrap();
    picture
}

/// What a camera sees that goes along the wall, in steps of 0.05.
fn pictures(prior: &Prior, count: usize) -> Vec<PosedPicture> {
    let pose = |i: usize| Pose::exp(&[0.05 * i as f64, 0.0, 0.0, 0.0, 0.0, 0.0]);
    (0..count).map(|i| PosedPicture::new(CAMERA, pose(i), drawn(prior, &pose(i)))).collect()
}

fn map_of(prior: &Prior, pictures: &[PosedPicture], pose: &Pose) -> DoubtMap {
    let engine = common::engine();
    let mut told = 0;
    let posed = pictures.iter().map(|picture| (picture, picture.pose));
    let doubt = doubt_of(&engine, prior, posed, &mut || told += 1).unwrap();
    assert_eq!(told, pictures.len());
    let mut map = DoubtMap::default();
    let extras = Extras { doubt: Some(doubt), ..prior.extras().clone() };
    let doubtful = prior.clone().with_extras(extras).unwrap();
    let mut view = DoubtView::new(&engine, &doubtful).unwrap();
    view.draw(&CAMERA, pose, &mut map).unwrap();
    assert_eq!((map.columns, map.rows, map.levels.len()), (6, 4, 24));
    map
}

fn level(map: &DoubtMap, column: u32, row: u32) -> u8 {
    map.levels[(row * map.columns + column) as usize]
}

#[test]
fn what_pictures_confirm_is_sure_and_what_they_contradict_is_not() {
    let prior = wall();
    let mut pictures = pictures(&prior, 24);
    let map = map_of(&prior, &pictures, &Pose::IDENTITY);
    // The wall ends at x = 1, in the picture at 48 + 24: the last column is beside it.
    assert_eq!(level(&map, 1, 1), DoubtLevel::Sure as u8, "{map:?}");
    assert_eq!(level(&map, 5, 1), DoubtLevel::NeverMapped as u8, "{map:?}");
    // In all pictures the wall is 60 brighter from x = -0.6 to 0, from 48 - 14 on in the first one.
    for (i, picture) in pictures.iter_mut().enumerate() {
        let shift = 1.2 * i as f32;
        let columns = (33.6 + shift) as usize..(48.0 + shift) as usize;
        for row in picture.picture.data.chunks_exact_mut(3 * CAMERA.width as usize) {
            row[3 * columns.start..3 * columns.end].iter_mut().for_each(|v| *v += 60);
        }
    }
    let map = map_of(&prior, &pictures, &Pose::IDENTITY);
    assert_eq!(level(&map, 2, 1), DoubtLevel::Doubtful as u8, "{map:?}");
    assert_eq!(level(&map, 0, 1), DoubtLevel::Sure as u8, "{map:?}");
    assert!(map.expected[6 + 2] > 2.0 * map.expected[6], "{map:?}");
    common::assert_silent(&common::engine());
}

#[test]
fn what_no_picture_saw_is_doubtful() {
    let prior = wall();
    let pictures = pictures(&prior, 24);
    // It saw the wall from y = -1.33 to 1.33. This one stands 1.4 above it, as y points down.
    let above = Pose::exp(&[0.0, 1.4, 0.0, 0.0, 0.0, 0.0]);
    let map = map_of(&prior, &pictures, &above);
    assert_eq!(level(&map, 1, 0), DoubtLevel::Doubtful as u8, "{map:?}");
    let mut view = DoubtView::new(&common::engine(), &prior).unwrap();
    let mut unknown = DoubtMap::default();
    view.draw(&CAMERA, &Pose::IDENTITY, &mut unknown).unwrap();
    assert_eq!(level(&unknown, 1, 1), DoubtLevel::Doubtful as u8, "nothing vouches for it");
    assert_eq!(level(&unknown, 5, 1), DoubtLevel::NeverMapped as u8);
    common::assert_silent(&common::engine());
}
