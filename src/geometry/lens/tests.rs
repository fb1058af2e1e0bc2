use std::f64::consts::FRAC_PI_4;

use proptest::prelude::*;

use super::*;
use crate::image::Mask;

const HD: Intrinsics =
    Intrinsics { width: 1920, height: 1080, fx: 1335.4, fy: 1335.4, cx: 960.0, cy: 540.0 };

/// Lenses of each kind, as strong as lenses under water are.
fn lenses(intrinsics: Intrinsics) -> Vec<Lens> {
    let distortions = [
        Distortion::brown(&[0.345, 0.382, 0.0, 0.0]).unwrap(),
        Distortion::brown(&[-0.28, 0.07, 0.004, -0.003, 0.01]).unwrap(),
        Distortion::brown(&[0.5, 0.1, -0.002, 0.001, 0.02, 0.8, 0.2, 0.05]).unwrap(),
        Distortion::Fisheye([-0.03, 0.01, -0.004, 0.001]),
    ];
    distortions.map(|d| Lens::new(intrinsics, d).unwrap()).to_vec()
}

#[test]
fn rays_go_where_the_formulas_say() {
    let unit = Intrinsics { width: 9, height: 9, fx: 1.0, fy: 1.0, cx: 4.0, cy: 4.0 };
    let brown = Distortion::brown(&[0.1, -0.05, 0.01, -0.02, 0.03]).unwrap();
    let place = Lens::new(unit, brown).unwrap().distort(DVec2::new(0.3, -0.2)).unwrap();
    // By hand: r² = 0.13, c = 1.01222091.
    assert!((place - DVec2::new(4.296266273, 3.802055818)).length() < 1e-9, "{place}");
    let fisheye = Lens::new(unit, Distortion::Fisheye([0.1, 0.0, 0.0, 0.0])).unwrap();
    let place = fisheye.distort(DVec2::new(0.0, 1.0)).unwrap();
    let bent = FRAC_PI_4 + 0.1 * FRAC_PI_4.powi(3);
    assert!((place - DVec2::new(4.0, 4.0 + bent)).length() < 1e-12, "{place}");
    assert_eq!(fisheye.distort(DVec2::ZERO), Some(DVec2::splat(4.0)));
    let rational = Distortion::brown(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]).unwrap();
    let place = Lens::new(unit, rational).unwrap().distort(DVec2::new(0.5, 0.0)).unwrap();
    assert!((place.x - 4.4).abs() < 1e-12, "{place}");
}

#[test]
fn the_pinhole_shows_all_it_can_and_nothing_else() {
    for lens in lenses(HD) {
        let camera = lens.pinhole();
        assert_eq!((camera.cx, camera.cy), (960.0, 540.0));
        assert_eq!(camera.fx, camera.fy);
        let all = Mask::all(1920, 1080);
        let small = lens.pinhole_at(320);
        assert_eq!((small.width, small.height), (320, 180));
        assert_eq!(all.undistorted(&lens, &small).unwrap().share(), 1.0);
        let wider = Camera { fx: small.fx * 0.98, fy: small.fy * 0.98, ..small };
        let share = all.undistorted(&lens, &wider).unwrap().share();
        assert!(share < 1.0 && share > 0.9, "{lens:?}: {share}");
    }
}

#[test]
fn a_fisheye_of_half_the_world_keeps_a_pinhole_of_use() {
    let all = Intrinsics { fx: 400.0, fy: 400.0, ..HD };
    let lens = Lens::new(all, Distortion::Fisheye([0.0; 4])).unwrap();
    let camera = lens.pinhole();
    let corner = (960f64.hypot(540.0) / f64::from(camera.fx)).atan().to_degrees();
    assert!((corner - MAX_ANGLE).abs() < 1e-3, "{corner}");
}

#[test]
fn folded_rays_are_not_mapped() {
    let lens = Lens::new(HD, Distortion::brown(&[-0.5, 0.0, 0.0, 0.0]).unwrap()).unwrap();
    // (r − r³/2)' = 0
    let fold = (1.0f64 / 1.5).sqrt();
    assert!(lens.distort(DVec2::new(fold - 0.01, 0.0)).is_some());
    assert_eq!(lens.distort(DVec2::new(fold + 0.01, 0.0)), None);
    assert_eq!(lens.distort(DVec2::new(f64::NAN, 0.0)), None);
}

#[test]
fn values_that_are_no_lens_are_refused() {
    let new = |change: fn(&mut Intrinsics), distortion| {
        let mut intrinsics = HD;
        change(&mut intrinsics);
        Lens::new(intrinsics, distortion).unwrap_err()
    };
    let brown = |k: &[f64]| Distortion::brown(k).unwrap();
    assert!(matches!(new(|i| i.width = 0, Distortion::None), LensError::Side { .. }));
    assert!(matches!(new(|i| i.fy = -1.0, Distortion::None), LensError::Intrinsic { .. }));
    assert!(matches!(new(|i| i.cx = f64::NAN, Distortion::None), LensError::Intrinsic { .. }));
    assert!(matches!(new(|i| i.fx = 1e300, Distortion::None), LensError::Camera(_)));
    assert!(matches!(new(|i| i.cy = -9.0, brown(&[0.1; 4])), LensError::PrincipalPoint { .. }));
    assert!(matches!(new(|_| (), brown(&[f64::NAN; 5])), LensError::Coefficient { .. }));
    assert!(matches!(new(|_| (), brown(&[-1e9; 8])), LensError::Folds));
    let side = new(|i| i.height = 70_000, Distortion::None).to_string();
    assert_eq!(side, "lens for pictures of 1920×70000: sides must lie in 1..=65535");
    assert_eq!(Distortion::brown(&[0.0; 6]), Err(LensError::Count { found: 6 }));
    let lens = Lens::new(HD, brown(&[0.0; 8])).unwrap();
    assert_eq!(lens.distortion(), &Distortion::None);
    let error = Mask::all(9, 9).undistorted(&lens, &lens.pinhole()).unwrap_err();
    assert!(matches!(error, LensError::Size { found: (9, 9), .. }));
}

#[test]
fn each_pixel_has_the_ray_that_leads_to_it() {
    for lens in lenses(HD) {
        assert_eq!(lens.check_corners(), Ok(()));
        for pixel in [(0.0, 0.0), (1920.0, 0.0), (3.5, 1079.0), (960.0, 540.0), (960.5, 540.0)] {
            let pixel = DVec2::from(pixel);
            let ray = lens.ray(pixel).unwrap();
            assert!((lens.distort(ray).unwrap() - pixel).length() < 1e-6, "{lens:?} at {pixel}");
        }
        assert_eq!(lens.ray(DVec2::splat(f64::NAN)), None);
    }
}

#[test]
fn a_lens_that_folds_within_its_picture_is_told_with_the_corner() {
    let folds = Lens::new(HD, Distortion::brown(&[-0.5, 0.0, 0.0, 0.0]).unwrap()).unwrap();
    assert_eq!(folds.check_corners(), Err(LensError::NoRay { x: 0, y: 0 }));
    assert!(folds.ray(DVec2::new(960.0, 300.0)).is_some());
    // A principal point to the left: only the corners on the right are beyond the fold.
    let left = Intrinsics { cx: 300.0, fx: 2000.0, fy: 2000.0, ..HD };
    let folds = Lens::new(left, Distortion::brown(&[-0.5, 0.0, 0.0, 0.0]).unwrap()).unwrap();
    assert_eq!(folds.check_corners(), Err(LensError::NoRay { x: 1920, y: 0 }));
    // A fisheye whose picture is a disc: what its corners would show lies behind the camera.
    let disc = Intrinsics { fx: 300.0, fy: 300.0, ..HD };
    let disc = Lens::new(disc, Distortion::Fisheye([0.0; 4])).unwrap();
    assert_eq!((disc.check_corners(), disc.ray(DVec2::ZERO)), (Ok(()), None));
}

proptest! {
    #[test]
    fn any_coefficients_give_an_error_or_a_lens(
        k in proptest::array::uniform8(prop_oneof![-3.0..3.0f64, any::<f64>()]),
        fisheye: bool,
        pixel in (-100.0..200.0f64, -100.0..200.0f64),
    ) {
        let intrinsics = Intrinsics { width: 60, height: 40, fx: 50.0, fy: 45.0, cx: 31.0, cy: 19.0 };
        let four = [k[0], k[1], k[2], k[3]];
        let distortion = if fisheye { Distortion::Fisheye(four) } else { Distortion::Brown(k) };
        if let Ok(lens) = Lens::new(intrinsics, distortion) {
            let _ = lens.check_corners();
            if let Some(ray) = lens.ray(pixel.into()) {
                prop_assert!((lens.distort(ray).unwrap() - DVec2::from(pixel)).length() < 1e-5);
            }
        }
    }
}
