//! The picture as video shows it: large, with the overlay, its age and what the vehicle says of its pose drawn in.

use std::convert::Infallible;

use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::MonoTextStyleBuilder;
use embedded_graphics::mono_font::ascii::FONT_10X20;
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use nvsprior::Picture;
use nvsprior::truth;

use super::overlay::Overlay;
use super::state::PoseState;

/// Pictures are made larger by a whole number, up to about this width, so that patterns and words can be read.
const WIDTH: u32 = 1280;
/// Side of a block of the overlay, pixels of the picture.
const BLOCK: usize = truth::BLOCK as usize;
/// After how many pixels a pattern repeats.
const REPEAT: usize = 12;
/// How much of its colour a block takes beside its pattern, of 256.
const TINT: u32 = 56;

const TEXT: [u8; 3] = [0xe8, 0xec, 0xef];
const DIFFERS: [u8; 3] = [0xf0, 0xe4, 0x42];
const WRONG: [u8; 3] = [0xcc, 0x79, 0xa7];
const DOUBT: [u8; 3] = [0xe6, 0x9f, 0x00];
const MEMORY: [u8; 3] = [0x98, 0xa4, 0xae];
const LOST: [u8; 3] = [0xff, 0x6a, 0x3d];
/// What the patterns of the levels 1 to 7 mean.
const LEGEND: [&str; 7] = [
    "dots: differs",
    "stripes: wrong",
    "corners: memory",
    "crosses: doubtful memory",
    "bars: never mapped",
    "small dots: differed",
    "dashes: was wrong",
];

/// A picture of a video's size: its width a multiple of four, its height of two, as coders of video take them.
pub fn enlarged(picture: &Picture) -> Picture {
    let scale = (WIDTH / picture.width.max(1)).max(1);
    let [width, height] = [picture.width * scale, picture.height * scale];
    let [width, height] = [(width & !3).max(4), (height & !1).max(2)];
    let Some(image) =
        image::RgbImage::from_raw(picture.width, picture.height, picture.data.clone())
    else {
        return Picture::new(width, height);
    };
    let large =
        image::imageops::resize(&image, width, height, image::imageops::FilterType::Triangle);
    Picture { width, height, data: large.into_raw() }
}

/// Draws the overlay's patterns into a picture that was made larger from `from` pixels of width.
pub fn draw_overlay(picture: &mut Picture, overlay: &Overlay, from: u32) {
    let (width, from) = (picture.width as usize, from as usize);
    for (index, pixel) in picture.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let (x, y) = (index % width, index / width);
        let block = |at: usize| at * from / width / BLOCK;
        let level = overlay.levels.get(block(y) * overlay.columns + block(x));
        let (rising, falling) = ((x + y) % REPEAT, (x + REPEAT - y % REPEAT) % REPEAT);
        let (colour, on_pattern) = match level {
            Some(1) => (DIFFERS, (4..8).contains(&(x % REPEAT)) && (4..8).contains(&(y % REPEAT))),
            Some(2) => (WRONG, rising < 4),
            Some(3) => (MEMORY, rising < 2 && x % REPEAT < 5),
            Some(4) => (MEMORY, rising < 2 || falling < 2),
            Some(5) => (MEMORY, y % REPEAT < 5),
            Some(6) => (DIFFERS, (5..7).contains(&(x % REPEAT)) && (5..7).contains(&(y % REPEAT))),
            Some(7) => (WRONG, rising < 4 && x % REPEAT < 6),
            _ => continue,
        };
        let part = if on_pattern { 256 } else { TINT };
        for (to, ink) in pixel.iter_mut().zip(colour) {
            *to = ((u32::from(*to) * (256 - part) + u32::from(ink) * part) / 256) as u8;
        }
    }
}

/// Draws what stands over the picture: its age in seconds, what the vehicle says of its pose, and what the overlay's
/// patterns mean.
pub fn draw_words(
    picture: &mut Picture,
    age: f64,
    is_told: bool,
    pose: PoseState,
    overlay: Option<&Overlay>,
) {
    let at_least = if is_told { "" } else { "at least " };
    let (name, ground) = match pose {
        PoseState::Waiting => ("", None),
        PoseState::Certain => ("certain", None),
        PoseState::Searching => ("SEARCHING", Some(DOUBT)),
        PoseState::Lost => ("LOST: the place may be wrong", Some(LOST)),
    };
    let line = format!(" {at_least}{age:.1} s old  {name} ");
    let bottom = (picture.height / 2) as i32 - 22;
    write(picture, &line, Point::new(4, 4), ground);
    let has = |level: u8| overlay.is_some_and(|overlay| overlay.levels.contains(&level));
    let legend = (1..).zip(LEGEND).filter(|(level, _)| has(*level)).map(|(_, words)| words);
    let legend = legend.collect::<Vec<_>>().join("   ");
    let told = overlay.and_then(|overlay| overlay.told_ago);
    let ago = told.map_or(String::new(), |ago| format!(" {ago:.0} s ago"));
    if !legend.is_empty() {
        write(picture, &format!(" {legend}{ago} "), Point::new(4, bottom), None);
    }
}

fn write(picture: &mut Picture, line: &str, at: Point, ground: Option<[u8; 3]>) {
    let colour = |[r, g, b]: [u8; 3]| Rgb888::new(r, g, b);
    let ink = if ground.is_some() { Rgb888::BLACK } else { colour(TEXT) };
    let style: MonoTextStyle<Rgb888> = MonoTextStyleBuilder::new()
        .font(&FONT_10X20)
        .text_color(ink)
        .background_color(ground.map_or(Rgb888::BLACK, colour))
        .build();
    // What lies outside is left out, and nothing else can fail.
    let Ok(_) = Text::with_baseline(line, at, style, Baseline::Top).draw(&mut Doubled(picture));
}

/// Draws each pixel as two by two.
struct Doubled<'a>(&'a mut Picture);

impl OriginDimensions for Doubled<'_> {
    fn size(&self) -> Size {
        Size::new(self.0.width / 2, self.0.height / 2)
    }
}

impl DrawTarget for Doubled<'_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = Pixel<Rgb888>>,
    {
        let Picture { width, height, data } = &mut *self.0;
        for Pixel(Point { x, y }, colour) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { continue };
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (2 * x + i, 2 * y + j)) {
                if x < *width && y < *height {
                    let first = 3 * (y * *width + x) as usize;
                    data[first..first + 3].copy_from_slice(&[colour.r(), colour.g(), colour.b()]);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, height: u32) -> Picture {
        Picture { width, height, data: vec![100; 3 * (width * height) as usize] }
    }

    #[test]
    fn sizes_are_those_that_coders_take() {
        for (width, height) in [(320, 180), (1, 1), (333, 77), (1920, 1081)] {
            let large = enlarged(&grey(width, height));
            assert_eq!((large.width % 4, large.height % 2), (0, 0), "{width}x{height}");
            assert_eq!(large.data.len(), 3 * (large.width * large.height) as usize);
            assert!(large.data.iter().all(|value| *value == 100));
        }
        assert_eq!(enlarged(&grey(320, 180)).width, 1280);
    }

    #[test]
    fn each_level_has_its_pattern_where_its_block_is() {
        let mut large = enlarged(&grey(64, 32));
        let scale = (large.width / 64) as usize;
        let levels = vec![1, 2, 3, 4, 5, 6, 7, 0];
        let overlay = Overlay { columns: 4, levels, ..Default::default() };
        draw_overlay(&mut large, &overlay, 64);
        let side = BLOCK * scale;
        // By how much the red of a block's pixels has changed.
        let changes = |block: usize| {
            let (column, row) = (block % 4, block / 4);
            let at = |k: usize| {
                (row * side + k / side) * large.width as usize + column * side + k % side
            };
            let reds = (0..side * side).map(|k| large.data[3 * at(k)].abs_diff(100));
            reds.collect::<Vec<_>>()
        };
        assert!((0..7).all(|block| !changes(block).contains(&0)), "tinted all over");
        assert!(changes(7).iter().all(|change| *change == 0));
        let patterns: std::collections::BTreeSet<Vec<bool>> = (0..7)
            .map(|block| changes(block).into_iter().map(|change| change > 40).collect())
            .collect();
        assert_eq!(patterns.len(), 7);
    }

    #[test]
    fn words_are_drawn_and_those_that_do_not_fit_are_cut() {
        let overlay = |level| Overlay { columns: 1, levels: vec![level], ..Default::default() };
        let overlay_of_wrong = overlay(2);
        let wrong = Some(&overlay_of_wrong);
        let mut large = grey(640, 360);
        draw_words(&mut large, 3.25, true, PoseState::Certain, wrong);
        assert!(large.data.contains(&TEXT[0]) && large.data.contains(&0));
        let mut other = grey(640, 360);
        draw_words(&mut other, 9.75, true, PoseState::Certain, wrong);
        assert!(large != other, "the age is in it");
        // The legend has what the picture has.
        let mut bare = grey(640, 360);
        draw_words(&mut bare, 3.25, true, PoseState::Certain, Some(&overlay(0)));
        let lower = |picture: &Picture| picture.data[picture.data.len() / 2..].to_vec();
        assert!(lower(&bare) == lower(&grey(640, 360)) && lower(&large) != lower(&bare));
        draw_words(&mut grey(4, 2), 1e9, false, PoseState::Lost, wrong);
    }
}
