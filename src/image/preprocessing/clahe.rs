//! Contrast-limited adaptive histogram equalisation of the luma.

use std::ops::Range;

use crate::Picture;

/// Contrast-limited adaptive histogram equalisation (Zuiderveld 1994), as OpenCV does it, with three differences: tiles
/// are as equal as whole pixels allow, where OpenCV adds mirrored pixels; the clip limit is not rounded to whole
/// pixels; and tiles are as far apart as their middles.
///
/// It changes the luma `Y = 0.299 R + 0.587 G + 0.114 B` and adds the luma's change to all three channels: the
/// differences of the channels (chroma) stay, unless a channel reaches 0 or 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clahe {
    pub(super) clip_limit: f32,
    pub(super) tiles: u8,
}

impl Default for Clahe {
    /// Clip limit 2, 8×8 tiles.
    fn default() -> Self {
        Clahe { clip_limit: 2.0, tiles: Clahe::TILES }
    }
}

impl Clahe {
    /// The usual number of tiles along either side.
    pub const TILES: u8 = 8;
    /// Most tiles along either side.
    pub const MAX_TILES: u8 = 32;
    /// The largest clip limit: with it nothing is clipped.
    pub const MAX_CLIP_LIMIT: f32 = 256.0;

    /// `clip_limit`: how much larger than the mean a bin of a tile's histogram may be, 1 to 256; so the contrast grows
    /// by this factor at most. It is rounded to 1/256. `tiles`: along either side of the picture, 1 to 32. A side of
    /// fewer pixels than that has a tile per pixel.
    pub fn new(clip_limit: f32, tiles: u8) -> Result<Clahe, PreprocessingError> {
        if !(1.0..=Self::MAX_CLIP_LIMIT).contains(&clip_limit) {
            return Err(PreprocessingError::ClipLimit { found: clip_limit });
        }
        if !(1..=Self::MAX_TILES).contains(&tiles) {
            return Err(PreprocessingError::Tiles { found: tiles });
        }
        Ok(Clahe { clip_limit: (clip_limit * 256.0).round() / 256.0, tiles })
    }

    /// How much larger than the mean a bin of a tile's histogram may be.
    pub fn clip_limit(&self) -> f32 {
        self.clip_limit
    }

    /// Tiles along either side of the picture.
    pub fn tiles(&self) -> u8 {
        self.tiles
    }
}

/// Why there is no such preprocessing.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum PreprocessingError {
    #[error("CLAHE with a clip limit of {found}: at least 1, at most {}", Clahe::MAX_CLIP_LIMIT)]
    ClipLimit { found: f32 },
    #[error("CLAHE with {found} tiles along a side: at least 1, at most {}", Clahe::MAX_TILES)]
    Tiles { found: u8 },
}

/// Levels of luma, and bins of a histogram.
const LEVELS: usize = 256;

/// Fractional bits of the luma's weights, and of a tile's weight at a pixel.
const LUMA_BITS: u32 = 16;
const WEIGHT_BITS: u32 = 12;
const ONE: u32 = 1 << WEIGHT_BITS;

/// Weights of red, green and blue in the luma, ITU-R BT.601-7; they sum to one.
const LUMA: [u32; 3] = [19_595, 38_470, 7_471];

/// What a tile makes of each level.
type Curve = [u8; LEVELS];

/// Equalises pictures. Keeps what that takes.
pub(super) struct Equaliser {
    clahe: Clahe,
    /// Down and across the picture.
    sides: [Side; 2],
    luma: Vec<u8>,
    /// Curves of the tiles, row by row.
    curves: Vec<Curve>,
}

impl Equaliser {
    pub fn new(clahe: Clahe) -> Equaliser {
        let max = usize::from(clahe.tiles);
        let curves = Vec::with_capacity(max * max);
        Equaliser { clahe, sides: Default::default(), luma: Vec::new(), curves }
    }

    /// Equalises a picture of at least one pixel. `counts`: which pixels make the histograms; `None`: all do.
    pub fn apply(&mut self, picture: &mut Picture, counts: Option<&[bool]>) {
        let sides = [picture.height, picture.width];
        for (side, pixels) in self.sides.iter_mut().zip(sides) {
            side.fit(pixels, self.clahe.tiles.into());
        }
        self.luma.clear();
        self.luma.extend(picture.data.chunks_exact(3).map(luma));
        self.fit_curves(counts);
        self.map(picture);
    }

    /// Makes the tiles' curves. A tile of which no pixel counts has that of the whole picture.
    fn fit_curves(&mut self, counts: Option<&[bool]>) {
        let [down, across] = &self.sides;
        let clip_limit = (self.clahe.clip_limit * 256.0) as u64;
        self.curves.clear();
        for rows in 0..down.tiles() {
            for columns in 0..across.tiles() {
                let mut histogram = self.histogram(down.span(rows), across.span(columns), counts);
                if histogram.iter().all(|count| *count == 0) {
                    histogram = self.histogram(0..down.pixels(), 0..across.pixels(), counts);
                }
                self.curves.push(curve(&histogram, clip_limit));
            }
        }
    }

    /// The histogram of a part of the picture.
    fn histogram(
        &self,
        rows: Range<usize>,
        columns: Range<usize>,
        counts: Option<&[bool]>,
    ) -> [u32; LEVELS] {
        let width = self.sides[1].pixels();
        let mut histogram = [0; LEVELS];
        for y in rows {
            let row = y * width + columns.start..y * width + columns.end;
            match counts {
                None => self.luma[row].iter().for_each(|v| histogram[usize::from(*v)] += 1),
                Some(counts) => {
                    let pixels = self.luma[row.clone()].iter().zip(&counts[row]);
                    for (level, _) in pixels.filter(|(_, counts)| **counts) {
                        histogram[usize::from(*level)] += 1;
                    }
                }
            }
        }
        histogram
    }

    /// Maps each pixel by the curves of the four tiles around it.
    fn map(&self, picture: &mut Picture) {
        let [down, across] = &self.sides;
        let rows = picture.data.chunks_exact_mut(3 * across.pixels());
        let lumas = self.luma.chunks_exact(across.pixels());
        for ((row, lumas), v) in rows.zip(lumas).zip(&down.places) {
            let curves = |tile: u16| &self.curves[usize::from(tile) * across.tiles()..];
            let (above, below) = (curves(v.first), curves(v.second));
            for ((rgb, luma), u) in row.chunks_exact_mut(3).zip(lumas).zip(&across.places) {
                let (left, right) = (usize::from(u.first), usize::from(u.second));
                let level = usize::from(*luma);
                let along = |tiles: &[Curve]| {
                    u.blend(tiles[left][level].into(), tiles[right][level].into())
                };
                let mapped = v.blend(along(above), along(below));
                let mapped = (mapped + (1 << (2 * WEIGHT_BITS - 1))) >> (2 * WEIGHT_BITS);
                let change = mapped as i32 - i32::from(*luma);
                for value in rgb {
                    *value = (i32::from(*value) + change).clamp(0, 255) as u8;
                }
            }
        }
    }

    /// Where the buffers lie, and their capacities.
    #[cfg(test)]
    pub fn buffers(&self) -> Vec<(usize, usize)> {
        let places =
            self.sides.iter().map(|side| (side.places.as_ptr() as usize, side.places.capacity()));
        let own = [
            (self.luma.as_ptr() as usize, self.luma.capacity()),
            (self.curves.as_ptr() as usize, self.curves.capacity()),
        ];
        places.chain(own).collect()
    }
}

/// The luma of a pixel, rounded.
fn luma(rgb: &[u8]) -> u8 {
    let sum: u32 = rgb.iter().zip(LUMA).map(|(value, weight)| u32::from(*value) * weight).sum();
    ((sum + (1 << (LUMA_BITS - 1))) >> LUMA_BITS) as u8
}

/// A tile's curve: the sums of its histogram, clipped and brought to 0..=255. What is clipped is spread evenly over all
/// bins. `clip_limit` in 1/256 of the mean bin.
fn curve(histogram: &[u32; LEVELS], clip_limit: u64) -> Curve {
    let area: u64 = histogram.iter().map(|count| u64::from(*count)).sum();
    // In 2⁻¹⁶ pixels the limit is a whole number. An area is below 2³², so that all products stay below 2⁶⁴.
    let clipped = histogram.map(|count| (u64::from(count) << 16).min(clip_limit * area));
    let excess = (area << 16) - clipped.iter().sum::<u64>();
    let (all, mut sum) = (area << 24, 0);
    let mut level = 0;
    clipped.map(|count| {
        (sum, level) = (sum + count, level + 1);
        let share = (sum << 8) + excess * level;
        ((255 * share + all / 2) / all) as u8
    })
}

/// A side of a picture, divided into tiles.
#[derive(Default)]
struct Side {
    tiles: usize,
    /// For each pixel.
    places: Vec<BetweenTiles>,
}

/// Where a pixel lies between two tiles' middles.
struct BetweenTiles {
    first: u16,
    second: u16,
    /// The weight of the second.
    weight: u32,
}

impl BetweenTiles {
    /// Between the values of the first tile and the second; adds [`WEIGHT_BITS`].
    fn blend(&self, first: u32, second: u32) -> u32 {
        first * (ONE - self.weight) + second * self.weight
    }
}

impl Side {
    /// Divides a side into so many tiles, or one per pixel if it has fewer.
    fn fit(&mut self, pixels: u32, tiles: usize) {
        if self.places.len() == pixels as usize {
            return;
        }
        self.places.clear();
        self.tiles = tiles.min(pixels as usize);
        for pixel in 0..pixels as usize {
            let place = self.place(pixel, pixels as usize);
            self.places.push(place);
        }
    }

    fn place(&self, pixel: usize, pixels: usize) -> BetweenTiles {
        // In half pixels.
        let at = 2 * pixel + 1;
        let middle = |tile: usize| {
            let span = self.bounds(tile, pixels);
            span.start + span.end
        };
        let second = (0..self.tiles).find(|tile| middle(*tile) > at).unwrap_or(self.tiles);
        let (first, last) = (second.saturating_sub(1), self.tiles - 1);
        if second == 0 || second == self.tiles {
            let tile = if second == 0 { 0 } else { last } as u16;
            return BetweenTiles { first: tile, second: tile, weight: 0 };
        }
        let (from, to) = (middle(first), middle(second));
        let weight = ((at - from) * ONE as usize + (to - from) / 2) / (to - from);
        BetweenTiles { first: first as u16, second: second as u16, weight: weight as u32 }
    }

    fn bounds(&self, tile: usize, pixels: usize) -> std::ops::Range<usize> {
        tile * pixels / self.tiles..(tile + 1) * pixels / self.tiles
    }

    /// The pixels of a tile; at least one.
    fn span(&self, tile: usize) -> std::ops::Range<usize> {
        self.bounds(tile, self.pixels())
    }

    fn pixels(&self) -> usize {
        self.places.len()
    }

    fn tiles(&self) -> usize {
        self.tiles
    }
}
