//! What was told before, before a camera that moves along a wall.

use glam::DVec3;
use nvsprior::Decoded;
use nvsprior::truth::TruthMap;

use super::*;
use crate::scene::{CAMERA, wall};

/// Blocks of 16 pixels in a row of the picture.
const COLUMNS: usize = 10;

/// A picture from a place beside the first one, in blocks of a picture at the wall's distance. `told`: its map.
fn seen(blocks: f64, time: f64, told: Option<&[(usize, u8)]>) -> Shown<'static> {
    picture(blocks, time, told, false)
}

fn picture(
    blocks: f64,
    time: f64,
    told: Option<&[(usize, u8)]>,
    uncertain: bool,
) -> Shown<'static> {
    let right = blocks * 16.0 * 4.0 / f64::from(CAMERA.fx);
    let pose = Pose::from_centre(Default::default(), DVec3::X * right);
    let mut truth = TruthMap::not_seen(CAMERA.width, CAMERA.height);
    if let Some(told) = told {
        truth.thresholds = Some([16.0, 28.0]);
        truth.levels.fill(0);
        told.iter().for_each(|(block, level)| truth.levels[*block] = *level);
    }
    Shown {
        // A test may keep it for good.
        decoded: Box::leak(Box::new(Decoded { pose, truth, uncertain, ..Default::default() })),
        camera: CAMERA,
        number: 1,
        arrived: time + 1.0,
        exposed: time,
        clock: None,
        is_clock_off: false,
        old: 5.0,
        shares: (1, None),
        bytes: 60,
        complete: true,
    }
}

/// Where in the overlay a level is.
fn blocks(overlay: &Overlay, level: u8) -> Vec<usize> {
    (0..overlay.levels.len()).filter(|block| overlay.levels[*block] == level).collect()
}

#[test]
fn wrong_moves_with_the_camera_and_as_seen_becomes_memory() {
    let mut memory = MemoryView::new(&Engine::new(&Default::default()).unwrap(), &wall(5)).unwrap();
    let middle = 3 * COLUMNS + 5;
    memory.take(&seen(0.0, 100.0, Some(&[(middle, 2), (middle + 1, 1)]))).unwrap();
    let told = memory.overlay(101.0);
    assert_eq!((blocks(&told, 2), told.has_map, told.told_ago), (vec![middle], true, None));
    // Each step is small; they add up to two blocks.
    for step in 1..=20 {
        memory.take(&seen(f64::from(step) / 10.0, 100.0 + f64::from(step), None)).unwrap();
    }
    let held = memory.overlay(121.5);
    assert_eq!((blocks(&held, 7), blocks(&held, 6)), (vec![middle - 2], vec![middle - 1]));
    assert_eq!((held.has_map, held.told_ago, held.seen_ago), (false, Some(21.5), Some(21.5)));
    // What came into sight on the right was never told of; no block is as seen.
    assert_eq!((held.seen_before, blocks(&held, 0).len()), (6 * 8 - 2, 0));
    // It ends, also while nothing new comes.
    let after = memory.overlay(131.0);
    assert!(after.levels.iter().all(|level| (3..6).contains(level)), "{after:?}");
    assert_eq!((after.told_ago, after.seen_ago, after.seen_before), (None, None, 0));
}

#[test]
fn what_is_told_later_counts() {
    let mut memory = MemoryView::new(&Engine::new(&Default::default()).unwrap(), &wall(5)).unwrap();
    memory.take(&seen(0.0, 100.0, Some(&[(33, 2)]))).unwrap();
    memory.take(&seen(0.0, 101.0, Some(&[(34, 1)]))).unwrap();
    // A vehicle that is lost: what it tells is of another place.
    memory.take(&picture(0.0, 102.0, Some(&[(35, 2)]), true)).unwrap();
    memory.take(&seen(0.0, 103.0, None)).unwrap();
    let held = memory.overlay(104.0);
    assert_eq!((blocks(&held, 7), blocks(&held, 6)), (vec![], vec![34]));
    assert_eq!(held.told_ago, Some(3.0));
}
