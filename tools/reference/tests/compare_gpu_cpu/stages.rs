//! Single stages against their twins: projection, derivatives, depth order, binning.

use nvsprior::prior::Splats;
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::shared::{CULLED, NOWHERE};
use nvsprior_reference::pose_jacobian::{Motion, derive};
use nvsprior_reference::probe::{Probe, SortPrecision, Stages};
use nvsprior_reference::project::Projected;
use nvsprior_reference::{Twin, Twist, bin, radix};

use crate::common::{self, Random, camera, random_pose, random_prior, random_splats};

/// Room that no scene here exceeds.
const ROOM: u32 = 1 << 20;

fn run(prior: &Prior, camera: &Camera, pose: &Pose, room: u32) -> Stages {
    let engine = common::engine();
    let scene = engine.upload(prior).unwrap();
    let stages =
        Probe::of(&engine).stages(&scene, camera, pose, room, SortPrecision::Exact).unwrap();
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
    let [u, v, l11, l21, l22, log_opacity, sigma_x, sigma_y, r, g, b, z] = *record;
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
    close("opacity", log_opacity.exp2(), s.opacity, 1e-4 * s.opacity);
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
        let drawn = seen.iter().filter(|s| stages.keys[s.index as usize] != CULLED);
        assert!(drawn.clone().count() > 500, "the scene is in view");
        drawn.for_each(|s| assert_record(&stages.records[s.index as usize], s));
    }
}

/// What stage `pose_jacobian` keeps of a covariance's change: `L dΣ Lᵀ`, with the conic's factor L.
fn whitened(s: &Projected, [s00, s01, s11]: [Twist; 3]) -> [Twist; 3] {
    let [l11, l21, l22] = s.factor;
    let each =
        |f: &dyn Fn(f64, f64, f64) -> f64| std::array::from_fn(|k| f(s00[k], s01[k], s11[k]));
    [
        each(&|a, b, c| l11 * l11 * a + 2.0 * l11 * l21 * b + l21 * l21 * c),
        each(&|_, b, c| l22 * (l11 * b + l21 * c)),
        each(&|_, _, c| l22 * l22 * c),
    ]
}

/// The derivatives of one splat as stage `pose_jacobian` lays them out; `covariance` is [`whitened`].
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
        for s in seen.iter().filter(|s| stages.keys[s.index as usize] != CULLED) {
            let i = s.index;
            let got = motion_of(&stages.derivatives[i as usize]);
            let expected = derive(&view, &twin.splats()[i as usize], s);
            for k in 0..2 {
                assert_twist("mean", i, &got.mean[k], &expected.mean[k], 0.0);
            }
            let changes = whitened(s, expected.covariance);
            for (k, change) in changes.iter().enumerate() {
                assert_twist("Σ", i, &got.covariance[k], change, 1.0);
                assert_twist("colour", i, &got.rgb[k], &expected.rgb[k], 1e-2);
            }
            assert_twist("ln α", i, &got.ln_alpha, &expected.ln_alpha, 1.0);
        }
    }
}

#[test]
fn the_splat_beyond_the_last_shows_nothing() {
    let prior = random_prior(60, 511, 1);
    let stages = run(&prior, &camera(96, 64), &random_pose(60), ROOM);
    let mut nothing = [0.0; 12];
    (nothing[5], nothing[11]) = (NOWHERE, 1.0);
    assert_eq!(stages.records[511], nothing, "no opacity, and a depth that can be divided by");
    assert_eq!(stages.derivatives[511], [0.0; 48]);
}

#[test]
fn depth_order() {
    let prior = random_prior(53, 9_000, 0);
    let stages = run(&prior, &camera(96, 64), &random_pose(53), ROOM);
    let near = prior.options().near.to_bits();
    for (i, key) in stages.keys.iter().enumerate().filter(|(_, key)| **key != CULLED) {
        assert_eq!(*key, stages.records[i][11].to_bits() - near, "key of splat {i}");
    }
    let splats: Vec<u32> = (0..prior.len() as u32).collect();
    let (_, order) = radix::sort_visible(&stages.keys, &splats);
    assert!(stages.order == order, "order by depth, ties by index");
    assert!((1_000..8_000).contains(&order.len()), "some are in view, some are not");
}

/// Each splat's tiles, row-major, from the tiles' lists, which must follow each other without a gap.
fn tiles_of(stages: &Stages) -> Vec<Vec<u32>> {
    let mut tiles = vec![Vec::new(); stages.records.len()];
    let mut end = 0;
    for (tile, range) in stages.ranges.iter().enumerate() {
        assert_eq!(range[0], end, "list of tile {tile}");
        end = range[1];
        for splat in &stages.pair_splats[range[0] as usize..end as usize] {
            tiles[*splat as usize].push(tile as u32);
        }
    }
    assert_eq!(end, stages.pairs_needed, "the lists hold all pairs");
    tiles
}

/// Checks the tiles' lists: they are in depth order; every tile that shows a splat has it, no tile has it twice, and
/// few have it without need.
fn assert_bins(prior: &Prior, camera: &Camera, pose: &Pose) {
    let stages = run(prior, camera, pose, ROOM);
    assert!(stages.pairs_needed <= ROOM, "the room is enough");
    let mut place = vec![u32::MAX; stages.records.len()];
    for (i, splat) in (0..).zip(&stages.order) {
        place[*splat as usize] = i;
    }
    for (tile, range) in stages.ranges.iter().enumerate() {
        let list = &stages.pair_splats[range[0] as usize..range[1] as usize];
        let sorted = list.is_sorted_by(|a, b| place[*a as usize] < place[*b as usize]);
        assert!(sorted, "tile {tile} is in depth order");
    }

    let tiles = tiles_of(&stages);
    let twin = Twin::new(prior);
    let view = twin.view(camera, pose);
    let (mut needed, mut spare) = (0, 0);
    for s in twin.project(&view) {
        let tiles = &tiles[s.index as usize];
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
fn binning_of_any_size() {
    // From one tile to several bands of them, and rows as long as a band.
    for (width, height) in [(8, 8), (640, 360), (1_280, 720), (2_048, 72), (4_096, 96)] {
        assert_bins(&random_prior(56, 3_000, 0), &camera(width, height), &random_pose(56));
    }
}

#[test]
fn lists_begin_where_those_before_end() {
    let engine = common::engine();
    let mut random = Random::new(59);
    for (tiles, blocks) in [(1, 4), (7, 16), (920, 16), (31, 128), (2_048, 8)] {
        let counts: Vec<u32> = (0..tiles * blocks).map(|_| (random.bits() % 90) as u32).collect();
        let got = Probe::of(&engine).scan_tiles(tiles as u32, &counts).unwrap();
        assert_eq!(got.pairs, counts.iter().sum::<u32>(), "{blocks} blocks, {tiles} tiles");
        assert_eq!(got.starts, bin::starts(&counts, tiles), "{blocks} blocks, {tiles} tiles");
    }
    common::assert_silent(&engine);
}

#[test]
fn more_pairs_than_32_bits_count_are_told() {
    // The true sums wrap to less: over tiles, over blocks, and over both.
    for (tiles, blocks, each) in [(9, 4, 1 << 29), (1, 16, 1 << 28), (40, 4, u32::MAX / 3)] {
        let counts = vec![each; tiles * blocks];
        let got = Probe::of(&common::engine()).scan_tiles(tiles as u32, &counts).unwrap();
        assert_eq!(got.pairs, u32::MAX, "{tiles} tiles, {blocks} blocks of {each}");
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
    let cut = |range: &[u32; 2]| range.map(|place| place.min(room));
    assert_eq!(part.ranges, whole.ranges.iter().map(cut).collect::<Vec<_>>());
    assert_eq!(part.pair_splats, whole.pair_splats[..room as usize]);
}

#[test]
fn ties_in_depth_go_by_index() {
    let mut splats: Splats = random_splats(58, 600, 0);
    splats.positions.iter_mut().for_each(|p| p[2] = if p[0] > 0.0 { 3.0 } else { 4.0 });
    let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
    let stages = run(&prior, &camera(64, 64), &Pose::IDENTITY, ROOM);
    let tie = |order: &&[u32]| stages.keys[order[0] as usize] == stages.keys[order[1] as usize];
    let ties: Vec<_> = stages.order.windows(2).filter(tie).collect();
    assert!(ties.len() > 300, "many depths are equal");
    assert!(ties.iter().all(|order| order[0] < order[1]));
}
