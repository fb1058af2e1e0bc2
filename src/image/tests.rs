use proptest::prelude::*;

use super::*;
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
