use std::f64::consts::FRAC_PI_4;

use image::imageops::FilterType;
use nvsprior::Picture;
use proptest::prelude::*;

use super::*;

const HD: Intrinsics =
    Intrinsics { width: 1920, height: 1080, fx: 1335.4, fy: 1335.4, cx: 960.0, cy: 540.0 };

/// A quarter of it, with a principal point off its middle.
const QUARTER: Intrinsics =
    Intrinsics { width: 480, height: 270, fx: 330.0, fy: 332.0, cx: 236.0, cy: 141.0 };

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

/// The ray that a lens maps to this pixel: by following the rest back, over and over.
fn ray(lens: &Lens, pixel: DVec2) -> Option<DVec2> {
    let Intrinsics { fx, fy, cx, cy, .. } = lens.intrinsics;
    let wanted = (pixel - DVec2::new(cx, cy)) / DVec2::new(fx, fy);
    let mut ray = wanted;
    for _ in 0..300 {
        ray += 0.4 * (wanted - lens.distortion.apply(ray));
    }
    lens.distort(ray).filter(|found| (found - pixel).length() < 1e-6).map(|_| ray)
}

/// A grid in three colours, as a function of the ray; values in [0, 255].
fn grid(ray: DVec2) -> [f64; 3] {
    let wave = |v: f64| 0.5 + 0.5 * (v * 45.0).sin();
    [wave(ray.x), wave(ray.y), wave(ray.x) * wave(ray.y)].map(|v| 255.0 * v)
}

/// The picture in which each pixel's middle has the colour of its ray; black if it has none.
fn painted(width: u32, height: u32, ray_of: impl Fn(DVec2) -> Option<DVec2>) -> Picture {
    let mut picture = Picture::new(width, height);
    for (i, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
        let i = i as u32;
        let place = DVec2::new((i % width).into(), (i / width).into()) + 0.5;
        if let Some(ray) = ray_of(place) {
            pixel.copy_from_slice(&grid(ray).map(|v| v.round() as u8));
        }
    }
    picture
}

fn painted_by(camera: &Camera) -> Picture {
    let focal = DVec2::new(camera.fx.into(), camera.fy.into());
    let principal = DVec2::new(camera.cx.into(), camera.cy.into());
    painted(camera.width, camera.height, |p| Some((p - principal) / focal))
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
        let grey = vec![255; 1920 * 1080];
        let small = lens.pinhole_at(320);
        assert_eq!((small.width, small.height), (320, 180));
        assert_eq!(lens.undistort_mask(&grey, &small).unwrap().share(), 1.0);
        let wider = Camera { fx: small.fx * 0.98, fy: small.fy * 0.98, ..small };
        let share = lens.undistort_mask(&grey, &wider).unwrap().share();
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
fn pictures_undistort_to_what_a_pinhole_would_have_seen() {
    for lens in lenses(QUARTER) {
        let distorted = painted(QUARTER.width, QUARTER.height, |pixel| ray(&lens, pixel));
        let full = lens.pinhole();
        for camera in [full, lens.pinhole_at(240)] {
            let (found, mask) = lens.undistort(&distorted, &camera).unwrap();
            let psnr = found.psnr(&painted_by(&camera));
            assert!(psnr > 36.0, "{lens:?} at {}: {psnr} dB", camera.width);
            assert_eq!(mask.share(), 1.0);
        }
    }
}

/// A picture of noise, the same on each run.
fn noise(width: u32, height: u32) -> Picture {
    let mut state = 1u32;
    let next = |_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let data = (0..width * height * 3).map(next).collect();
    Picture::from_rgb(width, height, data).unwrap()
}

#[test]
fn without_distortion_it_is_the_resizing_of_frames() {
    let lens = Lens::new(QUARTER, Distortion::None).unwrap();
    let old = noise(480, 270);
    assert_eq!(lens.undistort(&old, &lens.pinhole()).unwrap().0, old);
    let rgb = image::RgbImage::from_raw(480, 270, old.data.clone()).unwrap();
    for width in [480, 160, 150, 960] {
        let camera = lens.pinhole().resized(width, width * 9 / 16);
        assert!(lens.is_only_resized(&camera));
        let (found, mask) = lens.undistort(&old, &camera).unwrap();
        let due = image::imageops::resize(&rgb, width, camera.height, FilterType::Lanczos3);
        let worst = found.data.iter().zip(due.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst.unwrap() <= 1, "{width}: {worst:?}");
        assert_eq!(mask.share(), 1.0);
    }
}

#[test]
fn reducing_lets_no_fine_pattern_through() {
    let lens =
        lenses(Intrinsics { fx: 445.0, fy: 445.0, cx: 320.0, cy: 180.0, width: 640, height: 360 });
    let mut stripes = Picture::new(640, 360);
    for (i, pixel) in stripes.data.chunks_exact_mut(3).enumerate() {
        pixel.fill(if i % 640 % 4 < 2 { 255 } else { 0 });
    }
    for lens in lens {
        let (found, _) = lens.undistort(&stripes, &lens.pinhole_at(80)).unwrap();
        // The outermost pixels' kernels reach over the edge.
        let inner = found.data.iter().enumerate().filter(|(i, _)| (12..228).contains(&(i % 240)));
        let worst = inner.map(|(_, v)| v.abs_diff(128)).max().unwrap();
        assert!(worst < 16, "{lens:?}: {worst}");
    }
}

#[test]
fn pixels_from_beyond_the_picture_do_not_count() {
    let lens = Lens::new(QUARTER, Distortion::None).unwrap();
    let shifted = Camera { cx: 236.0 + 10.5, ..lens.pinhole() };
    let (found, mask) = lens.undistort(&noise(480, 270), &shifted).unwrap();
    assert_eq!(mask.data.iter().take(480).filter(|counts| !**counts).count(), 11);
    assert_eq!(&found.data[..30], &[0; 30], "all black");
    let mut grey = vec![255; 480 * 270];
    grey[100] = 0;
    let mask = lens.undistort_mask(&grey, &lens.pinhole()).unwrap();
    assert_eq!(mask.data.iter().position(|counts| !counts), Some(100));
    assert_eq!(mask.data.iter().filter(|counts| !**counts).count(), 1);
    let mask = lens.undistort_mask(&grey, &lens.pinhole().resized(48, 27)).unwrap();
    assert!(!mask.data[10], "one black pixel of a hundred");
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
    assert_eq!(Distortion::brown(&[0.0; 6]), Err(LensError::Count { found: 6 }));
    let lens = Lens::new(HD, brown(&[0.0; 8])).unwrap();
    assert_eq!(lens.distortion(), &Distortion::None);
    let error = lens.undistort(&Picture::new(9, 9), &lens.pinhole()).unwrap_err();
    assert!(matches!(error, LensError::Size { found: (9, 9), .. }));
    assert!(lens.undistort_mask(&[], &lens.pinhole()).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_coefficients_give_an_error_or_a_camera(
        k in proptest::array::uniform8(prop_oneof![-3.0..3.0f64, any::<f64>()]),
        fisheye: bool,
        cx in -10.0..70.0f64,
    ) {
        let intrinsics = Intrinsics { width: 60, height: 40, fx: 50.0, fy: 45.0, cx, cy: 19.0 };
        let four = [k[0], k[1], k[2], k[3]];
        let distortion = if fisheye { Distortion::Fisheye(four) } else { Distortion::Brown(k) };
        if let Ok(lens) = Lens::new(intrinsics, distortion) {
            let camera = lens.pinhole_at(30);
            prop_assert!(camera.check().is_ok());
            let (picture, mask) = lens.undistort(&noise(60, 40), &camera).unwrap();
            prop_assert_eq!(picture.data.len(), 3 * mask.data.len());
        }
    }
}
