//! Whether a frame shows what the prior shows at a pose: block by block, whatever the light.
//!
//! Both pictures' luma, at half the size, is compared in blocks of 8×8 by normalised cross-correlation,
//! which gain and offset do not change. Blocks count by the deviation of the render's luma: if the prior
//! shows nothing, the frame cannot confirm it. At a wrong pose a part of the scene may agree all the same,
//! such as a far wall behind what is near: the tracker looks for other poses unless nearly all agrees.

use crate::render::Correction;

/// Side of a block, pixels of half the picture's size.
const BLOCK: usize = 8;
/// Blocks agree from this correlation on.
const AGREES: f64 = 0.5;
/// The share of what the prior shows, that must agree: half of the picture may be covered by something new.
const CONFIRMED: f64 = 0.4;
/// Variance of the noise of a pixel at half size: that of 8 bits and a little more, values in [0, 255].
const NOISE: f64 = 0.12;
/// Fewest blocks by which a pose is judged.
const BLOCKS: f64 = 8.0;
/// Least mean deviation of the render's luma in its blocks, values in [0, 255]: with less, there is nothing
/// to be confirmed.
const PLAIN: f64 = 0.5;
/// Least range, as deviations, of a channel from which its light can be told, values in [0, 255].
const RANGE: f64 = 3.0;
/// The light is taken to be the prior's if its gain and offset differ by less.
const SAME_GAIN: f64 = 0.3;
const SAME_OFFSET: f64 = 0.1;

/// How a frame and a render agree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Share of what the prior shows that the frame shows too, 0 to 1; 0 if the prior shows nothing.
    pub share: f64,
    /// Whether the prior shows enough, and the pictures are large enough, to confirm or refute a pose.
    pub tells: bool,
    /// What brings the frame's light to the prior's, by the blocks that agree; `None` if it cannot be told.
    pub correction: Option<Correction>,
}

impl Agreement {
    /// Of two 8-bit RGB pictures of a size, row by row.
    ///
    /// # Panics
    /// If a picture has not `3 · width · height` bytes.
    pub fn of(frame: &[u8], render: &[u8], width: usize, height: usize) -> Agreement {
        assert_eq!((frame.len(), render.len()), (3 * width * height, 3 * width * height), "bytes");
        let (mut seen, mut agreeing, mut blocks) = (0.0, 0.0, 0.0);
        let mut light = [Sums::default(); 3];
        for top in (0..height / 2 / BLOCK).map(|y| 2 * BLOCK * y) {
            for left in (0..width / 2 / BLOCK).map(|x| 2 * BLOCK * x) {
                let block = Block::of(frame, render, width, left, top);
                let luma = block.luma;
                seen += luma.render_deviation();
                blocks += 1.0;
                if luma.correlation() > AGREES {
                    agreeing += luma.render_deviation();
                    light.iter_mut().zip(&block.channels).for_each(|(to, of)| to.add(of));
                }
            }
        }
        let tells = blocks >= BLOCKS && seen > PLAIN * blocks;
        let share = if tells { agreeing / seen } else { 0.0 };
        Agreement { share, tells, correction: if tells { correction(&light) } else { None } }
    }

    /// Whether the frame confirms the pose.
    pub fn confirms(&self) -> bool {
        self.share >= CONFIRMED
    }
}

/// The correction of the channels' light; none if the light is the prior's.
fn correction(light: &[Sums; 3]) -> Option<Correction> {
    let mut correction = Correction::NONE;
    let mut same = true;
    for (channel, sums) in light.iter().enumerate() {
        let (gain, offset) = sums.light()?;
        same &= (gain - 1.0).abs() < SAME_GAIN && offset.abs() < SAME_OFFSET;
        correction.factor[channel] = (1.0 / gain) as f32;
        correction.summand[channel] = (-offset / gain) as f32;
    }
    Some(if same { Correction::NONE } else { correction })
}

/// Sums over pixels at half size, values in [0, 255].
#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    frame: f64,
    render: f64,
    frame_square: f64,
    render_square: f64,
    product: f64,
}

impl Sums {
    fn note(&mut self, frame: f64, render: f64) {
        self.count += 1.0;
        self.frame += frame;
        self.render += render;
        self.frame_square += frame * frame;
        self.render_square += render * render;
        self.product += frame * render;
    }

    fn add(&mut self, other: &Sums) {
        self.count += other.count;
        self.frame += other.frame;
        self.render += other.render;
        self.frame_square += other.frame_square;
        self.render_square += other.render_square;
        self.product += other.product;
    }

    fn frame_variance(&self) -> f64 {
        self.frame_square / self.count - (self.frame / self.count).powi(2)
    }

    fn render_variance(&self) -> f64 {
        self.render_square / self.count - (self.render / self.count).powi(2)
    }

    fn render_deviation(&self) -> f64 {
        self.render_variance().max(0.0).sqrt()
    }

    fn covariance(&self) -> f64 {
        self.product / self.count - self.frame / self.count * (self.render / self.count)
    }

    fn correlation(&self) -> f64 {
        let spread = (self.frame_variance() + NOISE) * (self.render_variance() + NOISE);
        self.covariance() / spread.sqrt()
    }

    /// Gain and offset (values in [0, 1]) by which the render's light becomes the frame's: as far as both
    /// spread (reduced major axis), so that what the prior shows otherwise does not count as darkness.
    fn light(&self) -> Option<(f64, f64)> {
        let told = self.count > 0.0 && self.render_variance() > RANGE * RANGE;
        let gain = ((self.frame_variance() - NOISE).max(0.0) / self.render_variance()).sqrt();
        let sound = told && self.covariance() > 0.0 && gain > 0.02 && gain < 50.0;
        sound.then(|| (gain, (self.frame - gain * self.render) / self.count / 255.0))
    }
}

/// One block of both pictures.
struct Block {
    channels: [Sums; 3],
    luma: Sums,
}

impl Block {
    fn of(frame: &[u8], render: &[u8], width: usize, left: usize, top: usize) -> Block {
        let mut block = Block { channels: [Sums::default(); 3], luma: Sums::default() };
        for y in (top..top + 2 * BLOCK).step_by(2) {
            for x in (left..left + 2 * BLOCK).step_by(2) {
                let at = 3 * (y * width + x);
                let (f, r) = (mean(frame, at, width), mean(render, at, width));
                for (channel, sums) in block.channels.iter_mut().enumerate() {
                    sums.note(f[channel], r[channel]);
                }
                block.luma.note(luma(&f), luma(&r));
            }
        }
        block
    }
}

/// Mean of two by two pixels, by channel.
fn mean(picture: &[u8], at: usize, width: usize) -> [f64; 3] {
    let next = at + 3 * width;
    std::array::from_fn(|c| {
        let four = [at + c, at + 3 + c, next + c, next + 3 + c].map(|i| u32::from(picture[i]));
        f64::from(four.iter().sum::<u32>()) * 0.25
    })
}

/// Luma of R, G, B (ITU-R BT.601).
fn luma(rgb: &[f64; 3]) -> f64 {
    0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (64, 48);

    /// Smooth noise.
    fn picture(seed: u32) -> Vec<u8> {
        let value = |i: usize, j: usize| {
            let mut z = (i as u32).wrapping_mul(0x9e37_79b9) ^ (j as u32).wrapping_mul(0x85eb_ca6b);
            z = (z ^ seed ^ (z >> 15)).wrapping_mul(0xc2b2_ae35);
            f64::from((z ^ (z >> 13)) as u8)
        };
        let at = |i: usize| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let (ax, ay) = ((x % 5) as f64 / 5.0, (y % 5) as f64 / 5.0);
            let along = |j| value(x / 5, j) * (1.0 - ax) + value(x / 5 + 1, j) * ax;
            along(y / 5) * (1.0 - ay) + along(y / 5 + 1) * ay
        };
        (0..SIZE.0 * SIZE.1)
            .flat_map(|i| [at(i), 0.8 * at(i), 0.5 * at(i) + 20.0])
            .map(|v| v as u8)
            .collect()
    }

    fn lit(picture: &[u8], gain: f64, offset: f64) -> Vec<u8> {
        picture.iter().map(|v| (f64::from(*v) * gain + offset * 255.0).round() as u8).collect()
    }

    fn agreement(frame: &[u8], render: &[u8]) -> Agreement {
        Agreement::of(frame, render, SIZE.0, SIZE.1)
    }

    #[test]
    fn light_does_not_matter_and_is_told() {
        let render = picture(1);
        for (gain, offset) in [(1.0, 0.0), (0.25, 0.0), (0.2, 0.3), (0.6, 0.1)] {
            let found = agreement(&lit(&render, gain, offset), &render);
            assert!(found.share > 0.99 && found.confirms(), "{gain} {offset}: {}", found.share);
            let correction = found.correction.unwrap();
            for channel in 0..3 {
                let value = |v: f64| correction.of(channel, (v * gain + offset) as f32);
                assert!((value(0.2) - 0.2).abs() < 0.02 && (value(0.6) - 0.6).abs() < 0.03);
            }
        }
        assert_eq!(agreement(&render, &render).correction, Some(Correction::NONE));
    }

    #[test]
    fn another_picture_confirms_nothing() {
        let found = agreement(&picture(2), &picture(1));
        assert!(found.share < 0.25 && !found.confirms(), "{}", found.share);
    }

    #[test]
    fn half_a_picture_is_enough_and_an_eighth_is_not() {
        let render = picture(1);
        for (rows, confirmed) in [(24, true), (6, false)] {
            let mut frame = picture(3);
            let shown = 3 * SIZE.0 * rows;
            frame[..shown].copy_from_slice(&render[..shown]);
            assert_eq!(agreement(&frame, &render).confirms(), confirmed, "{rows} rows");
        }
    }

    #[test]
    fn what_shows_nothing_confirms_nothing() {
        let (flat, textured) = (vec![90; 3 * SIZE.0 * SIZE.1], picture(1));
        for (frame, render) in [(&flat, &flat), (&flat, &textured), (&textured, &flat)] {
            assert!(!agreement(frame, render).confirms());
        }
        assert!(!Agreement::of(&[0; 9], &[0; 9], 3, 1).confirms());
    }
}
