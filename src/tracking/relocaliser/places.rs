//! Pictures without poses that show the same place: each one's corners vote for the pictures before it.

use super::features::{Extractor, Feature};
use super::landmarks::Landmarks;

/// Most corners of a picture.
const FEATURES: usize = 400;

/// A picture that has corners in common with another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alike {
    /// Its number, in the order in which pictures were given.
    pub picture: u32,
    /// Corners of the other that look like one of its own.
    pub corners: u32,
}

/// Finds pictures of one size that show the same place. Turned pictures are found as well, and those in another light.
pub struct Places {
    extractor: Extractor,
    landmarks: Landmarks,
    features: Vec<Feature>,
    votes: Vec<(u32, u32)>,
}

impl Places {
    /// For about so many pictures of `width` × `height`.
    pub fn new(width: u32, height: u32, pictures: usize) -> Places {
        Places {
            extractor: Extractor::new(width as usize, height as usize, FEATURES),
            landmarks: Landmarks::with_room(pictures.max(1), FEATURES),
            features: Vec::with_capacity(FEATURES),
            votes: Vec::new(),
        }
    }

    /// Adds a picture by its luma: values in [0, 1], row by row. Returns the earlier pictures that have corners in
    /// common with it, those with most first.
    ///
    /// # Panics
    /// If the number of pixels is not that of the size.
    pub fn add(&mut self, luma: &[f32]) -> impl Iterator<Item = Alike> + '_ {
        self.extractor.extract(luma, &mut self.features);
        self.landmarks.vote(&self.features, &mut self.votes);
        let corners = self.features.iter().map(|feature| ([0.0; 3], feature.descriptor));
        self.landmarks.add(corners);
        self.votes.iter().map(|&(picture, corners)| Alike { picture, corners })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 160;
    const HEIGHT: usize = 90;

    /// A window on an endless texture of random squares, in some light.
    fn window(left: usize, gain: f32) -> Vec<f32> {
        let square = |x: usize, y: usize| {
            let number = ((x / 5) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
                ^ ((y / 5) as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
            (number.wrapping_mul(0xd6e8_feb8_6659_fd93) >> 40) as f32 / (1 << 24) as f32
        };
        (0..WIDTH * HEIGHT).map(|i| 0.1 + gain * square(left + i % WIDTH, i / WIDTH)).collect()
    }

    #[test]
    fn a_place_is_known_again() {
        let mut places = Places::new(WIDTH as u32, HEIGHT as u32, 8);
        for step in 0..6 {
            places.add(&window(1_000 * step, 0.8)).for_each(drop);
        }
        // Two fifths of it are what the picture of step 3 shows, in less light.
        let alike: Vec<Alike> = places.add(&window(3_000 + 95, 0.5)).collect();
        assert_eq!(alike[0].picture, 3, "{alike:?}");
        let others = alike.get(1).map_or(0, |other| other.corners);
        assert!(alike[0].corners >= 15 && alike[0].corners > 3 * others, "{alike:?}");
    }

    #[test]
    fn flat_pictures_are_like_nothing() {
        let mut places = Places::new(WIDTH as u32, HEIGHT as u32, 3);
        places.add(&window(0, 0.8)).for_each(drop);
        for _ in 0..2 {
            assert_eq!(places.add(&[0.5; WIDTH * HEIGHT]).count(), 0);
        }
    }
}
