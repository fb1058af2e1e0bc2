//! The same frames by several methods, side by side, with labels.

use std::convert::Infallible;
use std::path::Path;

use embedded_graphics::Drawable;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::{FONT_8X13, FONT_8X13_BOLD};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::{DrawTarget, Pixel};
use embedded_graphics::text::Text;
use nvsprior::Picture;
use nvsprior_runs::Sheet;

use super::row::{Entry, Row, shown_of};
use crate::bench::codecs::run::Run;

/// The methods that are shown, if they were measured.
const SHOWN: [&str; 6] =
    ["webp", "jpeg-xl", "mean-scale-hyperprior", "mlic++", "invs+webp", "ours-intra"];
/// Height of a label, pixels: two lines of text.
const LABEL: u32 = 34;

/// Writes the camera's frames beside what each method shows, as one PNG.
pub fn write(path: &Path, frames: &Run, entries: &[Entry]) -> anyhow::Result<()> {
    let rows: Vec<&Row> = SHOWN.iter().filter_map(|name| named(entries, name)).collect();
    let frames = &frames.frames;
    let indices = shown_of(frames.len());
    let cell = (frames[0].width, frames[0].height);
    let (columns, lines) = (rows.len() as u32 + 1, indices.len() as u32);
    let mut sheet = Sheet::new(columns, lines, cell, LABEL);
    for (line, index) in indices.into_iter().enumerate() {
        let line = line as u32;
        sheet.paste(0, line, &frames[index]);
        label(&mut sheet, 0, line, "camera", "");
        for (column, row) in rows.iter().enumerate() {
            let column = column as u32 + 1;
            let shown = &row.shown[line as usize];
            sheet.paste(column, line, shown);
            let below = format!("{:.2} dB; mean {:.0} bytes", frames[index].psnr(shown), row.bytes);
            label(&mut sheet, column, line, &row.method, &below);
        }
    }
    Ok(sheet.save(path)?)
}

fn named<'a>(entries: &'a [Entry], name: &str) -> Option<&'a Row> {
    entries.iter().find(|entry| entry.method() == name)?.row()
}

/// Writes two lines above a picture.
fn label(sheet: &mut Sheet, column: u32, line: u32, above: &str, below: &str) {
    let [left, top] = sheet.place(column, line).map(|place| place as i32);
    let mut canvas = Canvas(sheet.picture());
    for (text, down, font) in [(above, 12, &FONT_8X13_BOLD), (below, 27, &FONT_8X13)] {
        let style = MonoTextStyle::new(font, Rgb888::WHITE);
        let Ok(_) = Text::new(text, Point::new(left, top + down), style).draw(&mut canvas);
    }
}

/// A picture that text is drawn on; what lies beside it is left out.
struct Canvas<'a>(&'a mut Picture);

impl OriginDimensions for Canvas<'_> {
    fn size(&self) -> Size {
        Size::new(self.0.width, self.0.height)
    }
}

impl DrawTarget for Canvas<'_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Infallible> {
        let Picture { width, height, data } = &mut *self.0;
        for Pixel(at, colour) in pixels {
            let place = u32::try_from(at.x).ok().zip(u32::try_from(at.y).ok());
            if let Some((x, y)) = place.filter(|(x, y)| x < width && y < height) {
                let at = 3 * (y as usize * *width as usize + x as usize);
                data[at..at + 3].copy_from_slice(&[colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}
