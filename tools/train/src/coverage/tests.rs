use nvsprior::RenderOptions;
use nvsprior::prior::Splats;

use super::*;

/// Of a prior of these splats.
fn covering_of(splats: &Splats, seeds: &[Pose], max: usize) -> Result<Covering, PriorError> {
    covering(&Prior::from_splats(splats.clone(), RenderOptions::INRIA)?, seeds, max)
}

/// Splats on a lattice of `u` and `v`, 0.1 apart.
fn patch(splats: &mut Splats, corner: [f32; 3], u: [f32; 3], v: [f32; 3], size: [i32; 2]) {
    for i in 0..size[0] {
        for j in 0..size[1] {
            let along = |k: usize| 0.1 * (u[k] * i as f32 + v[k] * j as f32);
            splats.positions.push(std::array::from_fn(|k| corner[k] + along(k)));
            splats.log_scales.push([-3.0; 3]);
            splats.rotations.push([1.0, 0.0, 0.0, 0.0]);
            splats.opacity_logits.push(3.0);
            splats.sh.extend([0.0; 3]);
        }
    }
}

const X: [f32; 3] = [1.0, 0.0, 0.0];
const Y: [f32; 3] = [0.0, 1.0, 0.0];
const Z: [f32; 3] = [0.0, 0.0, 1.0];

/// The sides of a block, |x|, |y| ≤ 1 and 0 ≤ z ≤ 2, and its lid.
fn block(splats: &mut Splats) {
    for (corner, u) in [
        ([-1.0, -1.0, 0.0], X),
        ([-1.0, 1.0, 0.0], X),
        ([-1.0, -1.0, 0.0], Y),
        ([1.0, -1.0, 0.0], Y),
    ] {
        patch(splats, corner, u, Z, [21, 21]);
    }
    patch(splats, [-1.0, -1.0, 2.0], X, Y, [21, 21]);
}

/// A block in the middle of an open basin, 10 × 10 × 4.
fn basin() -> Splats {
    let mut splats = Splats::default();
    block(&mut splats);
    patch(&mut splats, [-5.0, -5.0, 0.0], X, Y, [101, 101]);
    for (corner, u) in [
        ([-5.0, -5.0, 0.0], X),
        ([-5.0, 5.0, 0.0], X),
        ([-5.0, -5.0, 0.0], Y),
        ([5.0, -5.0, 0.0], Y),
    ] {
        patch(&mut splats, corner, u, Z, [101, 41]);
    }
    splats
}

/// A ring of cameras that look at the block; only the side x > 0 if `half`.
fn ring(half: bool) -> Vec<Pose> {
    let turn = |i: i32| f64::from(i) * std::f64::consts::TAU / 24.0;
    let pose = |i: i32| {
        let (sin, cos) = turn(i).sin_cos();
        looking(DVec3::new(3.5 * cos, 3.5 * sin, 1.0), DVec3::new(-cos, -sin, 0.0), DVec3::Z)
    };
    if half { (-5..=5).map(pose).collect() } else { (0..24).map(pose).collect() }
}

fn in_block(place: DVec3) -> bool {
    place.x.abs() < 1.0 && place.y.abs() < 1.0 && (0.0..2.0).contains(&place.z)
}

#[test]
fn seeds_are_kept_and_the_rest_is_covered_better_with_more() {
    let (splats, seeds) = (basin(), ring(false));
    let mut before = None;
    for max in [0, 24, 60, 200] {
        let covering = covering_of(&splats, &seeds, max).unwrap();
        let poses = covering.key_frames.poses();
        assert_eq!(poses[..24], seeds);
        assert_eq!((poses.len(), covering.added), (max.max(24), max.saturating_sub(24)));
        let share = covering.share().unwrap();
        assert!(before.is_none_or(|b| share > b || max == 24), "{max}: {share}");
        assert!(share > 0.0 && share < 1.0, "{max}: {share}");
        before = Some(share);
        assert_eq!(covering_of(&splats, &seeds, max).unwrap(), covering);
    }
}

/// What is called covered has a key frame near, by a count of its own.
#[test]
fn covered_views_have_a_key_frame_near() {
    let (splats, seeds) = (basin(), ring(false));
    let covering = covering_of(&splats, &seeds, 300).unwrap();
    let centres: Vec<DVec3> = seeds.iter().map(Pose::centre).collect();
    let grid = Grid::of(&splats, &centres).unwrap();
    let views = Views::of(&grid, &seeds);
    let keys = covering.key_frames.poses().iter().map(|p| (p.centre(), viewing_direction(p)));
    let keys: Vec<_> = keys.collect();
    let mut near = 0;
    for (view, depth) in views.depths.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
        let place = views.places[view / DIRECTIONS];
        let along = views.directions.all()[view % DIRECTIONS];
        let covers = |(centre, forward): &(DVec3, DVec3)| {
            centre.distance(place) < DISTANCE * f64::from(*depth)
                && forward.angle_between(along) < ANGLE
        };
        near += usize::from(keys.iter().any(covers));
    }
    assert_eq!(views.count, covering.views);
    // Those near by their own depth, but not by the key frame's, are not called covered.
    assert!(near >= covering.covered && covering.covered * 10 > near * 7, "{near} {covering:?}");
}

#[test]
fn all_is_covered_if_there_may_be_enough() {
    let covering = covering_of(&basin(), &ring(true), KeyFrames::MAX).unwrap();
    assert_eq!(covering.share(), Some(1.0));
    assert!(covering.added < covering.views / 10, "{} {}", covering.added, covering.views);
}

#[test]
fn only_what_the_seeds_saw_is_looked_at() {
    let seeds = ring(true);
    let covering = covering_of(&basin(), &seeds, 400).unwrap();
    assert_eq!(covering.added, 400 - seeds.len());
    for pose in covering.key_frames.poses() {
        let (centre, forward) = (pose.centre(), viewing_direction(pose));
        assert!(!in_block(centre), "{centre}");
        assert!(centre.x.abs() < 5.0 && centre.y.abs() < 5.0 && centre.z > 0.0, "{centre}");
        // The block's shadow, from the outermost cameras at (0.91, ±3.38) past its edges.
        let shadow = 1.0 - 1.25 * (-1.0 - centre.x);
        assert!(centre.x > -1.0 || centre.y.abs() > shadow - 0.3, "{centre}");
        // Nobody looked towards +x.
        assert!(forward.x < 0.87, "{forward}");
        assert!((pose.rotation.length() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn without_seeds_key_frames_stand_in_the_free_volume() {
    let covering = covering_of(&basin(), &[], 300).unwrap();
    assert_eq!((covering.key_frames.len(), covering.added), (300, 300));
    let half = covering.key_frames.poses().iter().filter(|p| p.centre().x > 0.0).count();
    assert!((60..240).contains(&half), "{half}");
    for pose in covering.key_frames.poses() {
        let centre = pose.centre();
        assert!(!in_block(centre), "{centre}");
        assert!(centre.abs().max_element() < 5.0 && centre.z > 0.0, "{centre}");
        // Upright, unless it looks up or down.
        let right = pose.rotation.conjugate() * DVec3::X;
        assert!(right.z.abs() < 1e-6 || viewing_direction(pose).z.abs() > 0.99);
    }
}

/// The unit of length does not matter.
#[test]
fn other_units_give_the_same_key_frames() {
    let (splats, seeds) = (basin(), ring(false));
    let covering = covering_of(&splats, &seeds, 100).unwrap();
    let mut large = splats;
    large.positions.iter_mut().flatten().for_each(|v| *v *= 1024.0);
    large.log_scales.iter_mut().flatten().for_each(|v| *v += 1024_f32.ln());
    let scaled = |p: &Pose| Pose { rotation: p.rotation, translation: 1024.0 * p.translation };
    let seeds: Vec<Pose> = seeds.iter().map(scaled).collect();
    let other = covering_of(&large, &seeds, 100).unwrap();
    let difference = other.share().unwrap() - covering.share().unwrap();
    assert!(difference.abs() < 0.01, "{difference}");
}

#[test]
fn extreme_priors_have_few_key_frames_or_none() {
    let change = |change: &dyn Fn(&mut Splats)| {
        let mut splats = basin();
        change(&mut splats);
        splats
    };
    let first: Vec<bool> = (0..basin().len()).map(|i| i == 0).collect();
    let one = basin().filtered(&first);
    let line = change(&|s| s.positions.iter_mut().for_each(|p| *p = [p[0], 0.0, 0.0]));
    let cases: Vec<(&str, Splats)> = vec![
        ("one", one),
        ("one place", change(&|s| s.positions.fill([7.0; 3]))),
        ("a line", line),
        ("faint", change(&|s| s.opacity_logits.fill(-4.0))),
        ("huge", change(&|s| s.log_scales.fill([40.0; 3]))),
        ("needles", change(&|s| s.log_scales.fill([40.0, -40.0, -40.0]))),
        ("points", change(&|s| s.log_scales.fill([-40.0; 3]))),
        ("far", change(&|s| s.positions.iter_mut().flatten().for_each(|v| *v *= 1e30))),
        ("farther", change(&|s| s.positions.iter_mut().flatten().for_each(|v| *v *= 6e37))),
        ("small", change(&|s| s.positions.iter_mut().flatten().for_each(|v| *v *= 1e-38))),
        ("aside", change(&|s| s.positions.iter_mut().flatten().for_each(|v| *v += 1e7))),
        ("a stray", change(&|s| s.positions[0] = [1e30, -1e30, f32::MAX])),
        ("half", change(&|s| s.positions.iter_mut().step_by(2).for_each(|p| *p = [f32::MAX; 3]))),
    ];
    let mut seeds = ring(true);
    seeds.push(looking(DVec3::splat(1e30), DVec3::X, DVec3::Z));
    for (name, splats) in cases {
        for seeds in [&[][..], &seeds] {
            let covering = covering_of(&splats, seeds, 50).unwrap();
            assert_eq!(covering.key_frames.poses()[..seeds.len()], *seeds);
            assert!(covering.key_frames.len() <= 50 && covering.covered <= covering.views);
            if ["one", "one place", "faint", "huge"].contains(&name) {
                assert_eq!((covering.added, covering.share()), (0, None), "{name}");
            }
        }
    }
}

#[test]
fn what_is_no_pose_is_refused() {
    let mut seeds = ring(false);
    seeds[3].translation.x = f64::NAN;
    let refused = covering_of(&basin(), &seeds, 50);
    assert!(matches!(refused, Err(PriorError::KeyFrame { index: 3, .. })));
}
