//! Pictures side by side in one.

use std::path::Path;

use nvsprior::Picture;

use crate::png_file::{PngFileError, write_png};

/// Pixels between pictures.
const GAP: u32 = 4;
/// Grey level between pictures.
const GROUND: u8 = 24;

/// A picture with cells in columns and lines; above each cell there is room for a label.
pub struct Sheet {
    picture: Picture,
    cell: (u32, u32),
    label: u32,
}

impl Sheet {
    /// Makes a sheet of cells of this size, pixels. `label`: height of the room above each.
    pub fn new(columns: u32, lines: u32, cell: (u32, u32), label: u32) -> Sheet {
        let width = columns * (cell.0 + GAP) + GAP;
        let height = lines * (label + cell.1 + GAP) + GAP;
        let mut picture = Picture::new(width, height);
        picture.data.fill(GROUND);
        Sheet { picture, cell, label }
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
        assert!(
            picture.width <= self.cell.0 && picture.height <= self.cell.1,
            "larger than its cell"
        );
        let [left, top] = self.place(column, line);
        let bytes = 3 * picture.width as usize;
        for (row, y) in picture.data.chunks_exact(bytes).zip(top + self.label..) {
            let at = 3 * (y as usize * self.picture.width as usize + left as usize);
            self.picture.data[at..at + bytes].copy_from_slice(row);
        }
    }

    /// All of it, to draw on.
    pub fn picture(&mut self) -> &mut Picture {
        &mut self.picture
    }

    /// Writes it as a PNG.
    pub fn save(&self, path: &Path) -> Result<(), PngFileError> {
        write_png(path, &self.picture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_their_cells() {
        let mut sheet = Sheet::new(2, 1, (2, 1), 3);
        sheet.paste(1, 0, &Picture::from_rgb(2, 1, vec![9; 6]).unwrap());
        let [left, top] = sheet.place(1, 0);
        assert_eq!((left, top), (10, 4));
        let picture = sheet.picture();
        assert_eq!((picture.width, picture.height), (16, 12));
        let first = 3 * (7 * 16 + 10);
        let found: Vec<usize> = (0..picture.data.len()).filter(|i| picture.data[*i] == 9).collect();
        assert_eq!(found, (first..first + 6).collect::<Vec<_>>());
    }
}
