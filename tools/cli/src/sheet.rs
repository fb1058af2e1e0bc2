//! Contact sheets: camera | render | difference | reconstruction, if there is one; one row per frame.

use std::path::Path;

use anyhow::Context;
use nvsprior::Picture;
use nvsprior::residual::difference;

/// Pixels between pictures.
const GAP: u32 = 4;

/// The pictures of one frame.
pub struct SheetRow {
    pub camera: Picture,
    pub render: Picture,
    pub reconstruction: Option<Picture>,
}

/// Writes the rows as one PNG.
pub fn write(path: &Path, rows: &[SheetRow]) -> anyhow::Result<()> {
    let cell =
        rows.iter().fold((0, 0), |(w, h), row| (row.camera.width.max(w), row.camera.height.max(h)));
    let columns = if rows.iter().any(|row| row.reconstruction.is_some()) { 4 } else { 3 };
    let (width, height) =
        (columns * (cell.0 + GAP) + GAP, rows.len() as u32 * (cell.1 + GAP) + GAP);
    let mut sheet = image::RgbImage::from_pixel(width, height, image::Rgb([24, 24, 24]));
    for (y, row) in rows.iter().enumerate() {
        let shown = difference(&row.camera, &row.render);
        let cells = [&row.camera, &row.render, &shown];
        for (x, picture) in cells.into_iter().chain(&row.reconstruction).enumerate() {
            let at = [GAP + x as u32 * (cell.0 + GAP), GAP + y as u32 * (cell.1 + GAP)];
            paste(&mut sheet, picture, at);
        }
    }
    sheet.save(path).with_context(|| format!("writing {}", path.display()))
}

fn paste(sheet: &mut image::RgbImage, picture: &Picture, [left, top]: [u32; 2]) {
    for (i, rgb) in picture.data.chunks_exact(3).enumerate() {
        let i = i as u32;
        let (x, y) = (left + i % picture.width, top + i / picture.width);
        sheet.put_pixel(x, y, image::Rgb([rgb[0], rgb[1], rgb[2]]));
    }
}
