use glam::{DQuat, DVec3};
use nvsprior::prior::Splats;
use nvsprior::random::Random;
use nvsprior::{Camera, Pose};

use super::*;

const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 228.5, fy: 228.5, cx: 160.0, cy: 90.0 };
const NEAR: f64 = 0.2;

/// Cameras along a crooked way that look anywhere, and points around it.
fn run(seed: u64, pictures: usize) -> (Vec<View>, Vec<DVec3>) {
    let mut random = Random::new(seed);
    let mut number = |from: f32, to: f32| f64::from(random.within(from, to));
    let view = |i: usize, number: &mut dyn FnMut(f32, f32) -> f64| {
        let along = i as f64 / pictures as f64;
        let centre = DVec3::new(
            20.0 * along,
            3.0 * (6.0 * along).sin() + number(-1.0, 1.0),
            number(-0.5, 0.5),
        );
        let turn = number(-3.0, 3.0);
        let rotation = DQuat::from_rotation_y(turn) * DQuat::from_rotation_x(number(-0.5, 0.5));
        View { camera: CAMERA, pose: Pose::from_centre(rotation, centre) }
    };
    let views = (0..pictures).map(|i| view(i, &mut number)).collect();
    let mut point = || DVec3::new(number(-5.0, 25.0), number(-6.0, 6.0), number(-6.0, 6.0));
    (views, (0..3000).map(|_| point()).collect())
}

fn divided(seed: u64, pictures: usize, parts: usize) -> (Parts, Vec<View>, Vec<DVec3>) {
    let (views, points) = run(seed, pictures);
    let cameras: Vec<DVec3> = views.iter().map(|view| view.pose.centre()).collect();
    let cells = Cells::of(&cameras, parts).unwrap();
    (Parts::new(cells, parts, views.clone(), &points, NEAR), views, points)
}

#[test]
fn each_place_is_kept_once_and_by_a_part_that_sees_it() {
    for (seed, parts) in [(1, 2), (2, 3), (3, 5), (4, 8)] {
        let (own, views, points) = divided(seed, 60, parts);
        let positions: Vec<_> = points.iter().map(|p| p.as_vec3().to_array()).collect();
        let splats = Splats { positions: positions.clone(), ..Splats::default() };
        let mut keepers = vec![0; positions.len()];
        for part in 0..parts {
            let kept = own.kept(part, &splats);
            keepers.iter_mut().zip(kept).for_each(|(count, kept)| *count += usize::from(kept));
        }
        assert!(keepers.iter().all(|count| *count == 1));
        let mut unseen_by_cell = 0;
        for position in &positions {
            let place = place_of(*position);
            let seen = views.iter().any(|view| view.of(place, NEAR).is_some());
            let keeper = own.keeper(place);
            assert_eq!(own.sees(keeper, place), seen, "{place}");
            unseen_by_cell += usize::from(keeper != own.cells.part(place));
        }
        // Some places are kept by others than the part that they lie in, but few.
        assert!(unseen_by_cell < positions.len() / 3, "{unseen_by_cell}");
    }
}

#[test]
fn each_picture_trains_the_part_it_was_taken_in_and_those_that_it_shows() {
    let (own, views, points) = divided(7, 80, 4);
    for (i, view) in views.iter().enumerate() {
        let taken_in = own.taken_in(&view.pose);
        let trained: Vec<usize> = (0..4).filter(|p| own.pictures(*p).contains(&i)).collect();
        assert!(trained.contains(&taken_in));
        assert_eq!(trained, own.shown_by(view, &points));
        let in_view: Vec<usize> = points
            .iter()
            .filter(|point| view.of(**point, NEAR).is_some())
            .map(|point| own.cells.part(*point))
            .collect();
        for part in 0..4 {
            let all = in_view.iter().all(|of| *of == part) && !in_view.is_empty();
            assert!(!all || trained.contains(&part), "picture {i} shows nothing but part {part}");
        }
    }
    // What lies near is trained by more pictures than those that were taken there, not by all.
    let counts: Vec<usize> = (0..4).map(|part| own.pictures(part).len()).collect();
    assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
    assert!(counts.iter().any(|count| *count < 70), "{counts:?}");
}

#[test]
fn what_stands_in_front_hides_the_part_behind() {
    // Two cameras at x = 0 and 10; the first looks along x, at a wall of points at x = 3.
    let ahead = DQuat::from_rotation_y(-std::f64::consts::FRAC_PI_2);
    let views = [0.0, 10.0]
        .map(|x| View { camera: CAMERA, pose: Pose::from_centre(ahead, DVec3::new(x, 0.0, 0.0)) });
    assert!(views[0].of(DVec3::new(5.0, 0.0, 0.0), NEAR).is_some());
    let sheet = |x: f64| {
        (0..100 * 60).map(move |i| {
            let (across, down) = (f64::from(i % 100) - 49.5, f64::from(i / 100) - 29.5);
            DVec3::new(x, 0.05 * x * down, 0.05 * x * across)
        })
    };
    let beyond: Vec<DVec3> = sheet(8.0).collect();
    let hidden: Vec<DVec3> = sheet(3.0).chain(sheet(8.0)).collect();
    let cameras = views.map(|view| view.pose.centre());
    let pictures = |points: &[DVec3]| {
        let cells = Cells::of(&cameras, 2).unwrap();
        let far = cells.part(DVec3::new(8.0, 0.0, 0.0));
        Parts::new(cells, 2, views.to_vec(), points, NEAR).pictures(far).len()
    };
    assert_eq!(pictures(&beyond), 2);
    assert_eq!(pictures(&hidden), 1);
}

#[test]
fn parts_have_about_as_many_cameras_each() {
    for (pictures, parts) in [(60, 2), (61, 3), (100, 7), (8, 8)] {
        let (own, views, _) = divided(11, pictures, parts);
        let mut counts = vec![0; parts];
        views.iter().for_each(|view| counts[own.taken_in(&view.pose)] += 1);
        let even = pictures / parts;
        assert!(
            counts.iter().all(|count| *count >= even.max(1) && *count <= even + 2),
            "{counts:?}"
        );
    }
}

#[test]
fn a_run_without_so_many_places_is_refused() {
    let places: Vec<DVec3> = (0..6).map(|i| DVec3::X * f64::from(i / 3)).collect();
    assert!(Cells::of(&places, 2).is_ok());
    for parts in [0, 3, 7] {
        assert_eq!(Cells::of(&places, parts).unwrap_err(), PartsError { parts, pictures: 6 });
    }
    assert!(Cells::of(&[DVec3::ZERO; 9], 2).is_err());
    // A place that is no number belongs to a part all the same.
    assert!(Cells::of(&places, 2).unwrap().part(DVec3::NAN) < 2);
}

#[test]
fn splats_become_points_of_their_colour() {
    let splats = Splats {
        origin: [0.0; 3],
        positions: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
        log_scales: vec![[0.0; 3]; 2],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacity_logits: vec![2.0, -5.0],
        sh: vec![0.0, 1.0, -9.0, 0.0, 0.0, 0.0],
        sh_degree: 0,
    };
    let [point] = points_of_splats(&splats)[..] else { panic!("the faint one is none") };
    assert_eq!(point.position, [1.0, 2.0, 3.0]);
    assert!((point.rgb[1] - 0.782_094_8).abs() < 1e-6 && point.rgb[2] == 0.0, "{:?}", point.rgb);
}
