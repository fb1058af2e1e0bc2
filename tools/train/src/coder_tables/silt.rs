//! Water with silt in it, in front of a frame: the prior saw the scene in clear water.

use nvsprior::Picture;
use nvsprior::random::Random;

/// How much light comes from the water, in the picture's middle and at its edge, at three levels of silt.
const VEILS: [(f32, f32); 3] = [(0.05, 0.12), (0.12, 0.3), (0.25, 0.55)];
/// Specks per 1000 pixels at these levels.
const SPECKS: [f32; 3] = [0.2, 0.6, 1.5];

/// Silt between camera and scene.
pub struct Silt {
    level: usize,
    /// Colour of the light that comes back from it, grey levels.
    colour: [f32; 3],
    /// Where it is thinnest, as shares of width and height.
    middle: [f32; 2],
}

impl Silt {
    /// Of one of three levels.
    pub fn some(random: &mut Random) -> Silt {
        let brightness = random.within(60.0, 160.0);
        Silt {
            level: (random.bits() % VEILS.len() as u64) as usize,
            colour: random.triple(0.75, 1.15).map(|channel| channel * brightness),
            middle: [random.within(0.3, 0.7), random.within(0.3, 0.7)],
        }
    }

    /// Puts it in front of a picture.
    pub fn apply(&self, picture: &mut Picture, random: &mut Random) {
        self.veil(picture);
        let pixels = (picture.width * picture.height) as f32;
        for _ in 0..(SPECKS[self.level] * pixels / 1000.0) as usize {
            speck(picture, random);
        }
    }

    /// Blends the picture towards the water's colour.
    fn veil(&self, picture: &mut Picture) {
        let (width, height) = (picture.width as f32, picture.height as f32);
        let (least, most) = VEILS[self.level];
        let row_len = picture.width as usize * 3;
        for (y, row) in picture.data.chunks_exact_mut(row_len).enumerate() {
            for (x, pixel) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let dx = x as f32 / width - self.middle[0];
                let dy = y as f32 / height - self.middle[1];
                let part = least + (most - least) * (2.0 * (dx * dx + dy * dy)).min(1.0);
                for (value, colour) in pixel.iter_mut().zip(self.colour) {
                    *value = blend(*value, colour, part);
                }
            }
        }
    }
}

/// A particle in the lamp's light: a bright spot, the wider the nearer it is.
fn speck(picture: &mut Picture, random: &mut Random) {
    let radius = random.within(0.5, 2.5);
    let opacity = random.within(0.15, 0.7) / radius;
    let light = random.within(140.0, 240.0);
    let centre = [picture.width, picture.height].map(|size| random.within(0.0, size as f32));
    let reach = (2.0 * radius).ceil();
    let range = |centre: f32, size: u32| {
        (centre - reach).max(0.0) as u32..((centre + reach).ceil() as u32).min(size)
    };
    for y in range(centre[1], picture.height) {
        for x in range(centre[0], picture.width) {
            let (dx, dy) = (x as f32 - centre[0], y as f32 - centre[1]);
            let part = opacity * (-(dx * dx + dy * dy) / (radius * radius)).exp();
            let start = 3 * (y * picture.width + x) as usize;
            for value in &mut picture.data[start..start + 3] {
                *value = blend(*value, light, part);
            }
        }
    }
}

fn blend(value: u8, towards: f32, part: f32) -> u8 {
    let value = f32::from(value);
    (value + (towards - value) * part).round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (48, 27);

    /// A black picture behind silt of a level.
    fn seen(level: usize, colour: f32) -> Picture {
        let mut picture = Picture::new(SIZE.0, SIZE.1);
        let silt = Silt { level, colour: [colour; 3], middle: [0.5, 0.5] };
        silt.apply(&mut picture, &mut Random::new(3));
        picture
    }

    fn at(picture: &Picture, x: u32, y: u32) -> u8 {
        picture.data[3 * (y * picture.width + x) as usize]
    }

    #[test]
    fn more_silt_gives_more_light_and_most_at_the_edge() {
        let mean = |picture: &Picture| {
            let sum: u32 = picture.data.iter().map(|value| u32::from(*value)).sum();
            sum / picture.data.len() as u32
        };
        let pictures = [0, 1, 2].map(|level| seen(level, 120.0));
        assert!(pictures.windows(2).all(|two| mean(&two[0]) < mean(&two[1])));
        for picture in &pictures {
            assert!(at(picture, 0, 0) > at(picture, SIZE.0 / 2, SIZE.1 / 2));
        }
    }

    #[test]
    fn specks_are_bright_spots() {
        // The light of the water is none here, so all that is seen is specks.
        let picture = seen(2, 0.0);
        let lit = picture.data.iter().filter(|value| **value > 10).count();
        assert!((1..picture.data.len() / 2).contains(&lit), "{lit}");
    }

    #[test]
    fn the_smallest_picture_holds_silt() {
        let mut picture = Picture::new(1, 1);
        let mut random = Random::new(1);
        for _ in 0..20 {
            Silt::some(&mut random).apply(&mut picture, &mut random);
            speck(&mut picture, &mut random);
        }
        assert!(picture.data.iter().any(|value| *value > 0));
    }
}
