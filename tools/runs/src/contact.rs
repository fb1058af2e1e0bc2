//! Contact sheets: camera | render | difference | reconstruction, if there is one; one row per frame.

use std::path::Path;

use nvsprior::Picture;
use nvsprior::residual::difference;

use crate::png_file::PngFileError;
use crate::sheet::Sheet;

pub struct SheetRow {
    pub frame: Picture,
    pub render: Picture,
    pub reconstruction: Option<Picture>,
}

pub fn write_contact_sheet(path: &Path, rows: &[SheetRow]) -> Result<(), PngFileError> {
    let cell =
        rows.iter().fold((0, 0), |(w, h), row| (row.frame.width.max(w), row.frame.height.max(h)));
    let columns = if rows.iter().any(|row| row.reconstruction.is_some()) { 4 } else { 3 };
    let mut sheet = Sheet::new(columns, rows.len() as u32, cell, 0);
    for (line, row) in (0..).zip(rows) {
        let shown = difference(&row.frame, &row.render);
        let cells = [&row.frame, &row.render, &shown];
        for (column, picture) in (0..).zip(cells.into_iter().chain(&row.reconstruction)) {
            sheet.paste(column, line, picture);
        }
    }
    sheet.save(path)
}
