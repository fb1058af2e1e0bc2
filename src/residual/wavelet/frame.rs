//! What a frame is coded beside: sizes, the render's bands, and how far to trust them.

use crate::Picture;

use super::geometry::{Band, Geometry, Orientation};
use super::inter::Inter;
use super::lifting::Scratch;
use super::render::RenderBands;
use super::small_blocks::{FULL, SmallBlocks};
use super::step::Step;

/// All that a pass over a frame's coefficients looks at, and does not change.
pub struct Frame {
    pub geometry: Geometry,
    pub render: RenderBands,
    /// The coarsest low band is predicted from the render, too; else from grey.
    pub low_predicted: bool,
    /// What says more finely what is predicted from the render, if it is in use.
    pub small_blocks: SmallBlocks,
    /// How much of the render's coefficient is predicted at each place of a transformed plane, 0 to [`FULL`].
    pub weights: Vec<u8>,
    /// Contexts look at the render: both sides hold the same one, byte for byte.
    pub sees_render: bool,
    pub step: Step,
    /// What is predicted from a reference; room is made for the first frame of a stream.
    pub inter: Option<Box<Inter>>,
    /// The frame is predicted from a reference.
    pub is_inter: bool,
    /// Room for the transform.
    pub scratch: Scratch,
}

impl Frame {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32) -> Frame {
        let geometry = Geometry::new(width, height);
        Frame {
            render: RenderBands::new(&geometry),
            low_predicted: true,
            small_blocks: SmallBlocks::new(&geometry),
            weights: vec![FULL; geometry.len()],
            sees_render: true,
            step: Step::new(0),
            inter: None,
            is_inter: false,
            scratch: Scratch::new(geometry.width, geometry.height),
            geometry,
        }
    }

    /// Makes room for inter frames.
    pub fn prepare_inter(&mut self) {
        let inter = || Box::new(Inter::new(&self.geometry));
        self.inter.get_or_insert_with(inter);
    }

    /// What the frame is predicted from.
    pub fn inter_in_use(&self) -> Option<&Inter> {
        self.inter.as_deref().filter(|_| self.is_inter)
    }

    /// Whether some blocks are displaced.
    pub fn has_displaced(&self) -> bool {
        self.inter_in_use().is_some_and(|inter| inter.displaced.in_use)
    }

    /// What contexts look at of an earlier frame. With displaced blocks that is nothing: little of what is then
    /// predicted tells how large what is left will be.
    pub fn inter_seen(&self) -> Option<&Inter> {
        self.inter_in_use().filter(|_| !self.has_displaced())
    }

    /// Takes a render of the frame's size.
    pub fn set_render(&mut self, render: &Picture) {
        self.render.set(&self.geometry, render, &mut self.scratch);
    }

    /// Predicts all from the render.
    pub fn predict_all(&mut self) {
        self.low_predicted = true;
        self.small_blocks.in_use = false;
        self.weights.fill(FULL);
    }

    /// Whether all is predicted from the render.
    pub fn is_all_predicted(&self) -> bool {
        self.low_predicted && !self.small_blocks.in_use
    }

    /// Whether a coefficient's block is predicted from the render with its details.
    pub fn is_detailed(&self, band: &Band, x: usize, y: usize) -> bool {
        let displaced = self.inter_in_use().map(|inter| &inter.displaced);
        if displaced.is_some_and(|displaced| displaced.is_displaced(band.level, x, y)) {
            return false;
        }
        !self.small_blocks.in_use || self.weights[band.offset + y * self.geometry.width + x] == FULL
    }

    /// Sets the weights by what the blocks say.
    pub fn weigh(&mut self) {
        let Frame { geometry, weights, .. } = self;
        match self.small_blocks.in_use {
            true => self.small_blocks.weigh(geometry, weights),
            false => weights.fill(FULL),
        }
        let low = geometry.band(geometry.levels, Orientation::Low);
        let weight = if self.low_predicted { FULL } else { 0 };
        low.rows(geometry).for_each(|row| weights[row].fill(weight));
    }
}
