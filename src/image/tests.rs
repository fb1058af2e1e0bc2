use glam::DVec2;
use proptest::prelude::*;

use super::*;
use crate::geometry::{Distortion, Footprint, Intrinsics, Lens, LensError};
use crate::{Camera, Picture};

const FORMATS: [PixelFormat; 5] = [
    PixelFormat::Rgb8,
    PixelFormat::Bgr8,
    PixelFormat::Rgba8,
    PixelFormat::Nv12,
    PixelFormat::I420,
];
const COLOURS: [Colour; 4] =
    [Colour::Bt601Limited, Colour::Bt601Full, Colour::Bt709Limited, Colour::Bt709Full];

/// Bytes between the rows.
const CANARY: u8 = 0xA5;

/// An image that owns its bytes.
struct Image {
    width: u32,
    height: u32,
    format: PixelFormat,
    colour: Colour,
    planes: [Vec<u8>; 3],
    strides: [usize; 3],
}

impl Image {
    /// Noise from a seed, rows `gap` bytes apart.
    fn noise(format: PixelFormat, width: u32, height: u32, gap: usize, seed: u64) -> Image {
        let mut state = seed * 2 + 1;
        let mut byte = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 56) as u8
        };
        let (mut planes, mut strides): ([Vec<u8>; 3], [usize; 3]) = Default::default();
        for (i, plane) in format.planes().iter().enumerate() {
            let (columns, rows) = plane.size(width, height);
            let row = columns as usize * plane.step;
            for y in 0..rows {
                planes[i].extend((0..row).map(|_| byte()));
                planes[i].extend(vec![CANARY; if y + 1 < rows { gap } else { 0 }]);
            }
            strides[i] = row + gap;
        }
        Image { width, height, format, colour: Colour::default(), planes, strides }
    }

    fn view(&self) -> ImageView<'_> {
        let Image { width, height, format, colour, strides, .. } = *self;
        let planes = std::array::from_fn(|i| &self.planes[i][..]);
        ImageView { width, height, format, colour, planes, strides }
    }

    fn converted(&self, width: u32, height: u32) -> Picture {
        let mut picture = Picture::new(0, 0);
        Converter::new(width, height).unwrap().convert(&self.view(), &mut picture).unwrap();
        assert_eq!((picture.width, picture.height), (width, height));
        picture
    }

    /// Component `c` at pixel (x, y) of this image at another size: the mean over a window.
    fn component(&self, c: usize, x: u32, y: u32, width: u32, height: u32) -> f64 {
        let (plane, offset) = match (self.format, c) {
            (PixelFormat::Rgb8 | PixelFormat::Rgba8, c) => (0, c),
            (PixelFormat::Bgr8, c) => (0, 2 - c),
            (PixelFormat::Nv12, 0) => (0, 0),
            (PixelFormat::Nv12, c) => (1, c - 1),
            (PixelFormat::I420, c) => (c, 0),
        };
        let step = match self.format {
            PixelFormat::Rgb8 | PixelFormat::Bgr8 => 3,
            PixelFormat::Rgba8 => 4,
            PixelFormat::Nv12 => 1 + plane,
            PixelFormat::I420 => 1,
        };
        let pixels = if plane == 0 { 1.0 } else { 2.0 };
        let across = window(x, width, self.width, pixels);
        let mut sum = 0.0;
        for (row, a) in window(y, height, self.height, pixels) {
            for &(column, b) in &across {
                let at = row * self.strides[plane] + column * step + offset;
                sum += a * b * f64::from(self.planes[plane][at]);
            }
        }
        sum
    }

    /// Red, green, blue at a pixel, before rounding.
    fn oracle(&self, x: u32, y: u32, width: u32, height: u32) -> [f64; 3] {
        let c: [f64; 3] = std::array::from_fn(|c| self.component(c, x, y, width, height));
        if matches!(self.format, PixelFormat::Nv12 | PixelFormat::I420) {
            rgb(self.colour, c).map(|v| v.clamp(0.0, 255.0))
        } else {
            c
        }
    }
}

/// Samples and weights of a pixel.
fn window(pixel: u32, target: u32, side: u32, pixels: f64) -> Vec<(usize, f64)> {
    let ratio = f64::from(side) / f64::from(target) / pixels;
    let (centre, width) = ((f64::from(pixel) + 0.5) * ratio, ratio.max(1.0));
    let (begin, end) = (centre - width / 2.0, centre + width / 2.0);
    let last = (f64::from(side) / pixels).ceil() - 1.0;
    let mut k = begin.floor();
    let mut samples = Vec::new();
    while k < end {
        let covered = end.min(k + 1.0) - begin.max(k);
        samples.push((k.clamp(0.0, last) as usize, covered / width));
        k += 1.0;
    }
    samples
}

/// BT.601 and BT.709: Y = Kr R + Kg G + Kb B, Cb = (B − Y) / 2(1 − Kb), Cr = (R − Y) / 2(1 − Kr).
fn rgb(colour: Colour, [y, u, v]: [f64; 3]) -> [f64; 3] {
    let (kr, kb) = match colour {
        Colour::Bt601Limited | Colour::Bt601Full => (0.299, 0.114),
        Colour::Bt709Limited | Colour::Bt709Full => (0.2126, 0.0722),
    };
    let (y, cb, cr) = match colour {
        Colour::Bt601Full | Colour::Bt709Full => {
            (y / 255.0, (u - 128.0) / 255.0, (v - 128.0) / 255.0)
        }
        _ => ((y - 16.0) / 219.0, (u - 128.0) / 224.0, (v - 128.0) / 224.0),
    };
    let (r, b) = (y + 2.0 * (1.0 - kr) * cr, y + 2.0 * (1.0 - kb) * cb);
    [r, (y - kr * r - kb * b) / (1.0 - kr - kb), b].map(|v| v * 255.0)
}

/// Half a step of rounding, and what the fixed point adds.
const TOLERANCE: f64 = 0.6;

fn assert_near_oracle(image: &Image, width: u32, height: u32) {
    let picture = image.converted(width, height);
    for (i, found) in picture.data.chunks_exact(3).enumerate() {
        let (x, y) = (i as u32 % width, i as u32 / width);
        let expected = image.oracle(x, y, width, height);
        for (e, &f) in expected.iter().zip(found) {
            assert!(
                (e - f64::from(f)).abs() < TOLERANCE,
                "{:?} {}×{} to {width}×{height} at {x}, {y}: {found:?}, not {expected:?}",
                image.format,
                image.width,
                image.height
            );
        }
    }
}

#[test]
fn every_format_is_near_the_oracle_at_every_ratio() {
    let sizes = [
        ((1, 1), (1, 1)),
        ((1, 1), (4, 4)),
        ((3, 5), (3, 5)),
        ((3, 5), (6, 10)),
        ((6, 10), (3, 5)),
        ((64, 36), (16, 9)),
        ((100, 75), (36, 27)),
        ((75, 100), (72, 96)),
        ((17, 17), (7, 7)),
        ((7, 7), (17, 17)),
        ((301, 300), (8, 8)),
        ((1200, 3), (400, 1)),
    ];
    for (seed, ((w, h), (width, height))) in sizes.into_iter().enumerate() {
        for format in FORMATS {
            let mut image = Image::noise(format, w, h, seed % 3, seed as u64);
            for colour in COLOURS {
                image.colour = colour;
                assert_near_oracle(&image, width, height);
            }
        }
    }
}

/// The worst case of the weights' rounding: black and white alternate at a ratio of 127.
#[test]
fn fine_stripes_stay_within_a_step() {
    let mut image = Image::noise(PixelFormat::Rgb8, 8001, 127, 0, 1);
    for (i, byte) in image.planes[0].iter_mut().enumerate() {
        *byte = if i / 3 % 2 == 0 { 255 } else { 0 };
    }
    let picture = image.converted(63, 1);
    for (x, found) in picture.data.chunks_exact(3).enumerate() {
        let expected = image.oracle(x as u32, 0, 63, 1)[0];
        assert!((expected - f64::from(found[0])).abs() < 1.0, "{x}: {found:?}, not {expected}");
    }
}

#[test]
fn rgb_of_the_same_size_is_unchanged() {
    for (width, height) in [(1, 1), (3, 5), (320, 180)] {
        let image = Image::noise(PixelFormat::Rgb8, width, height, 0, 7);
        assert_eq!(image.converted(width, height).data, image.planes[0]);
    }
}

#[test]
fn formats_hold_the_same_picture() {
    let mut rgb = Image::noise(PixelFormat::Rgb8, 11, 11, 0, 3);
    let expected = rgb.converted(5, 5).data;
    for format in [PixelFormat::Bgr8, PixelFormat::Rgba8] {
        let mut other = Image::noise(format, 11, 11, 5, 4);
        let picture = Picture::from_rgb(11, 11, rgb.planes[0].clone()).unwrap();
        write_picture(&picture, format, other.strides[0], &mut other.planes[0]).unwrap();
        assert_eq!(other.converted(5, 5).data, expected);
    }
    let nv12 = Image::noise(PixelFormat::Nv12, 11, 11, 3, 5);
    let mut i420 = Image::noise(PixelFormat::I420, 11, 11, 3, 5);
    i420.planes[0].clone_from(&nv12.planes[0]);
    for (row, y) in nv12.planes[1].chunks(nv12.strides[1]).zip(0..) {
        for (pair, x) in row.chunks_exact(2).zip(0..6) {
            i420.planes[1][y * i420.strides[1] + x] = pair[0];
            i420.planes[2][y * i420.strides[2] + x] = pair[1];
        }
    }
    assert_eq!(i420.converted(5, 5), nv12.converted(5, 5));
    // The fourth byte is no part of the picture.
    rgb = Image::noise(PixelFormat::Rgba8, 4, 4, 0, 6);
    let expected = rgb.converted(2, 2);
    rgb.planes[0].iter_mut().skip(3).step_by(4).for_each(|alpha| *alpha ^= 0xFF);
    assert_eq!(rgb.converted(2, 2), expected);
}

#[test]
fn bytes_between_rows_are_not_read() {
    for format in FORMATS {
        let (tight, wide) = (Image::noise(format, 9, 6, 0, 8), Image::noise(format, 9, 6, 13, 8));
        assert_ne!(tight.strides, wide.strides);
        assert_eq!(tight.converted(9, 6), wide.converted(9, 6));
        assert_eq!(tight.converted(3, 2), wide.converted(3, 2));
    }
}

/// The same bytes on every machine: a change here changes packets.
#[test]
fn golden_conversions() {
    let checks = FORMATS.map(|format| {
        let image = Image::noise(format, 322, 182, 1, 9);
        let sizes = [(100, 56), (322, 182), (500, 282)];
        crc32fast::hash(&sizes.map(|(width, height)| image.converted(width, height).data).concat())
    });
    assert_eq!(checks, [0x5c675b3e, 0xf0ad1dae, 0x90b84f33, 0x4e441b98, 0x492d1b62]);
}

#[test]
fn a_second_image_of_the_size_allocates_nothing() {
    let mut converter = Converter::new(32, 18).unwrap();
    let mut picture = Picture::new(32, 18);
    let data = picture.data.as_ptr();
    let image = |seed| Image::noise(PixelFormat::Nv12, 128, 72, 0, seed);
    converter.convert(&image(1).view(), &mut picture).unwrap();
    let buffers = converter.buffers();
    assert!(buffers.iter().all(|(_, capacity)| *capacity > 0));
    converter.convert(&image(2).view(), &mut picture).unwrap();
    assert_eq!(converter.buffers(), buffers);
    assert_eq!(picture.data.as_ptr(), data);
    assert_eq!(picture, image(2).converted(32, 18));
    // Another size in between does not change the result.
    converter
        .convert(&Image::noise(PixelFormat::Rgba8, 34, 19, 0, 3).view(), &mut picture)
        .unwrap();
    converter.convert(&image(2).view(), &mut picture).unwrap();
    assert_eq!(picture, image(2).converted(32, 18));
}

/// Lenses of each kind for images of 120×80.
fn lenses() -> [Lens; 4] {
    let intrinsics = Intrinsics { width: 120, height: 80, fx: 85.0, fy: 86.0, cx: 61.0, cy: 39.0 };
    let distortions = [
        Distortion::brown(&[-0.28, 0.07, 0.004, -0.003, 0.01]).unwrap(),
        Distortion::brown(&[0.345, 0.382, 0.0, 0.0]).unwrap(),
        Distortion::brown(&[0.5, 0.1, -0.002, 0.001, 0.02, 0.8, 0.2, 0.05]).unwrap(),
        Distortion::Fisheye([-0.03, 0.01, -0.004, 0.001]),
    ];
    distortions.map(|distortion| Lens::new(intrinsics, distortion).unwrap())
}

/// The mean over a footprint of a reduced picture, interpolated linearly between the middles of its pixels, as
/// [`Converter`]'s comment defines it. `scale`: sides of the reduced picture by those of the image.
fn over_footprint(picture: &Picture, footprint: &Footprint, scale: DVec2) -> [f64; 3] {
    let value = |x: i64, y: i64, c: usize| {
        let x = x.clamp(0, i64::from(picture.width) - 1) as usize;
        let y = y.clamp(0, i64::from(picture.height) - 1) as usize;
        f64::from(picture.data[3 * (y * picture.width as usize + x) + c])
    };
    let sides = [footprint.sides.x_axis, footprint.sides.y_axis].map(|side| side * scale);
    // Sides are rounded to 2⁻¹⁶ pixels before they are measured.
    let rounded = |side: f64| (side * 65_536.0).round() / 65_536.0;
    let count = |side: DVec2| (rounded(side.abs().max_element()) - 1.0 / 32.0).ceil() as i32;
    let [n, m] = sides.map(|side| count(side).max(1));
    let mut sums = [0.0; 3];
    for i in 0..n {
        for j in 0..m {
            let part = |k: i32, n: i32| (f64::from(k) + 0.5) / f64::from(n) - 0.5;
            let at = footprint.centre * scale + sides[0] * part(i, n) + sides[1] * part(j, m) - 0.5;
            let (x, y) = (at.x.floor(), at.y.floor());
            let (u, v) = (at.x - x, at.y - y);
            let (x, y) = (x as i64, y as i64);
            for (c, sum) in sums.iter_mut().enumerate() {
                let along = |y| value(x, y, c) * (1.0 - u) + value(x + 1, y, c) * u;
                *sum += along(y) * (1.0 - v) + along(y + 1) * v;
            }
        }
    }
    sums.map(|sum| sum / f64::from(n * m))
}

#[test]
fn undistorted_pixels_are_means_over_their_footprints() {
    // At the lens's own size, at a half and at a fifth: images are reduced by 1, 1 or 2, and 4 or 5.
    for (lens, width) in lenses().iter().flat_map(|lens| [120, 60, 24].map(|w| (lens, w))) {
        let camera = lens.pinhole_at(width);
        let mut converter = Converter::undistorting(lens, &camera).unwrap();
        assert_eq!(converter.covered().unwrap().share(), 1.0, "the pinhole shows nothing else");
        let mut min = f64::INFINITY;
        lens.each_footprint(&camera, |_, footprint| {
            min = min.min(footprint.sides.x_axis.length()).min(footprint.sides.y_axis.length());
        });
        let factor = (min + 0.01).floor().max(1.0);
        assert!(width > 24 || factor >= 3.0, "{factor}");
        for format in FORMATS {
            let image = Image::noise(format, 120, 80, 5, u64::from(width));
            let (w, h) = (120u32.div_ceil(factor as u32), 80u32.div_ceil(factor as u32));
            let scale = DVec2::new(f64::from(w) / 120.0, f64::from(h) / 80.0);
            let mut reduced = Picture::new(w, h);
            super::scaler::Scaler::new(w, h).scale_image(&image.view(), &mut reduced);
            let mut found = Picture::new(0, 0);
            converter.convert(&image.view(), &mut found).unwrap();
            lens.each_footprint(&camera, |pixel, footprint| {
                let expected = over_footprint(&reduced, &footprint, scale);
                for (c, expected) in expected.iter().enumerate() {
                    let found = f64::from(found.data[3 * pixel + c]);
                    let off = (found - expected).abs();
                    assert!(off < 0.7, "{format:?} {width} {pixel}: {found}, not {expected}");
                }
            });
        }
    }
}

/// A smooth pattern of the ray, in one channel.
fn pattern(ray: DVec2) -> f64 {
    127.5 * (1.0 + 0.5 * (20.0 * ray.x).sin() + 0.5 * (17.0 * ray.y).cos()).min(2.0)
}

#[test]
fn undistorted_pictures_are_what_a_pinhole_would_have_seen() {
    for lens in lenses() {
        let mut image = Image::noise(PixelFormat::Rgb8, 120, 80, 0, 1);
        for (i, rgb) in image.planes[0].chunks_exact_mut(3).enumerate() {
            let pixel = DVec2::new((i % 120) as f64, (i / 120) as f64) + 0.5;
            let ray = lens.ray(pixel).expect("a ray for each pixel");
            rgb.fill(pattern(ray).round() as u8);
        }
        for width in [120, 60] {
            let camera = lens.pinhole_at(width);
            let mut found = Picture::new(0, 0);
            let mut converter = Converter::undistorting(&lens, &camera).unwrap();
            converter.convert(&image.view(), &mut found).unwrap();
            let mut due = Picture::new(camera.width, camera.height);
            for (i, rgb) in due.data.chunks_exact_mut(3).enumerate() {
                let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
                let x = (f64::from(x) + 0.5 - f64::from(camera.cx)) / f64::from(camera.fx);
                let y = (f64::from(y) + 0.5 - f64::from(camera.cy)) / f64::from(camera.fy);
                rgb.fill(pattern(DVec2::new(x, y)).round() as u8);
            }
            let psnr = found.psnr(&due);
            assert!(psnr > 36.0, "{lens:?} at {width}: {psnr} dB");
        }
    }
}

#[test]
fn fine_stripes_do_not_alias_through_a_lens() {
    for lens in lenses() {
        let mut image = Image::noise(PixelFormat::Rgb8, 120, 80, 0, 1);
        for (i, rgb) in image.planes[0].chunks_exact_mut(3).enumerate() {
            rgb.fill(if i % 120 % 2 == 0 { 255 } else { 0 });
        }
        let camera = lens.pinhole_at(20);
        let mut found = Picture::new(0, 0);
        Converter::undistorting(&lens, &camera)
            .unwrap()
            .convert(&image.view(), &mut found)
            .unwrap();
        let worst = found.data.iter().map(|v| v.abs_diff(128)).max().unwrap();
        assert!(worst < 40, "{lens:?}: {worst}");
    }
}

#[test]
fn what_the_lens_does_not_show_is_black_and_not_covered() {
    let [lens, ..] = lenses();
    let own = lens.pinhole();
    let camera = Camera { fx: 0.7 * own.fx, fy: 0.7 * own.fy, ..own };
    let mut converter = Converter::undistorting(&lens, &camera).unwrap();
    let covered = converter.covered().unwrap().clone();
    assert!(covered.share() > 0.4 && covered.share() < 0.9, "{}", covered.share());
    assert!(covered.data[40 * 120 + 60] && !covered.data[0] && !covered.data[120 * 80 - 1]);
    let mut image = Image::noise(PixelFormat::Rgb8, 120, 80, 0, 2);
    image.planes[0].fill(200);
    let mut found = Picture::new(0, 0);
    converter.convert(&image.view(), &mut found).unwrap();
    for (rgb, covered) in found.data.chunks_exact(3).zip(&covered.data) {
        assert_eq!(rgb, if *covered { [200; 3] } else { [0; 3] });
    }
}

#[test]
fn an_image_through_a_lens_allocates_nothing() {
    let [lens, ..] = lenses();
    let camera = lens.pinhole_at(60);
    let mut converter = Converter::undistorting(&lens, &camera).unwrap();
    let mut picture = Picture::new(camera.width, camera.height);
    let (buffers, data) = (converter.buffers(), picture.data.as_ptr());
    for format in FORMATS {
        converter.convert(&Image::noise(format, 120, 80, 3, 3).view(), &mut picture).unwrap();
        assert_eq!((converter.buffers(), picture.data.as_ptr()), (buffers.clone(), data));
    }
}

/// The same bytes on every machine.
#[test]
fn golden_undistortions() {
    let checks = lenses().map(|lens| {
        let image = Image::noise(PixelFormat::I420, 120, 80, 1, 9);
        let mut picture = Picture::new(0, 0);
        let pictures = [120, 50, 24].map(|width| {
            let camera = lens.pinhole_at(width);
            let mut converter = Converter::undistorting(&lens, &camera).unwrap();
            converter.convert(&image.view(), &mut picture).unwrap();
            picture.data.clone()
        });
        crc32fast::hash(&pictures.concat())
    });
    assert_eq!(checks, [0x4cae6ed2, 0x4c4fc507, 0x9588e71d, 0x625886c0]);
}

#[test]
fn lenses_that_do_not_fit_are_refused() {
    let [lens, ..] = lenses();
    let mut converter = Converter::undistorting(&lens, &lens.pinhole()).unwrap();
    let mut picture = Picture::new(3, 3);
    let small = Image::noise(PixelFormat::Rgb8, 60, 40, 0, 1);
    let refused = converter.convert(&small.view(), &mut picture).unwrap_err();
    assert_eq!(refused.to_string(), "image of 60×40, but the lens is for images of 120×80");
    assert_eq!((picture.width, picture.height), (3, 3));
    // It looks past the picture.
    let aside = Camera { cx: 1e5, ..lens.pinhole() };
    assert!(matches!(Converter::undistorting(&lens, &aside), Err(LensError::Nothing)));
    let large = Intrinsics { width: 20_000, height: 8, fx: 85.0, fy: 86.0, cx: 61.0, cy: 3.0 };
    let large = Lens::new(large, Distortion::None).unwrap();
    assert!(matches!(Converter::undistorting(&large, &aside), Err(LensError::Side { .. })));
    let folds = Intrinsics { width: 120, height: 80, fx: 40.0, fy: 40.0, cx: 60.0, cy: 40.0 };
    let folds = Lens::new(folds, Distortion::brown(&[-0.5, 0.0, 0.0, 0.0]).unwrap()).unwrap();
    let refused = Converter::undistorting(&folds, &folds.pinhole()).map(|_| ()).unwrap_err();
    assert!(refused.to_string().starts_with("the picture's corner (0, 0) has no ray"), "{refused}");
}

#[test]
fn refusals_name_what_is_wrong() {
    let image = Image::noise(PixelFormat::Nv12, 8, 6, 0, 1);
    let mut picture = Picture::new(8, 6);
    let mut refused = |view: ImageView| {
        Converter::new(8, 6).unwrap().convert(&view, &mut picture).unwrap_err().to_string()
    };
    let view = image.view();
    assert_eq!(
        refused(ImageView { width: 0, ..view }),
        "image size 0×6: sides must lie in 1..=16384"
    );
    assert_eq!(
        refused(ImageView { strides: [8, 7, 0], ..view }),
        "plane UV: a stride of 7 bytes, but a row takes 8"
    );
    assert_eq!(
        refused(ImageView { planes: [view.planes[0], &view.planes[1][1..], &[]], ..view }),
        "plane UV: 23 bytes, but 24 are due"
    );
    assert_eq!(
        refused(ImageView { height: 5, ..view }),
        "image of 8×5 is of another shape than the camera's 8×6; scaling would distort it"
    );
    let size = Err(PixelError::Size { width: 4097, height: 1, max: Camera::MAX_SIDE });
    assert_eq!(Converter::new(4097, 1).map(|_| ()), size);
    assert!(Converter::new(5, 0).is_err());
}

#[test]
fn pictures_are_written_between_the_canaries() {
    let picture = Picture::from_rgb(2, 2, (1..13).collect()).unwrap();
    let written = |format, stride, len| {
        let mut bytes = vec![CANARY; len];
        write_picture(&picture, format, stride, &mut bytes).map(|()| bytes)
    };
    const C: u8 = CANARY;
    let rgb = vec![1, 2, 3, 4, 5, 6, C, 7, 8, 9, 10, 11, 12];
    assert_eq!(written(PixelFormat::Rgb8, 7, 13), Ok(rgb));
    let bgr = vec![3, 2, 1, 6, 5, 4, 9, 8, 7, 12, 11, 10, C];
    assert_eq!(written(PixelFormat::Bgr8, 6, 13), Ok(bgr));
    let rgba =
        vec![1, 2, 3, 255, 4, 5, 6, 255, C, C, C, C, 7, 8, 9, 255, 10, 11, 12, 255, C, C, C, C];
    assert_eq!(written(PixelFormat::Rgba8, 12, 24), Ok(rgba));
    let short = PixelError::TooShort { plane: "RGB", needed: 13, found: 12 };
    assert_eq!(written(PixelFormat::Rgb8, 7, 12), Err(short));
    let stride = PixelError::Stride { plane: "RGBA", needed: 8, found: 7 };
    assert_eq!(written(PixelFormat::Rgba8, 7, 99), Err(stride));
    let format = PixelError::NotWritten(PixelFormat::Nv12);
    assert_eq!(written(PixelFormat::Nv12, 7, 99), Err(format));
    let lying = Picture { width: 2, height: 3, data: vec![0; 17] };
    let mut bytes = vec![CANARY; 18];
    assert!(write_picture(&lying, PixelFormat::Rgb8, 6, &mut bytes).is_err());
    assert_eq!(bytes, [CANARY; 18]);
    assert!(write_picture(&Picture::new(0, 3), PixelFormat::Rgb8, 6, &mut bytes).is_err());
}

fn side() -> impl Strategy<Value = u32> {
    prop_oneof![8 => 0..40u32, 1 => 16380..16390u32, 1 => any::<u32>()]
}

fn stride() -> impl Strategy<Value = usize> {
    prop_oneof![8 => 0..200usize, 1 => any::<usize>(), 1 => Just(usize::MAX)]
}

/// What [`ImageView::check`] should say, in numbers that cannot overflow.
fn fits(view: &ImageView) -> bool {
    let (width, height) = (u128::from(view.width), u128::from(view.height));
    let half = |v: u128| v.div_ceil(2);
    let planes = match view.format {
        PixelFormat::Rgb8 | PixelFormat::Bgr8 => vec![(width * 3, height)],
        PixelFormat::Rgba8 => vec![(width * 4, height)],
        PixelFormat::Nv12 => vec![(width, height), (half(width) * 2, half(height))],
        PixelFormat::I420 => {
            vec![(width, height), (half(width), half(height)), (half(width), half(height))]
        }
    };
    let sides = 1..=16384;
    sides.contains(&width)
        && sides.contains(&height)
        && planes.iter().zip(view.planes).zip(view.strides).all(
            |((&(row, rows), plane), stride)| {
                stride as u128 >= row && plane.len() as u128 >= stride as u128 * (rows - 1) + row
            },
        )
}

proptest! {
    #[test]
    fn arbitrary_views_are_judged_rightly(
        (width, height) in (side(), side()),
        format in prop::sample::select(&FORMATS[..]),
        strides in [stride(), stride(), stride()],
        lengths in [0..4000usize, 0..4000usize, 0..4000usize],
        exact in any::<bool>(),
    ) {
        let bytes = vec![77; 1 << 17];
        let planes = lengths.map(|len| &bytes[..len]);
        let colour = Colour::default();
        let mut view = ImageView { width, height, format, colour, planes, strides };
        if exact {
            // At the very end of the last row, or a byte before it.
            for (i, plane) in format.planes().iter().enumerate() {
                let (columns, rows) = plane.size(width.clamp(1, 40), height.clamp(1, 40));
                let needed = (strides[i] % 200)
                    .saturating_mul(rows as usize - 1)
                    .saturating_add(columns as usize * plane.step);
                view.strides[i] = strides[i] % 200;
                view.planes[i] = &bytes[..needed.saturating_sub(lengths[i] % 2)];
            }
        }
        prop_assert_eq!(view.check().is_ok(), fits(&view));
        let mut picture = Picture::new(1, 1);
        let mut converter = Converter::new(width.clamp(1, 40), height.clamp(1, 40)).unwrap();
        if let Err(error) = converter.convert(&view, &mut picture) {
            let other_shape = matches!(error, PixelError::Shape { .. });
            prop_assert!(other_shape || !fits(&view));
            prop_assert_eq!(picture, Picture::new(1, 1));
        }
    }

    #[test]
    fn arbitrary_buffers_are_written_or_refused(
        (width, height) in (0..9u32, 0..9u32),
        format in prop::sample::select(&FORMATS[..]),
        stride in stride(),
        len in 0..400usize,
    ) {
        let mut bytes = vec![CANARY; len];
        let written = write_picture(&Picture::new(width, height), format, stride, &mut bytes);
        let rgb = format.planes().len() == 1;
        let view = ImageView::packed(width, height, format, &bytes, stride);
        prop_assert_eq!(written.is_ok(), rgb && fits(&view));
        if written.is_err() {
            prop_assert!(bytes.iter().all(|&b| b == CANARY));
        }
    }

    #[test]
    fn arbitrary_sizes_are_near_the_oracle(
        (w, h, times) in (1..40u32, 1..40u32, 1..4u32),
        grow in any::<bool>(),
        format in prop::sample::select(&FORMATS[..]),
        colour in prop::sample::select(&COLOURS[..]),
        seed in any::<u32>(),
    ) {
        let (from, to) = if grow { (1, times) } else { (times, 1) };
        let mut image = Image::noise(format, w * from, h * from, 1, u64::from(seed));
        image.colour = colour;
        assert_near_oracle(&image, w * to, h * to);
    }
}
