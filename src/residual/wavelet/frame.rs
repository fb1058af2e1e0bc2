//! What a frame is coded beside: sizes, the render's bands, and how far to trust them.

use crate::Picture;

use super::geometry::{Band, Geometry, Orientation};
use super::inter::Inter;
use super::lifting::Scratch;
use super::render::RenderBands;
use super::step::Step;

/// All that a pass over a frame's coefficients looks at, and does not change.
pub struct Frame {
    pub geometry: Geometry,
    pub render: RenderBands,
    /// Whether the details of a block are predicted from the render: for each value of the coarsest low band, row by
    /// row.
    pub predicted: Vec<bool>,
    /// The coarsest low band is predicted from the render, too; else from grey.
    pub low_predicted: bool,
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
        let (columns, rows) = geometry.sizes[geometry.levels];
        Frame {
            render: RenderBands::new(&geometry),
            predicted: vec![true; columns * rows],
            low_predicted: true,
            sees_render: true,
            step: Step::new(0),
            inter: None,
            is_inter: false,
            scratch: Scratch::new(geometry.len()),
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

    /// Takes a render of the frame's size.
    pub fn set_render(&mut self, render: &Picture) {
        self.render.set(&self.geometry, render, &mut self.scratch);
    }

    /// Whether a coefficient is predicted from the render.
    pub fn is_predicted(&self, band: &Band, x: usize, y: usize) -> bool {
        match band.orientation {
            Orientation::Low => self.low_predicted,
            _ => self.predicted[self.geometry.block(band, x, y)],
        }
    }
}
