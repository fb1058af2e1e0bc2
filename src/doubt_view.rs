//! What is known of the parts of a picture that are memory: whether the prior shows them well.

use std::sync::Arc;

use crate::prior::{RenderOptions, Splats};
use crate::render::{Plan, Renderer, Scene};
use crate::truth::{BLOCK, THRESHOLDS};
use crate::vulkan::Error;
use crate::{Camera, Engine, Pose, Prior};

/// What is known of a block of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum DoubtLevel {
    /// The mapping run saw what it shows, and the prior shows that well.
    Sure = 0,
    /// Few pictures saw it, the prior shows it badly, or nothing is known of that.
    Doubtful = 1,
    /// There is nothing in the prior.
    NeverMapped = 2,
}

/// What is known of a picture if it is memory, block by block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DoubtMap {
    /// Blocks in a row: a block has [`BLOCK`] pixels a side.
    pub columns: u32,
    /// Rows of blocks.
    pub rows: u32,
    /// Levels of the blocks, row by row: see [`DoubtLevel`].
    pub levels: Vec<u8>,
    /// The error that each block is expected to have, RMS of 255. If nothing is mapped there, that of what is.
    pub expected: Vec<f32>,
    /// The mean depth of what each block shows, in the prior's unit. If nothing is mapped there, it is not finite.
    pub depths: Vec<f32>,
}

/// Pixels of a block that one of the drawn picture stands for, along a side.
const FACTOR: u32 = 4;
/// Share of a block that splats must cover, or else it was never mapped.
const COVERED: f32 = 0.5;
/// Error from which on a block is doubtful, RMS: as the truth map's.
const DOUBTFUL: f32 = THRESHOLDS[0][0];

/// Draws the doubt of a prior's splats. Takes memory on the device for the splats once more, without their colours.
pub struct DoubtView {
    engine: Engine,
    scene: Arc<Scene>,
    /// Of the camera that drew last.
    renderer: Option<(Camera, Renderer)>,
}

impl DoubtView {
    /// If the prior holds no doubt of its splats, all that is mapped is doubtful.
    pub fn new(engine: &Engine, prior: &Prior) -> Result<DoubtView, crate::Error> {
        let scene = engine.upload(&coloured(prior)?)?;
        Ok(DoubtView { engine: engine.clone(), scene, renderer: None })
    }

    /// Draws it as a camera sees it from a pose, into a map of any size. Another camera than before takes time.
    pub fn draw(&mut self, camera: &Camera, pose: &Pose, map: &mut DoubtMap) -> Result<(), Error> {
        let kept = self.renderer.take().filter(|(of, _)| of == camera);
        let drawn_by = match kept {
            Some(kept) => kept,
            None => {
                let reduced = camera.reduced(FACTOR);
                (*camera, self.engine.renderer(&self.scene, &reduced, Plan::picture())?)
            }
        };
        let (_, renderer) = self.renderer.insert(drawn_by);
        let [columns, rows] = [camera.width, camera.height].map(|side| side.div_ceil(BLOCK));
        let width = renderer.camera(0).width as usize;
        let picture = renderer.draw(&pose.relative_to(self.scene.origin()))?;
        (map.columns, map.rows) = (columns, rows);
        map.levels.clear();
        map.expected.clear();
        map.depths.clear();
        let side = (BLOCK / FACTOR) as usize;
        for row in picture.chunks(side * width * FLOATS).take(rows as usize) {
            for column in 0..columns as usize {
                let lines = row.chunks_exact(width * FLOATS);
                let of_block = lines.flat_map(|line| {
                    let end = ((column + 1) * side).min(width);
                    line[(column * side).min(end) * FLOATS..end * FLOATS].chunks_exact(FLOATS)
                });
                let (level, expected, depth) = judged(of_block);
                map.levels.push(level as u8);
                map.expected.push(expected);
                map.depths.push(depth);
            }
        }
        Ok(())
    }
}

/// Numbers of a drawn pixel: three colours, depth, transmittance.
const FLOATS: usize = 5;

/// What is known of a block, of its pixels, the error that is expected, and the depth.
fn judged<'a>(pixels: impl Iterator<Item = &'a [f32]>) -> (DoubtLevel, f32, f32) {
    let (mut doubt, mut depth, mut covered, mut count) = (0.0, 0.0, 0.0, 0.0);
    for pixel in pixels {
        doubt += 255.0 * pixel[0];
        depth += pixel[3];
        covered += 1.0 - pixel[4];
        count += 1.0;
    }
    let expected = if covered > 0.0 { doubt / covered } else { 0.0 };
    let level = match () {
        // Pictures whose sides are no multiples of 16 may have blocks at the edge of less than a pixel.
        () if covered < COVERED * count => DoubtLevel::NeverMapped,
        () if expected > DOUBTFUL => DoubtLevel::Doubtful,
        () => DoubtLevel::Sure,
    };
    (level, expected, depth / covered)
}

/// The prior with its doubt as colours, on black.
fn coloured(prior: &Prior) -> Result<Prior, crate::Error> {
    /// Value of the spherical harmonic of degree 0.
    const DEGREE_0: f32 = 0.282_094_8;
    let sh_of = |doubt: &u8| [(f32::from(*doubt) / 255.0 - 0.5) / DEGREE_0, 0.0, 0.0];
    let sh = match &prior.extras().doubt {
        Some(doubt) => doubt.iter().flat_map(sh_of).collect(),
        None => [u8::MAX].iter().cycle().take(prior.len()).flat_map(sh_of).collect(),
    };
    let splats = Splats { sh, sh_degree: 0, ..prior.splats().clone() };
    let options = RenderOptions { background: [0.0; 3], ..*prior.options() };
    Ok(Prior::from_splats(splats, options)?)
}
