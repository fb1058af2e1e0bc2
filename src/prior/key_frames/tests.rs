use glam::DQuat;
use proptest::prelude::*;

use super::super::tests::sample_splats;
use super::super::{PartSource, Prior, RenderOptions, RenderOverrides};
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
fn what_is_no_file_of_key_frames_is_refused_by_line() {
    let header = "qw,qx,qy,qz,tx,ty,tz\n";
    let pose = "1,0,0,0,1,2,3\n";
    for (text, line, reason) in [
        (String::new(), 1, "must be qw,qx"),
        ("qw,qx\n".into(), 1, "must be qw,qx"),
        (pose.into(), 1, "must be qw,qx"),
        (format!("{header}{pose}1,0,0,0,1,2\n"), 3, "fewer than 7 numbers"),
        (format!("{header}{pose}1,0,0,0,1,2,3,4\n"), 3, "more than 7 numbers"),
        (format!("{header}\n{pose}"), 2, "fewer than 7"),
        (format!("{header}{pose}\n"), 3, "fewer than 7"),
        (format!("{header}1,0,0,0,1,,3"), 2, "ty is no number: \"\""),
        (format!("{header}1,0,x1,0,1,2,3"), 2, "qy is no number: \"x1\""),
        (format!("{header}0,0,0,0,1,2,3"), 2, "no pose"),
        (format!("{header}nan,0,0,0,1,2,3"), 2, "no pose"),
        (format!("{header}1,0,0,0,1,inf,3"), 2, "no pose"),
        (format!("{header}1,0,0,0,1e400,2,3"), 2, "no pose"),
        (format!("{header}1,0,0,0,1e39,2,3"), 2, "farther"),
    ] {
        let error = KeyFrames::from_csv(&text).unwrap_err().to_string();
        assert!(error.starts_with(&format!("line {line}: ")), "{text}: {error}");
        assert!(error.contains(reason), "{text}: {error}");
    }
    let lenient = format!("{}2, 0 ,0,0,1,2,3", header.replace('\n', "\r\n"));
    assert_eq!(
        KeyFrames::from_csv(&lenient).unwrap().poses(),
        [posed([-1.0, -2.0, -3.0], [0.0; 3])]
    );
    assert!(KeyFrames::from_csv(header).unwrap().is_empty());
    let many = header.to_owned() + &pose.repeat(KeyFrames::MAX + 1);
    let error = KeyFrames::from_csv(&many).unwrap_err().to_string();
    assert_eq!(error, "line 65538: more than 65536 key frames");
}

/// A folder with `p.ply`, in which there are two key frames, and the prior's path.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.ply");
    let mut bytes = Vec::new();
    let splats = sample_splats(2, 0);
    let write = super::super::ply::write_ply;
    let (options, none) = (RenderOptions::INRIA, crate::image::Preprocessing::NONE);
    write(&splats, &options, &sample_key_frames(2), &none, &mut bytes).unwrap();
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

#[test]
fn those_beside_a_prior_come_before_those_in_its_file() {
    let (_folder, path) = folder();
    let open = || Prior::open(&path, &RenderOverrides::default());
    let prior = open().unwrap();
    assert_eq!(prior.key_frames(), &sample_key_frames(2));
    assert_eq!(prior.report().key_frames, PartSource::InFile);
    let beside = KeyFrames::path_beside(&path);
    assert!(beside.to_str().unwrap().ends_with("p.ply.keys"));
    sample_key_frames(5).save(&beside).unwrap();
    let with = open().unwrap();
    assert_eq!(with.key_frames(), &sample_key_frames(5));
    assert_eq!(with.report().key_frames, PartSource::Beside);
    assert_eq!(with.id(), prior.id());
    // In memory there is no file beside.
    let bytes = std::fs::read(&path).unwrap();
    let inside = Prior::from_bytes(&bytes, "p.ply", &RenderOverrides::default()).unwrap();
    assert_eq!(inside.key_frames().len(), 2);
    // A list of none is a list.
    KeyFrames::NONE.save(&beside).unwrap();
    assert_eq!(open().unwrap().report().key_frames, PartSource::Beside);
    assert!(open().unwrap().key_frames().is_empty());
    let other = open().unwrap().with_key_frames(sample_key_frames(3));
    assert_eq!((other.key_frames().len(), other.id()), (3, prior.id()));
    assert_eq!(other.report().key_frames, PartSource::Memory);
}

#[test]
fn a_broken_file_beside_a_prior_is_named() {
    let (_folder, path) = folder();
    let beside = KeyFrames::path_beside(&path);
    let error = || Prior::open(&path, &RenderOverrides::default()).unwrap_err().to_string();
    std::fs::write(&beside, "qw,qx,qy,qz,tx,ty,tz\n1,0,0,0,a,0,0\n").unwrap();
    assert!(error().ends_with("p.ply.keys: line 2: tx is no number: \"a\""), "{}", error());
    std::fs::write(&beside, b"qw,qx,qy,qz,tx,ty,tz\n1,\xff").unwrap();
    assert!(error().ends_with("p.ply.keys: line 2: no UTF-8 text"), "{}", error());
    std::fs::write(&beside, vec![b' '; MAX_BYTES as usize + 1]).unwrap();
    assert!(error().contains("p.ply.keys: too long"), "{}", error());
    std::fs::remove_file(&beside).unwrap();
    std::fs::create_dir(&beside).unwrap();
    assert!(error().contains("p.ply.keys: no file"), "{}", error());
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
    fn text_gives_back_every_bit(poses in proptest::collection::vec(any_pose(), 0..20)) {
        let key_frames = KeyFrames::new(poses).unwrap();
        prop_assert_eq!(&KeyFrames::from_csv(&key_frames.to_csv()).unwrap(), &key_frames);
    }

    #[test]
    fn arbitrary_text_is_an_error_or_key_frames(text in any::<String>(), rows in "[-0-9.,e\n]{0,200}") {
        prop_assert!(KeyFrames::from_csv(&text).is_err());
        if let Ok(found) = KeyFrames::from_csv(&format!("qw,qx,qy,qz,tx,ty,tz\n{rows}")) {
            prop_assert!(KeyFrames::new(found.poses().to_vec()).is_ok());
        }
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
