use glam::DQuat;
use proptest::prelude::*;

use super::*;

/// Key frames of a winding run, `count` of them.
pub(crate) fn sample_key_frames(count: usize) -> KeyFrames {
    let pose = |i: usize| {
        let t = i as f64;
        let step = [0.3 * t, -0.2, 0.1 * t, 0.21 * t, -0.13 * t, 0.05 * t];
        Pose::IDENTITY.stepped(&step)
    };
    KeyFrames::new((0..count).map(pose).collect()).unwrap()
}

/// A pose at a place, turned about the camera's axes in this order: x, y, then the optical axis.
fn posed(centre: [f64; 3], [x, y, roll]: [f64; 3]) -> Pose {
    let turn = DQuat::from_rotation_z(roll) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x);
    Pose::from_centre(turn, centre.into())
}

#[test]
fn poses_that_are_none_are_named() {
    let refused = |change: fn(&mut Pose)| {
        let mut poses = sample_key_frames(5).poses().to_vec();
        change(&mut poses[3]);
        let thinned = KeyFrames::thinned(&poses, 0.0, 0.0).unwrap_err();
        assert!(matches!(thinned, PriorError::KeyFrame { index: 3, .. }), "{thinned}");
        KeyFrames::new(poses).unwrap_err().to_string()
    };
    for (change, reason) in [
        ((|p| p.translation.y = f64::NAN) as fn(&mut Pose), "not finite"),
        (|p| p.rotation.x = f64::INFINITY, "not finite"),
        (|p| p.rotation *= 1.01, "the length 1"),
        (|p| p.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), "the length 1"),
        (|p| p.translation *= 1e39, "farther"),
        (|p| p.translation *= 1e308, "farther"),
    ] {
        let error = refused(change);
        assert!(error.starts_with("key frame 3: ") && error.contains(reason), "{error}");
    }
    let many = vec![Pose::IDENTITY; KeyFrames::MAX + 1];
    let error = KeyFrames::new(many.clone()).unwrap_err();
    assert!(matches!(error, PriorError::TooManyKeyFrames { count: 65_537 }), "{error}");
    assert_eq!(KeyFrames::new(many[1..].to_vec()).unwrap().len(), KeyFrames::MAX);
    assert_eq!(KeyFrames::thinned(&many, 1.0, 1.0).unwrap().len(), 1);
}

#[test]
fn roll_is_no_other_view_but_turning_away_is() {
    let here = [1.0, -2.0, 3.0];
    let poses = [
        posed(here, [0.0, 0.0, 0.0]),
        posed(here, [0.0, 0.0, 3.0]),             // Rolled: left out.
        posed(here, [0.0, 0.3, 0.0]),             // Looks elsewhere.
        posed(here, [0.1, 0.3, -1.0]),            // Near the one before.
        posed([1.0, -2.0, 4.0], [0.0, 0.0, 0.0]), // Stands elsewhere.
        posed([1.0, -2.0, 3.4], [0.0, 0.0, 2.0]), // Near the first.
    ];
    let kept = |distance, angle| KeyFrames::thinned(&poses, distance, angle).unwrap().poses;
    assert_eq!(kept(0.5, 0.2), [poses[0], poses[2], poses[4]]);
    assert_eq!(kept(0.0, 0.2), poses);
    assert_eq!(kept(0.5, 0.0), poses);
    assert_eq!(kept(f64::NAN, 1.0), poses);
    assert_eq!(kept(f64::INFINITY, 4.0), poses[..1]);
}

#[test]
fn bounds_hold_all_cameras() {
    assert_eq!(KeyFrames::NONE.bounds(), None);
    let poses = vec![posed([1.0, -2.0, 3.0], [0.1, 0.2, 0.3]), posed([0.0, 5.0, 3.0], [0.0; 3])];
    let [min, max] = KeyFrames::new(poses).unwrap().bounds().unwrap();
    assert!(min.distance(DVec3::new(0.0, -2.0, 3.0)) < 1e-12, "{min}");
    assert!(max.distance(DVec3::new(1.0, 5.0, 3.0)) < 1e-12, "{max}");
}

#[test]
fn words_that_are_no_pose_are_told_why() {
    for (text, reason) in [
        ("1 0 0 0 1 2", "fewer than 7 numbers"),
        ("1 0 0 0 1 2 3 4", "more than 7 numbers"),
        ("1 0 x1 0 1 2 3", "qy is no number: \"x1\""),
        ("0 0 0 0 1 2 3", "no pose"),
        ("nan 0 0 0 1 2 3", "no pose"),
        ("1 0 0 0 1 inf 3", "no pose"),
        ("1 0 0 0 1e400 2 3", "no pose"),
    ] {
        let words: Vec<&str> = text.split(' ').collect();
        let error = pose_from_words(&words).unwrap_err();
        assert!(error.contains(reason), "{text}: {error}");
    }
    let longer = pose_from_words(&["2", "0", "0", "0", "1", "2", "3"]).unwrap();
    assert_eq!(longer, posed([-1.0, -2.0, -3.0], [0.0; 3]));
}

/// Any pose that a key frame may be.
fn any_pose() -> impl Strategy<Value = Pose> {
    let rotation = proptest::array::uniform4(-1.0..1.0_f64);
    let translation = proptest::array::uniform3(-1.0..1.0_f64);
    (rotation, translation, -300..30_i32).prop_filter_map("a pose", |(q, t, exponent)| {
        Pose::from_wxyz(q, t.map(|v| v * 10_f64.powi(exponent)))
    })
}

proptest! {
    #[test]
    fn text_gives_back_every_bit(pose in any_pose()) {
        let words = words(&pose);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        prop_assert_eq!(pose_from_words(&words).unwrap(), pose);
    }

    #[test]
    fn thinning_leaves_no_view_without_a_near_one(
        steps in proptest::collection::vec(proptest::array::uniform6(-0.3..0.3_f64), 1..60),
        distance in 0.1..2.0_f64,
        angle in 0.1..2.0_f64,
    ) {
        let mut pose = Pose::IDENTITY;
        let poses: Vec<Pose> = steps.iter().map(|step| { pose = pose.stepped(step); pose }).collect();
        let kept = KeyFrames::thinned(&poses, distance, angle).unwrap();
        let near = |a: &Pose, b: &Pose| {
            let turned = viewing_direction(a).angle_between(viewing_direction(b));
            a.centre().distance(b.centre()) < distance + 1e-9 && turned < angle + 1e-6
        };
        for pose in &poses {
            prop_assert!(kept.poses().iter().any(|k| near(pose, k)));
        }
        for (i, a) in kept.poses().iter().enumerate() {
            prop_assert!(poses.contains(a));
            for b in &kept.poses()[..i] {
                let turned = viewing_direction(a).angle_between(viewing_direction(b));
                let apart = a.centre().distance(b.centre()) > distance - 1e-9;
                prop_assert!(apart || turned > angle - 1e-6);
            }
        }
    }
}
