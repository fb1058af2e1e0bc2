//! The pictures as steps look at them: in the scene's light, and at each size that is trained at.

use crate::trainer::TrainingFrame;
use rayon::prelude::*;

use super::Exposure;
use crate::PosedPicture;

/// The pictures at the sizes in use.
pub struct Frames {
    /// How much smaller than the pictures the sizes are that the prior is trained for.
    reductions: Vec<u32>,
    /// How much all pictures are reduced while the training is young; 1: no more.
    coarse: u32,
    /// By size and picture.
    by_size: Vec<Vec<TrainingFrame>>,
}

/// What a step looks at.
pub struct Look<'a> {
    pub frame: &'a TrainingFrame,
    /// Side of the block of the picture's pixels that is a pixel of the frame.
    pub reduction: u32,
    /// Side of the block for the low-pass. A size that is trained for has its own: 1.
    pub low_pass: u32,
}

impl Frames {
    pub fn new(reductions: &[u32], coarse: u32) -> Frames {
        Frames { reductions: reductions.to_vec(), coarse, by_size: Vec::new() }
    }

    /// Reduces all pictures, or no more. Returns whether that is a change: then they must be [set](Self::set).
    pub fn reduce(&mut self, coarse: u32) -> bool {
        std::mem::replace(&mut self.coarse, coarse) != coarse
    }

    /// Takes the pictures, each without its exposure.
    pub fn set(&mut self, views: &[PosedPicture], exposures: &[Exposure]) {
        let reductions = match self.coarse {
            1 => &self.reductions[..],
            _ => std::slice::from_ref(&self.coarse),
        };
        let at_size = |reduction: u32| {
            let all = views.par_iter().zip(exposures);
            let frame = |(view, exposure): (&PosedPicture, &Exposure)| match reduction {
                1 => exposure.undone(view),
                _ => exposure.undone(view).reduced(view.camera.width as usize, reduction as usize),
            };
            all.map(frame).collect()
        };
        self.by_size = reductions.iter().map(|reduction| at_size(*reduction)).collect();
    }

    /// What a step looks at of a picture: in each round at another size.
    pub fn of(&self, picture: usize, round: usize) -> Look<'_> {
        let size = (picture + round) % self.by_size.len();
        let frame = &self.by_size[size][picture];
        match self.coarse {
            1 => Look { frame, reduction: self.reductions[size], low_pass: 1 },
            coarse => Look { frame, reduction: coarse, low_pass: coarse },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nvsprior::{Camera, Picture, Pose};

    #[test]
    fn each_picture_is_seen_at_each_size_in_turn() {
        let camera = Camera { width: 8, height: 4, fx: 8.0, fy: 8.0, cx: 4.0, cy: 2.0 };
        let mut picture = Picture::new(8, 4);
        picture.data[0] = 255;
        let views = vec![PosedPicture::new(camera, Pose::IDENTITY, picture); 2];
        let exposures = [Exposure::NONE; 2];
        let mut frames = Frames::new(&[1, 2], 4);
        frames.set(&views, &exposures);
        let red = |frames: &Frames, picture, round| {
            let look = frames.of(picture, round);
            (look.reduction, look.low_pass, look.frame.colour(0).unwrap()[0])
        };
        assert_eq!((0..2).map(|round| red(&frames, 0, round).0).collect::<Vec<_>>(), [4, 4]);
        assert_eq!(red(&frames, 0, 0).1, 4);
        assert!(!frames.reduce(4) && frames.reduce(1));
        frames.set(&views, &exposures);
        let [first, second] = [0, 1].map(|round| red(&frames, 0, round));
        assert_eq!((first.0, first.1, second.0, second.1), (1, 1, 2, 1));
        assert!(first.2 > 0.99 && (second.2 - 0.25).abs() < 0.01, "{first:?}, {second:?}");
        assert_eq!(red(&frames, 1, 0).0, 2);
    }
}
