//! Boxes in which the prior's own splats fade.

/// A box of cells in which the prior's own splats fade: something was there, and is gone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Fade {
    /// The lowest cell. Cells count from the grid's origin, [`CELL_STEPS`](super::CELL_STEPS) steps each.
    pub min: [i32; 3],
    /// The highest cell, at least the lowest on each axis. It belongs to the box.
    pub max: [i32; 3],
    /// Opacities are multiplied by this, parts of 255.
    pub factor: u8,
}
