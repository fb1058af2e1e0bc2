//! The search against f64: steps, codes, and whole searches in a synthetic valley.

use bytemuck::Zeroable;
use glam::DVec3;

use nvsprior::Pose;
use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::prior::CoordinateFrame;
use nvsprior_kernels::search::{
    Anchor, COMPACT, PAPER, Placement, Program, SEARCHING, SQUARE, STARTS, STOP_NO_DESCENT,
    STOP_RENDERS, Search, advance, begin, damped_step, placed, quantised, stepped, upper,
};
use nvsprior_kernels::shared::SUMS;

/// The six rows of a Jacobian, its columns scaled.
fn rows(scale: [f64; 6]) -> [[f64; 6]; 6] {
    let rows = [
        [1.0, 0.2, -0.3, 0.5, 0.1, 0.0],
        [0.0, 1.5, 0.4, -0.2, 0.3, 0.1],
        [0.3, -0.1, 0.8, 0.2, -0.6, 0.9],
        [0.1, 0.4, 0.2, 1.1, 0.0, -0.5],
        [-0.2, 0.3, 0.1, 0.4, 0.9, 0.2],
        [0.6, -0.4, 0.1, 0.0, 0.2, 1.3],
    ];
    rows.map(|row| std::array::from_fn(|k| row[k] * scale[k]))
}

/// Sums of six residuals.
fn sums(rows: &[[f64; 6]; 6], residuals: [f64; 6]) -> [f32; SUMS as usize] {
    let mut out = [0.0; SUMS as usize];
    let of = |f: &dyn Fn(usize) -> f64| (0..6).map(f).sum::<f64>() as f32;
    for i in 0..6 {
        for j in i..6 {
            out[upper(i, j)] = of(&|r| rows[r][i] * rows[r][j]);
        }
        out[21 + i] = of(&|r| rows[r][i] * residuals[r]);
    }
    out[SQUARE] = of(&|r| residuals[r] * residuals[r]);
    out
}

const RESIDUALS: [f64; 6] = [0.3, -0.2, 0.5, 0.1, -0.4, 0.2];

#[test]
fn an_undamped_step_solves_a_linear_problem() {
    let jacobian = rows([1.0; 6]);
    let s = sums(&jacobian, RESIDUALS);
    let step = damped_step(&s, 0.0);
    assert!(step.downhill);
    for (row, residual) in jacobian.iter().zip(RESIDUALS) {
        let left: f64 = row.iter().zip(step.tau).map(|(j, t)| j * f64::from(t)).sum();
        assert!((left + residual).abs() < 1e-5, "six rows, six unknowns: {left} {residual}");
    }
    assert!((step.expected - s[SQUARE]).abs() < 1e-5, "{step:?}");
}

#[test]
fn a_step_does_not_depend_on_units() {
    let units = [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0];
    let a = damped_step(&sums(&rows([1.0; 6]), RESIDUALS), 0.1);
    let b = damped_step(&sums(&rows(units), RESIDUALS), 0.1);
    assert!((a.expected - b.expected).abs() < 1e-5);
    for ((a, b), unit) in a.tau.iter().zip(b.tau).zip(units) {
        assert!((f64::from(*a) - f64::from(b) * unit).abs() < 1e-5, "{a} {b} {unit}");
    }
}

#[test]
fn what_the_picture_does_not_determine_gets_no_step() {
    let step = damped_step(&sums(&rows([1.0, 0.0, 1.0, 1.0, 0.0, 1.0]), RESIDUALS), 1e-3);
    assert_eq!((step.tau[1], step.tau[4]), (0.0, 0.0));
    assert!(step.downhill);
    assert!(!damped_step(&sums(&rows([0.0; 6]), RESIDUALS), 1e-3).downhill);
    let mut broken = sums(&rows([1.0; 6]), RESIDUALS);
    broken[3] = f32::NAN;
    assert!(!damped_step(&broken, 1e-3).downhill);
}

fn placement(pose: &Pose) -> Placement {
    Placement {
        rotation: pose.wxyz().map(|v| v as f32),
        translation: pose.translation.to_array().map(|v| v as f32),
    }
}

fn pose(p: &Placement) -> Pose {
    Pose::from_wxyz(p.rotation.map(f64::from), p.translation.map(f64::from)).unwrap()
}

fn assert_close(found: &Pose, expected: &Pose, tolerance: f64) {
    let angle = found.angle_to(expected);
    let distance = (found.translation - expected.translation).length();
    assert!(angle < tolerance && distance < tolerance, "{angle} rad, {distance} units");
}

fn some_pose() -> Pose {
    Pose::from_wxyz([0.5, -0.3, 0.7, 0.4], [1.0, -2.0, 3.0]).unwrap()
}

#[test]
fn steps_are_those_of_the_exponential_map() {
    for size in [0.0, 1e-6, 1e-3, 0.1, 0.55] {
        let tau = [0.3, -0.2, 0.5, 0.7, -1.1, 0.4].map(|v| v * size);
        let stepped = stepped(&placement(&some_pose()), &tau.map(|v| v as f32));
        assert_close(&pose(&stepped), &some_pose().stepped(&tau), 2e-6);
    }
}

#[test]
fn a_wild_step_is_shortened() {
    let tau = [3.0, 0.0, 0.0, 0.0, 30.0, 0.0];
    let stepped = stepped(&placement(&some_pose()), &tau);
    let short = some_pose().stepped(&tau.map(|v| f64::from(v) / 30.0));
    assert_close(&pose(&stepped), &short, 2e-6);
}

/// The device's codes against those of the packet, about a prior at the origin.
#[test]
fn codes_are_those_of_packets() {
    let frame = CoordinateFrame { centre: [0.0; 3], spread: 1.7 };
    let anchor = Anchor { centre: frame.centre, step: frame.step() as f32 };
    for turn in 0..40 {
        let t = f64::from(turn);
        let at = some_pose().stepped(&[0.1 * t, 0.2, -0.3 * t, 0.31 * t, 0.17 * t, -0.05 * t]);
        for profile in [PoseProfile::Compact, PoseProfile::Free, PoseProfile::Short] {
            let code = quantised(&placement(&at), &anchor, profile.word());
            let short = profile == PoseProfile::Short;
            let placed = pose(&placed(&code, &anchor));
            // Half a step per axis of rotation, some units from the camera.
            assert_close(&placed, &at, if short { 2e-3 } else { 1e-4 });
            let of_packet = QuantisedPose::of_words(&code).unwrap();
            assert_eq!(of_packet.words(), code);
            assert_eq!(of_packet.is_short(), short);
            assert_eq!(of_packet.profile(), if short { PoseProfile::Compact } else { profile });
            if short {
                let host = QuantisedPose::quantise(&at, &frame, profile).unwrap().words();
                let off = std::iter::zip(host.words, code.words).map(|(a, b)| (a - b).abs());
                assert!(off.max() <= Some(32), "one step, as f32 may round the other way");
            }
            let rounding = 4.0 * f64::from(f32::EPSILON) * (1.0 + at.translation.length());
            assert_close(&placed, &of_packet.dequantise(&frame), rounding);
        }
    }
}

#[test]
fn a_centre_beyond_reach_takes_the_long_code() {
    let anchor = Anchor { centre: [0.0; 3], step: 1e-6 };
    let code = quantised(&placement(&some_pose()), &anchor, COMPACT);
    assert_eq!(code.profile, COMPACT);
    let far = Pose { translation: some_pose().translation * 1e3, ..some_pose() };
    let code = quantised(&placement(&far), &anchor, COMPACT);
    assert_eq!(code.profile, PAPER);
    assert_close(&pose(&placed(&code, &anchor)), &far, 1e-3);
}

/// A search ends if a step promises less than 1e-4 of 0.01. The residuals are then below 1e-3, and the Jacobian's least
/// singular value is about 0.5.
const NEAR: f64 = 3e-3;

/// A valley: the residuals are the twist from `target`, through a Jacobian, and one residual that nothing lowers.
struct Valley {
    target: Pose,
    floor: f64,
}

impl Valley {
    fn at(&self, place: &Placement) -> [f32; SUMS as usize] {
        // To first order: enough for Gauss–Newton to find its way.
        let between = pose(place).after(&self.target.inverse());
        let q = between.rotation;
        let theta = q.xyz() * 2.0 * q.w.signum();
        let t = between.translation;
        let twist = [t.x, t.y, t.z, theta.x, theta.y, theta.z];
        let jacobian = rows([1.0; 6]);
        let residuals = jacobian.map(|row| row.iter().zip(twist).map(|(j, t)| j * t).sum());
        let mut out = sums(&jacobian, residuals);
        out[SQUARE] += self.floor as f32;
        out
    }
}

fn program(starts: &[Pose]) -> Program {
    let mut placements = [Placement::default(); STARTS];
    for (to, start) in placements.iter_mut().zip(starts) {
        *to = placement(start);
    }
    Program {
        starts: placements,
        count: starts.len() as u32,
        first_level: 3,
        follow_level: 2,
        levels: 0b1111,
        sparse: 0,
        follow_renders: 4,
        coarse_renders: 4,
        renders: 4,
        near: 1.0,
        far_level: 0,
        coarse_leap: 0.0,
        leap: 0.0,
        coarse_tolerance: 1e-3,
        tolerance: 1e-4,
        damping: 1e-3,
        profile: COMPACT,
    }
}

/// Runs a search to its end; the poses that it evaluated, with their levels.
fn run(
    program: Program,
    evaluate: impl Fn(&Placement, u32) -> [f32; SUMS as usize],
) -> (Search, Vec<(Placement, u32)>) {
    let mut search = Search { program, ..Search::zeroed() };
    let mut visited = Vec::new();
    begin(&mut search);
    while search.phase == SEARCHING {
        visited.push((search.trial, search.level));
        search.sums = evaluate(&search.trial, search.level);
        advance(&mut search);
        assert!(visited.len() < 1000, "a search ends");
    }
    (search, visited)
}

#[test]
fn a_search_goes_down_the_pyramid_to_the_optimum() {
    let valley = Valley { target: some_pose(), floor: 0.01 };
    let start = some_pose().stepped(&[0.2, -0.1, 0.15, 0.1, -0.2, 0.1]);
    let (search, visited) = run(program(&[start]), |place, _| valley.at(place));
    assert_close(&pose(&search.found), &valley.target, NEAR);
    assert!(visited.windows(2).all(|w| w[1].1 <= w[0].1), "{visited:?}");
    assert_eq!(search.evaluations as usize, visited.len());
    assert_eq!(search.by_level.iter().sum::<u32>(), search.evaluations);
    assert!((0..4).all(|level| search.by_level[level] > 0));
}

#[test]
fn levels_that_are_not_wanted_are_skipped() {
    let valley = Valley { target: some_pose(), floor: 0.01 };
    let program = Program { levels: 0b0100, ..program(&[some_pose()]) };
    let (search, _) = run(program, |place, _| valley.at(place));
    assert_eq!(search.by_level[1], 0);
    assert!(search.by_level[0] > 0 && search.by_level[2] > 0);
}

#[test]
fn the_best_of_some_starts_goes_on() {
    let valley = Valley { target: some_pose(), floor: 0.01 };
    let near = some_pose().stepped(&[0.01, 0.0, 0.0, 0.0, 0.01, 0.0]);
    let far = some_pose().stepped(&[0.5, 0.2, 0.0, 0.0, 0.4, 0.0]);
    let scored = Program { follow_renders: 1, ..program(&[far, near, far]) };
    let (search, _) = run(scored, |place, _| valley.at(place));
    assert_eq!(search.best_start, 1);
    assert_close(&pose(&search.found), &valley.target, NEAR);
}

/// An objective that no step lowers: what is found is the start.
#[test]
fn nothing_found_is_the_start() {
    let start = placement(&some_pose());
    let worse_elsewhere = |place: &Placement, _| {
        let mut s = sums(&rows([1.0; 6]), RESIDUALS);
        if *place != start {
            s[SQUARE] *= 2.0;
        }
        s
    };
    let (search, visited) = run(program(&[some_pose()]), worse_elsewhere);
    assert_eq!(search.found, start);
    assert_eq!(search.stop, STOP_RENDERS);
    assert!(visited.len() <= 4 * 5);
}

/// A search never steps to sums that are no numbers, and does not hang on them.
#[test]
fn what_is_no_number_is_no_place() {
    let start = placement(&some_pose());
    let broken_elsewhere = |place: &Placement, _| {
        let mut s = sums(&rows([1.0; 6]), RESIDUALS);
        if *place != start {
            s[7] = f32::NAN;
            s[SQUARE] = 0.0;
        }
        s
    };
    let (search, _) = run(program(&[some_pose()]), broken_elsewhere);
    assert_eq!(search.found, start);
    let (search, _) = run(program(&[some_pose()]), |_, _| [f32::INFINITY; SUMS as usize]);
    assert_eq!((search.found, search.stop), (start, STOP_NO_DESCENT));
}

/// A step that promises little is taken without an evaluation. A step that promises much is evaluated first.
#[test]
fn small_steps_are_taken_unseen() {
    let valley = Valley { target: some_pose(), floor: 0.01 };
    let near = some_pose().stepped(&[0.01, 0.0, 0.0, 0.0, 0.01, 0.0]);
    let far = some_pose().stepped(&[0.1, 0.0, 0.0, 0.0, 0.1, 0.0]);
    let at_once = |start| {
        let levels =
            Program { first_level: 0, follow_level: 0, follow_renders: 1, ..program(&[start]) };
        run(Program { leap: 0.2, ..levels }, |place, _| valley.at(place))
    };
    let (search, visited) = at_once(near);
    assert_eq!(visited.len(), 1);
    assert_close(&pose(&search.found), &valley.target, NEAR);
    let (search, visited) = at_once(far);
    assert!(visited.len() > 1);
    assert_close(&pose(&search.found), &valley.target, NEAR);
}

/// If a start at the full picture turns out to be far off, the search uses the coarse levels after all.
#[test]
fn far_starts_take_the_long_way() {
    let valley = Valley { target: some_pose(), floor: 0.01 };
    let far = some_pose().stepped(&[0.2, -0.1, 0.15, 0.1, -0.2, 0.1]);
    let near = some_pose().stepped(&[0.001, 0.0, 0.0, 0.0, 0.001, 0.0]);
    for (start, coarse) in [(far, true), (near, false)] {
        let levels =
            Program { first_level: 0, follow_level: 0, follow_renders: 1, ..program(&[start]) };
        let adaptive = Program { near: 0.2, far_level: 2, ..levels };
        let (search, visited) = run(adaptive, |place, _| valley.at(place));
        assert_eq!(visited[0].1, 0);
        assert_eq!(search.by_level[2] > 0, coarse, "{visited:?}");
        let levels = visited[1..].windows(2);
        assert!(levels.clone().all(|w| w[1].1 <= w[0].1), "only once: {visited:?}");
        assert_close(&pose(&search.found), &valley.target, NEAR);
    }
}

/// A picture that hardly reacts to one axis, and reacts to translations as a far scene does. The
/// step stays within the scene, in any unit.
#[test]
fn steps_stay_within_the_scene() {
    for unit in [1e-3, 1.0, 1e3] {
        // A turn by one radian shifts the picture as much as a move by 1000 of the prior's units, times `unit`.
        let far = [1e-3 / unit, 1e-3 / unit, 1e-8 / unit, 1.0, 1.0, 1.0];
        let step = damped_step(&sums(&rows(far), [30.0, -20.0, 50.0, 10.0, -40.0, 20.0]), 1e-5);
        assert!(step.downhill);
        let [x, y, z, a, b, c] = step.tau.map(f64::from);
        let moved = DVec3::new(x, y, z).length() / (1e3 * unit);
        let turned = DVec3::new(a, b, c).length();
        assert!(moved < 2.0 && turned < 1.001, "{moved} depths, {turned} rad");
        assert!(moved > 0.1 || turned > 0.1, "{moved} depths, {turned} rad");
    }
}

/// A shortened step promises what it then brings.
#[test]
fn a_shortened_step_promises_less() {
    let residuals = [30.0, -20.0, 50.0, 10.0, -40.0, 20.0];
    let jacobian = rows([1.0; 6]);
    let step = damped_step(&sums(&jacobian, residuals), 1e-3);
    let square = |tau: [f64; 6]| -> f64 {
        let after = jacobian.iter().zip(residuals);
        let residual =
            |(row, r): (&[f64; 6], f64)| r + row.iter().zip(tau).map(|(j, t)| j * t).sum::<f64>();
        after.map(|pair| residual(pair).powi(2)).sum()
    };
    let lowered = square([0.0; 6]) - square(step.tau.map(f64::from));
    let expected = f64::from(step.expected);
    assert!((lowered / expected - 1.0).abs() < 1e-3, "{lowered} {expected}");
}
