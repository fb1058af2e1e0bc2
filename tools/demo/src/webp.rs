//! The camera's frames as WebP files, to compare with.

use std::time::Instant;

use nvsprior::Picture;
use nvsprior_paper::Webp;

use crate::table::Figures;

/// The smallest WebP of a picture that reaches a PSNR, by bisection of the quality; the best one if none does.
pub fn at_psnr(picture: &Picture, psnr: f64) -> anyhow::Result<Figures> {
    /// Libwebp's default.
    const SEGMENTS: u8 = 4;
    let since = Instant::now();
    let mut webp = Webp::new(picture.width, picture.height);
    let mut shown = Picture::new(picture.width, picture.height);
    let mut code = |quality: f32| -> anyhow::Result<(usize, f64)> {
        let file = webp.encode_file(picture, quality, SEGMENTS)?.to_vec();
        webp.decode_file(&file, &mut shown)?;
        Ok((file.len(), shown.psnr(picture)))
    };
    let (mut low, mut high) = (0.0, 100.0);
    let mut best = code(high)?;
    for _ in 0..7 {
        let middle = 0.5 * (low + high);
        let (bytes, reached) = code(middle)?;
        if reached >= psnr {
            (high, best) = (middle, (bytes, reached));
        } else {
            low = middle;
        }
    }
    let milliseconds = since.elapsed().as_secs_f64() * 1e3;
    Ok(Figures { bytes: best.0, psnr: best.1, milliseconds, renders: 0 })
}
