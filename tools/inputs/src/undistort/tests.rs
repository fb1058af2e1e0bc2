use image::imageops::FilterType;
use nvsprior::geometry::{Distortion, Intrinsics};
use proptest::prelude::*;

use super::*;

/// With a principal point off its middle.
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
fn pictures_undistort_to_what_a_pinhole_would_have_seen() {
    for lens in lenses(QUARTER) {
        let distorted = painted(QUARTER.width, QUARTER.height, |pixel| lens.ray(pixel));
        let full = lens.pinhole();
        for camera in [full, lens.pinhole_at(240)] {
            let (found, mask) = undistort(&lens, &distorted, &camera).unwrap();
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
    assert_eq!(undistort(&lens, &old, &lens.pinhole()).unwrap().0, old);
    let rgb = image::RgbImage::from_raw(480, 270, old.data.clone()).unwrap();
    for width in [480, 160, 150, 960] {
        let camera = lens.pinhole().resized(width, width * 9 / 16);
        assert!(lens.is_only_resized(&camera));
        let (found, mask) = undistort(&lens, &old, &camera).unwrap();
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
        let (found, _) = undistort(&lens, &stripes, &lens.pinhole_at(80)).unwrap();
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
    let (found, mask) = undistort(&lens, &noise(480, 270), &shifted).unwrap();
    assert_eq!(mask.data.iter().take(480).filter(|counts| !**counts).count(), 11);
    assert_eq!(&found.data[..30], &[0; 30], "all black");
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
            let (picture, mask) = undistort(&lens, &noise(60, 40), &camera).unwrap();
            prop_assert_eq!(picture.data.len(), 3 * mask.data.len());
        }
    }
}
