//! Where frames show what the prior does not, and the PSNR of what is shown there and elsewhere.

use std::sync::Arc;

use anyhow::Context as _;
use nvsprior::image::psnr_of_mse;
use nvsprior::render::{Plan, Scene};
use nvsprior::{Camera, Engine, Picture, Pose};

/// Side of the blocks that a region is made of, pixels.
const BLOCK: usize = 8;
/// Mean absolute difference from which on a block shows something else, 8-bit steps.
const NEW: u64 = 24;

/// By block of a picture, row by row: whether it shows what the prior does not.
pub struct Region {
    blocks: Vec<bool>,
}

/// PSNR inside and outside of a region, dB; `None`: no pixel lies there.
pub type RegionPsnr = [Option<f64>; 2];

impl Region {
    /// Of frames with the poses of the camera file: where they differ from the render of the prior alone.
    pub fn of_all<'a>(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        frames: impl Iterator<Item = (&'a Picture, Option<Pose>)>,
    ) -> anyhow::Result<Vec<Region>> {
        let mut renderer = engine.renderer(scene, camera, Plan::picture())?;
        let mut render = Picture::new(camera.width, camera.height);
        let region = |(frame, pose): (&Picture, Option<Pose>)| {
            let pose = pose.context("--region: the camera file has no pose for each frame")?;
            renderer.picture(&pose, &mut render)?;
            Ok(Region::between(frame, &render))
        };
        frames.map(region).collect()
    }

    fn between(frame: &Picture, render: &Picture) -> Region {
        let columns = columns(frame);
        let rows = (frame.height as usize).div_ceil(BLOCK);
        let mut sums = vec![(0, 0); columns * rows];
        for (block, a, b) in by_block(frame, render) {
            sums[block].0 += u64::from(a.abs_diff(b));
            sums[block].1 += 1;
        }
        Region { blocks: sums.iter().map(|(sum, count)| *sum >= NEW * count).collect() }
    }

    /// Part of the picture that it takes.
    pub fn part(&self) -> f64 {
        self.blocks.iter().filter(|inside| **inside).count() as f64 / self.blocks.len() as f64
    }

    pub fn psnr(&self, shown: &Picture, wanted: &Picture) -> RegionPsnr {
        let mut sums = [(0.0, 0_u64); 2];
        for (block, a, b) in by_block(shown, wanted) {
            let (sum, count) = &mut sums[usize::from(!self.blocks[block])];
            *sum += (f64::from(a.abs_diff(b)) / 255.0).powi(2);
            *count += 1;
        }
        sums.map(|(sum, count)| (count > 0).then(|| psnr_of_mse(sum / count as f64)))
    }
}

fn columns(picture: &Picture) -> usize {
    (picture.width as usize).div_ceil(BLOCK)
}

/// The bytes of two pictures, and the block that they lie in.
fn by_block<'a>(a: &'a Picture, b: &'a Picture) -> impl Iterator<Item = (usize, u8, u8)> + 'a {
    let (width, columns) = (a.width as usize, columns(a));
    let bytes = a.data.iter().zip(&b.data).enumerate();
    bytes.map(move |(at, (a, b))| {
        let (x, y) = (at / 3 % width, at / 3 / width);
        (y / BLOCK * columns + x / BLOCK, *a, *b)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_where_the_frame_differs() {
        let (mut frame, render) = (Picture::new(20, 12), Picture::new(20, 12));
        for (at, value) in frame.data.iter_mut().enumerate() {
            let (x, y) = (at / 3 % 20, at / 3 / 20);
            *value = if x >= 16 && y < 8 { 30 } else { 3 };
        }
        let region = Region::between(&frame, &render);
        assert_eq!(region.blocks, [false, false, true, false, false, false]);
        assert!((region.part() - 1.0 / 6.0).abs() < 1e-9);
        let of = |steps: f64| Some(psnr_of_mse((steps / 255.0).powi(2)));
        let near = |a: Option<f64>, b: Option<f64>| (a.unwrap() - b.unwrap()).abs() < 1e-9;
        let [inside, outside] = region.psnr(&render, &frame);
        assert!(near(inside, of(30.0)) && near(outside, of(3.0)));
        let nowhere = Region { blocks: vec![false; 6] };
        assert_eq!(nowhere.psnr(&render, &frame)[0], None);
    }
}
