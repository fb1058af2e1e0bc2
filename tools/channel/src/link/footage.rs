//! A camera's frames, in time order, at the sizes that they are sent at.

use std::str::FromStr;

use crate::forth_and_back;
use anyhow::Context as _;
use nvsprior::image::Preprocessor;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Camera, Picture};
use nvsprior_inputs::frame_file;
use nvsprior_inputs::input::Input;

use super::region::Region;

/// From a frame of the run on, pictures have another width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WidthFrom {
    pub frame: usize,
    pub width: u32,
}

impl FromStr for WidthFrom {
    type Err = String;

    fn from_str(text: &str) -> Result<WidthFrom, String> {
        let parts = text.split_once(':').ok_or("FRAME:WIDTH is due, such as 60:320")?;
        let frame = parts.0.parse().map_err(|error| format!("the frame: {error}"))?;
        let width = parts.1.parse().map_err(|error| format!("the width: {error}"))?;
        if !(1..=Camera::MAX_SIDE).contains(&width) {
            return Err(format!("the width must be from 1 to {} pixels", Camera::MAX_SIDE));
        }
        Ok(WidthFrom { frame, width })
    }
}

/// The frames at a size.
pub struct AtSize {
    /// The first frame's; all others must be the same.
    pub camera: Camera,
    pub pictures: Vec<Picture>,
}

impl AtSize {
    pub fn read(inputs: &[Input], preprocessor: &mut Preprocessor) -> anyhow::Result<AtSize> {
        let camera = inputs[0].camera;
        let read = |input: &Input| {
            anyhow::ensure!(
                input.camera == camera,
                "{}: not of the first frame's camera",
                input.file
            );
            let mut picture = frame_file::read_frame(&input.path, camera.width, camera.height)?;
            preprocessor.apply(&mut picture);
            Ok(picture)
        };
        let pictures = inputs.iter().map(read).collect::<anyhow::Result<_>>()?;
        Ok(AtSize { camera, pictures })
    }
}

/// A run's frames.
pub struct Footage {
    /// What is known of the first one.
    pub first: FrameInfo,
    /// From which frame on each size is sent, in order; the first one from the start.
    pub sizes: Vec<(usize, AtSize)>,
    /// By picture; none if they are not asked for.
    pub regions: Vec<Region>,
}

impl Footage {
    /// How many pictures there are.
    pub fn len(&self) -> usize {
        self.sizes[0].1.pictures.len()
    }

    /// The size of frame `k` of the run.
    fn size(&self, k: usize) -> &AtSize {
        let begun = self.sizes.iter().rev().find(|(from, _)| *from <= k);
        &begun.unwrap_or(&self.sizes[0]).1
    }

    /// The camera of frame `k`.
    pub fn camera(&self, k: usize) -> &Camera {
        &self.size(k).camera
    }

    /// All cameras.
    pub fn cameras(&self) -> impl Iterator<Item = &Camera> {
        self.sizes.iter().map(|(_, size)| &size.camera)
    }

    /// Frame `k` of the run.
    pub fn picture(&self, k: usize) -> &Picture {
        &self.size(k).pictures[forth_and_back(k, self.len())]
    }

    /// Frame `k` at the size of a picture that is shown for it.
    pub fn as_large_as(&self, k: usize, shown: &Picture) -> anyhow::Result<&Picture> {
        let has_size =
            |size: &AtSize| (size.camera.width, size.camera.height) == (shown.width, shown.height);
        let size = self.sizes.iter().map(|(_, size)| size).find(|size| has_size(size));
        let size = size.context("a picture of a size that was not sent is shown")?;
        Ok(&size.pictures[forth_and_back(k, self.len())])
    }

    /// Mean part of a picture that shows what the prior does not; `None`: it is not asked for.
    pub fn region_part(&self) -> Option<f64> {
        let parts = self.regions.iter().map(Region::part).sum::<f64>();
        (!self.regions.is_empty()).then(|| parts / self.regions.len() as f64)
    }

    /// Where it shows what the prior does not, if that is known.
    pub fn region(&self, k: usize) -> Option<&Region> {
        self.regions.get(forth_and_back(k, self.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_frame_has_the_size_that_was_last_begun() {
        let at = |width| {
            let (fx, cx) = (width as f32, 0.5 * width as f32);
            let camera = Camera { width, height: width / 2, fx, fy: fx, cx, cy: 0.5 * cx };
            AtSize { camera, pictures: vec![Picture::new(width, width / 2); 3] }
        };
        let sizes = vec![(0, at(8)), (2, at(4)), (5, at(8))];
        let footage = Footage { first: FrameInfo::default(), sizes, regions: Vec::new() };
        let widths: Vec<_> = (0..7).map(|k| footage.camera(k).width).collect();
        assert_eq!(widths, [8, 8, 4, 4, 4, 8, 8]);
        assert_eq!(footage.picture(3).width, 4);
        assert_eq!(footage.as_large_as(3, &Picture::new(8, 4)).unwrap().width, 8);
        assert!(footage.as_large_as(3, &Picture::new(9, 4)).is_err());
    }

    #[test]
    fn a_width_is_told_with_its_frame() {
        assert_eq!("60:320".parse(), Ok(WidthFrom { frame: 60, width: 320 }));
        for wrong in ["60", "60:", ":320", "-1:320", "60:0", "60:5000", "a:320"] {
            assert!(wrong.parse::<WidthFrom>().is_err(), "{wrong}");
        }
    }
}
