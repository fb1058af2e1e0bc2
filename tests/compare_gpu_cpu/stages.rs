//! Single stages against their twins: projection, derivatives, depth order, binning, ranges.

use nvsprior::prior::Splats;
use nvsprior::reference::derive::{Motion, derive};
use nvsprior::reference::project::Projected;
use nvsprior::reference::{Twin, Twist, bin, radix, ranges};
use nvsprior::render::probe::{self, Stages};
use nvsprior::shared::{BIN_BLOCK, CULLED, TILE};
use nvsprior::{Camera, Pose, Prior, RenderOptions};

use crate::common::{self, Random, camera, random_pose, random_prior, random_splats};

/// Room that no scene here exceeds.
const ROOM: u32 = 1 << 20;

fn run(prior: &Prior, camera: &Camera, pose: &Pose, room: u32) -> Stages {
    let engine = common::engine();
    let scene = engine.upload(prior).unwrap();
    let stages = probe::stages(&engine, &scene, camera, pose, room).unwrap();
    common::assert_silent(&engine);
    stages
}

fn priors() -> [Prior; 2] {
    let options = RenderOptions { antialiased: true, ..RenderOptions::INRIA };
    let mut splats = random_splats(51, 3_000, 1);
    // Specks and needles, whose compensation is at its least.
    for i in (0..3_000).step_by(7) {
        splats.log_scales[i] = [-9.0, -10.0, if i % 2 == 0 { -9.5 } else { -3.0 }];
        splats.opacity_logits[i] = 6.0;
    }
    [random_prior(50, 3_000, 3), Prior::from_splats(splats, options).unwrap()]
}

fn assert_close(what: &str, splat: u32, got: f32, expected: f64, tolerance: f64) {
    let error = (f64::from(got) - expected).abs();
    assert!(error <= tolerance, "{what} of splat {splat}: {got}, twin {expected}");
}

/// Holds a record of stage `project` against the twin's splat.
fn assert_record(record: &[f32; 12], s: &Projected) {
    let i = s.index;
    let close = |what, got, expected, tolerance| assert_close(what, i, got, expected, tolerance);
    let [u, v, l11, l21, l22, opacity, sigma_x, sigma_y, r, g, b, z] = *record;
    close("u", u, s.mean.x, 1e-5 * s.mean.x.abs() + 1e-4);
    close("v", v, s.mean.y, 1e-5 * s.mean.y.abs() + 1e-4);
    let conic = s.conic;
    let scale = 1e-4 * (conic.x_axis.x + conic.y_axis.y);
    close("conic xx", l11 * l11, conic.x_axis.x, scale);
    close("conic xy", l11 * l21, conic.x_axis.y, scale);
    close("conic yy", l21 * l21 + l22 * l22, conic.y_axis.y, scale);
    let deviations = [s.covariance.x_axis.x.sqrt(), s.covariance.y_axis.y.sqrt()];
    close("deviation along x", sigma_x, deviations[0], 1e-5 * deviations[0]);
    close("deviation along y", sigma_y, deviations[1], 1e-5 * deviations[1]);
    close("opacity", opacity, s.opacity, 1e-4 * s.opacity);
    for (value, expected) in [r, g, b].into_iter().zip(s.rgb) {
        close("colour", value, expected, 1e-5);
    }
    close("depth", z, s.camera.z, s.depth_error);
}

#[test]
fn projection() {
    for prior in priors() {
        let (camera, pose) = (camera(96, 64), random_pose(50));
        let stages = run(&prior, &camera, &pose, ROOM);
        let twin = Twin::new(&prior);
        let seen = twin.project(&twin.view(&camera, &pose));
        let drawn = seen.iter().filter(|s| stages.tile_counts[s.index as usize] > 0);
        assert!(drawn.clone().count() > 500, "the scene is in view");
        drawn.for_each(|s| assert_record(&stages.records[s.index as usize], s));
    }
}

/// The derivatives of one splat as stage `derive` lays them out.
fn motion_of(d: &[f32; 48]) -> Motion {
    let twist = |k: usize| -> Twist {
        let at = |j: usize| f64::from(if j < 3 { d[8 * k + j] } else { d[8 * k + 4 + j - 3] });
        std::array::from_fn(at)
    };
    let rho = |channel: usize| -> Twist {
        let at = |j: usize| f64::from(if j < 3 { d[4 * (3 * channel + j) + 3] } else { 0.0 });
        std::array::from_fn(at)
    };
    Motion {
        mean: [twist(0), twist(1)],
        covariance: [twist(2), twist(3), twist(4)],
        ln_alpha: twist(5),
        rgb: [rho(0), rho(1), rho(2)],
    }
}

fn assert_twist(what: &str, splat: u32, got: &Twist, expected: &Twist, floor: f64) {
    let size = expected.iter().fold(floor, |m, v| m.max(v.abs()));
    let error = std::iter::zip(got, expected).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(error <= 1e-3 * size, "{what} of splat {splat}: {got:?}, twin {expected:?}");
}

#[test]
fn derivatives() {
    for prior in priors() {
        let (camera, pose) = (camera(96, 64), random_pose(52));
        let stages = run(&prior, &camera, &pose, ROOM);
        let twin = Twin::new(&prior);
        let view = twin.view(&camera, &pose);
        let seen = twin.project(&view);
        for s in seen.iter().filter(|s| stages.tile_counts[s.index as usize] > 0) {
            let i = s.index;
            let got = motion_of(&stages.derivatives[i as usize]);
            let expected = derive(&view, &twin.splats()[i as usize], s);
            for k in 0..2 {
                assert_twist("mean", i, &got.mean[k], &expected.mean[k], 0.0);
            }
            let size = s.covariance.x_axis.x + s.covariance.y_axis.y;
            for k in 0..3 {
                assert_twist("Σ", i, &got.covariance[k], &expected.covariance[k], size);
                assert_twist("colour", i, &got.rgb[k], &expected.rgb[k], 1e-2);
            }
            assert_twist("ln α", i, &got.ln_alpha, &expected.ln_alpha, 1.0);
        }
    }
}

#[test]
fn depth_order() {
    let prior = random_prior(53, 9_000, 0);
    let stages = run(&prior, &camera(96, 64), &random_pose(53), ROOM);
    let key = |i: u32| match stages.tile_counts[i as usize] {
        0 => CULLED,
        _ => stages.records[i as usize][11].to_bits(),
    };
    let splats: Vec<u32> = (0..prior.len() as u32).collect();
    let keys: Vec<u32> = splats.iter().map(|i| key(*i)).collect();
    let expected = radix::sort(&keys, &splats);
    assert!((stages.depth_keys, stages.order) == expected, "order by depth, ties by index");
}

/// The pairs as emitted: the splats in depth order, each with tiles of which none is missing that
/// shows the splat, none is named twice, and few are in vain.
fn assert_bins(prior: &Prior, camera: &Camera, pose: &Pose) {
    let stages = run(prior, camera, pose, ROOM);
    assert!(stages.pairs_needed <= ROOM, "the room is enough");
    let pairs = bin::pair_splats(&stages.order, &stages.tile_counts);
    assert!(stages.pair_splats == pairs, "the splat of each pair");

    let tile_count = camera.width.div_ceil(TILE) * camera.height.div_ceil(TILE);
    let twin = Twin::new(prior);
    let view = twin.view(camera, pose);
    let (mut needed, mut spare) = (0, 0);
    let mut at = vec![0..0; prior.len()];
    let mut next = 0;
    for &splat in &stages.order {
        let count = stages.tile_counts[splat as usize] as usize;
        at[splat as usize] = next..next + count;
        next += count;
    }
    for s in twin.project(&view) {
        let tiles = &stages.pair_tiles[at[s.index as usize].clone()];
        let tiles: Vec<u32> = tiles.iter().copied().filter(|t| *t < tile_count).collect();
        assert!(tiles.is_sorted_by(|a, b| a < b), "tiles of splat {}: {tiles:?}", s.index);
        let must = bin::tiles(&view, &s, 1e-3);
        assert!(must.iter().all(|t| tiles.contains(t)), "splat {} misses a tile", s.index);
        needed += must.len();
        spare += tiles.len() - must.len();
    }
    assert!(needed > 1_000, "the scene is in view");
    assert!(spare * 10 <= needed, "{spare} pairs in vain over {needed}");
}

#[test]
fn binning() {
    for prior in priors() {
        assert_bins(&prior, &camera(96, 64), &random_pose(54));
        assert_bins(&prior, &camera(321, 77), &random_pose(55));
    }
    if let Some(prior) = common::reef_prior() {
        assert_bins(&prior, &common::REEF_CAMERA, &common::reef_pose());
    }
}

#[test]
fn pairs_by_tile_and_their_ranges() {
    for (width, height) in [(8, 8), (96, 64), (321, 77), (640, 360)] {
        let prior = random_prior(56, 3_000, 0);
        let stages = run(&prior, &camera(width, height), &random_pose(56), ROOM);
        let (tiles, splats) = radix::sort(&stages.pair_tiles, &stages.pair_splats);
        assert!(stages.sorted_tiles == tiles, "{width}×{height}: tiles");
        assert!(stages.sorted_splats == splats, "{width}×{height}: splats keep depth order");
        let count = width.div_ceil(TILE) * height.div_ceil(TILE);
        assert!(stages.ranges == ranges::ranges(&tiles, count), "{width}×{height}: ranges");
    }
}

#[test]
fn pairs_are_counted_over_many_blocks() {
    let engine = common::engine();
    let mut random = Random::new(59);
    // One block, 256 blocks and more: the scan takes 256 at a time.
    for count in [1, 1_023, 1_024, 1_025, 262_144, 262_145, 600_000] {
        let counts: Vec<u32> = (0..count).map(|_| (random.bits() % 90) as u32).collect();
        let (needed, begins) = probe::count_pairs(&engine, &counts).unwrap();
        assert_eq!(needed, counts.iter().sum::<u32>(), "{count} splats");
        let mut next = 0;
        for (block, begin) in counts.chunks(BIN_BLOCK as usize).zip(begins) {
            assert_eq!(begin, next, "{count} splats");
            next += block.iter().sum::<u32>();
        }
    }
    common::assert_silent(&engine);
}

#[test]
fn more_pairs_than_32_bits_count_are_told() {
    // As many tiles a splat as the largest picture has; the true sums wrap to less than the room.
    let tiles = (Camera::MAX_SIDE / TILE).pow(2);
    for count in [(1 << 32) / tiles as usize + 1, 400_000] {
        let counts = vec![tiles; count];
        let (needed, _) = probe::count_pairs(&common::engine(), &counts).unwrap();
        assert_eq!(needed, u32::MAX, "{count} splats");
    }
}

#[test]
fn too_little_room_is_told_and_not_overrun() {
    let prior = random_prior(57, 3_000, 0);
    let (camera, pose) = (camera(96, 64), random_pose(57));
    let whole = run(&prior, &camera, &pose, ROOM);
    let room = whole.pairs_needed / 3;
    let part = run(&prior, &camera, &pose, room);
    assert_eq!(part.pairs_needed, whole.pairs_needed);
    assert_eq!(part.pair_tiles, whole.pair_tiles[..room as usize]);
    assert_eq!(part.pair_splats, whole.pair_splats[..room as usize]);
}

#[test]
fn ties_in_depth_go_by_index() {
    let mut splats: Splats = random_splats(58, 600, 0);
    splats.positions.iter_mut().for_each(|p| p[2] = if p[0] > 0.0 { 3.0 } else { 4.0 });
    let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
    let stages = run(&prior, &camera(64, 64), &Pose::IDENTITY, ROOM);
    let ties = std::iter::zip(stages.depth_keys.windows(2), stages.order.windows(2));
    let ties: Vec<_> = ties.filter(|(keys, _)| keys[0] == keys[1]).collect();
    assert!(ties.len() > 300, "many depths are equal");
    assert!(ties.iter().all(|(_, order)| order[0] < order[1]));
}
