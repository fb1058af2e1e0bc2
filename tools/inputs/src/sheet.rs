//! Pictures side by side in one.

use std::path::Path;

use anyhow::Context;
use image::RgbImage;
use nvsprior::Picture;

/// Pixels between pictures.
const GAP: u32 = 4;

/// A picture with cells in columns and lines; above each cell there is room for a label.
pub struct Sheet {
    image: RgbImage,
    cell: (u32, u32),
    label: u32,
}

impl Sheet {
    /// Makes a sheet of cells of this size, pixels. `label`: height of the room above each.
    pub fn new(columns: u32, lines: u32, cell: (u32, u32), label: u32) -> Sheet {
        let width = columns * (cell.0 + GAP) + GAP;
        let height = lines * (label + cell.1 + GAP) + GAP;
        let image = RgbImage::from_pixel(width, height, image::Rgb([24, 24, 24]));
        Sheet { image, cell, label }
    }

    /// Left and top of a cell with its label.
    pub fn place(&self, column: u32, line: u32) -> [u32; 2] {
        [GAP + column * (self.cell.0 + GAP), GAP + line * (self.label + self.cell.1 + GAP)]
    }

    /// Puts a picture into a cell.
    ///
    /// # Panics
    /// If the picture is larger than the cell, or the sheet has no such cell.
    pub fn paste(&mut self, column: u32, line: u32, picture: &Picture) {
        let [left, top] = self.place(column, line);
        for (i, rgb) in picture.data.chunks_exact(3).enumerate() {
            let i = i as u32;
            let (x, y) = (left + i % picture.width, top + self.label + i / picture.width);
            self.image.put_pixel(x, y, image::Rgb([rgb[0], rgb[1], rgb[2]]));
        }
    }

    /// All of it, to draw on.
    pub fn image(&mut self) -> &mut RgbImage {
        &mut self.image
    }

    /// Writes it; the ending of the name tells the format.
    pub fn save(&self, path: &Path) -> anyhow::Result<()> {
        self.image.save(path).with_context(|| format!("writing {}", path.display()))
    }
}
