//! PlayCanvas's SOG files, version 2, as one archive.
//!
//! A ZIP archive of `meta.json` and lossless WebP pictures, in which the same pixel belongs to the same splat:
//! positions (16 bits between bounds, of a signed logarithm), rotations (the smallest three of four, eight bits each),
//! scales and colours (eight bits, by tables of values), opacities (eight bits), and spherical harmonics by a palette.
//! Values are those of the PLY file that it was made of, in the same world: nothing is turned.
//!
//! Not read are version 1, folders in place of an archive, scenes in several levels of detail (`lod-meta.json`), and
//! lossy pictures. Render options are [`RenderOptions::INRIA`], anti-aliased if the file says so.

mod archive;
mod meta;

use archive::{Archive, Pixels};
use meta::{Meta, refusal};

use crate::spz::logit;
use nvsprior::prior::{PriorError, PriorFile, PriorFormat, Splats};
use nvsprior::{Prior, RenderOptions};

pub use archive::MAGIC;
#[cfg(test)]
pub use meta::FIELDS;

const FORMAT: PriorFormat = PriorFormat::Foreign("SOG", Some(2));

/// Most splats that a byte of the file may stand for. Files have some eight bytes for each.
const SPLATS_PER_BYTE: usize = 16;

/// Last byte of a rotation whose w is the largest; x, y and z follow.
const LARGEST_W: u8 = 252;

/// Entries of the palette in a row of its picture.
const PALETTE_ROW: usize = 64;

/// Reads a SOG archive.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    let mut archive = Archive::open(bytes)?;
    let meta = Meta::read(&archive.file("meta.json")?)?;
    let count = meta.count;
    if count == 0 {
        return Err(PriorError::Empty);
    }
    if count > Prior::MAX_SPLATS {
        return Err(PriorError::TooMany { count });
    }
    if count > bytes.len().saturating_mul(SPLATS_PER_BYTE) {
        return Err(refusal(format!("{count} splats in {} bytes", bytes.len())));
    }
    let mut splats = Splats::with_capacity(count, meta.sh_degree());
    let [low, high] = &meta.means.files;
    let (low, high) = (archive.per_splat(low, count)?, archive.per_splat(high, count)?);
    splats.positions.extend((0..count).map(|i| meta.position(low.at(i), high.at(i))));
    drop((low, high));
    let [scales] = &meta.scales.files;
    for [x, y, z, _] in archive.per_splat(scales, count)?.first(count) {
        splats.log_scales.push([x, y, z].map(|entry| meta.scales.codebook.get(entry)));
    }
    let [name] = &meta.quats.files;
    for (index, bytes) in archive.per_splat(name, count)?.first(count).enumerate() {
        let turned = rotation(bytes);
        let wrong = || refusal(format!("{name}: splat {index} has the mode {}", bytes[3]));
        splats.rotations.push(turned.ok_or_else(wrong)?);
    }
    let colours = archive.per_splat(&meta.sh0.files[0], count)?;
    let opacities = colours.first(count).map(|[.., byte]| logit(f64::from(byte) / 255.0));
    splats.opacity_logits.extend(opacities);
    append_colours(&mut splats, &meta, &colours, &mut archive)?;
    let options = RenderOptions { antialiased: meta.is_antialiased(), ..RenderOptions::INRIA };
    let comments = meta.asset.generator.iter().map(|by| format!("generator {by}")).collect();
    let warnings = meta.warnings();
    Ok(PriorFile {
        comments,
        warnings,
        near_by_size: true,
        ..PriorFile::new(splats, options, FORMAT)
    })
}

/// Constant coefficients from `colours`, the others from the palette.
fn append_colours(
    splats: &mut Splats,
    meta: &Meta,
    colours: &Pixels,
    archive: &mut Archive,
) -> Result<(), PriorError> {
    let constant = |rgb: [u8; 4]| [0, 1, 2].map(|c| meta.sh0.codebook.get(rgb[c]));
    let Some(rest) = &meta.sh_rest else {
        splats.sh.extend(colours.first(meta.count).flat_map(constant));
        return Ok(());
    };
    let [centroids, labels_name] = &rest.files;
    let coefficients = (meta.sh_degree() as usize + 1).pow(2) - 1;
    let rows = rest.count.div_ceil(PALETTE_ROW);
    let palette = archive.picture(centroids, |width, height| {
        width == PALETTE_ROW * coefficients && (rows..=rows + PALETTE_ROW).contains(&height)
    })?;
    let labels = archive.per_splat(labels_name, meta.count)?;
    for (index, colour) in colours.first(meta.count).enumerate() {
        let [low, high, ..] = labels.at(index);
        let entry = usize::from(u16::from_le_bytes([low, high]));
        if entry >= rest.count {
            let reason =
                format!("{labels_name}: splat {index} has entry {entry} of {}", rest.count);
            return Err(refusal(reason));
        }
        splats.sh.extend(constant(colour));
        for coefficient in 0..coefficients {
            let rgb = palette.at(entry * coefficients + coefficient);
            splats.sh.extend(rgb[..3].iter().map(|byte| rest.codebook.get(*byte)));
        }
    }
    Ok(())
}

/// A quaternion (w, x, y, z) of the three smallest of its numbers and a byte that tells which is left out.
fn rotation([a, b, c, mode]: [u8; 4]) -> Option<[f32; 4]> {
    let largest = usize::from(mode.checked_sub(LARGEST_W)?);
    let mut q = [0.0; 4];
    let places = (0..4).filter(|place| *place != largest);
    for (place, byte) in places.zip([a, b, c]) {
        q[place] = (f64::from(byte) / 127.5 - 1.0) * std::f64::consts::FRAC_1_SQRT_2;
    }
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    Some(q.map(|v| v as f32))
}

#[cfg(test)]
mod tests;
