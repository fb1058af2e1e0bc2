//! The part of splats as they are, bit for bit.

use super::super::{PriorError, Splats};
use super::planes;

/// What errors call it.
const FORMAT: &str = "exact splats";
/// Bytes of a number.
const NUMBER: usize = 4;
/// Numbers of a splat besides its spherical harmonics: position, log scales, rotation, logit.
const OTHERS: usize = 11;

/// The part's content: of each number of a splat the four bytes, lowest first, each for all splats.
pub fn to_bytes(splats: &Splats) -> Result<Vec<u8>, PriorError> {
    let count = splats.len();
    let mut bytes = vec![0; NUMBER * count * (OTHERS + splats.sh_stride())];
    let mut column = 0;
    let mut put = |values: &[f32], stride: usize| {
        for first in 0..stride {
            for (splat, value) in values[first..].iter().step_by(stride).enumerate() {
                for (byte, of) in value.to_le_bytes().into_iter().enumerate() {
                    bytes[(column * NUMBER + byte) * count + splat] = of;
                }
            }
            column += 1;
        }
    };
    put(splats.positions.as_flattened(), 3);
    put(splats.log_scales.as_flattened(), 3);
    put(splats.rotations.as_flattened(), 4);
    put(&splats.opacity_logits, 1);
    put(&splats.sh, splats.sh_stride());
    planes::pack(&bytes, count).map_err(PriorError::Write)
}

/// Reads the part's content, which begins at byte `at` of a file.
pub fn read(content: &[u8], at: usize, count: usize, degree: u32) -> Result<Splats, PriorError> {
    let mut splats = Splats { sh_degree: degree, ..Splats::default() };
    let size = NUMBER * count * (OTHERS + splats.sh_stride());
    let planes = planes::unpack(content, at, FORMAT, (count, size))?;
    let number = |column: usize, splat: usize| {
        let byte = |byte| planes[(column * NUMBER + byte) * count + splat];
        f32::from_le_bytes(std::array::from_fn(byte))
    };
    let of = 0..count;
    splats.positions = of.clone().map(|i| [0, 1, 2].map(|axis| number(axis, i))).collect();
    splats.log_scales = of.clone().map(|i| [3, 4, 5].map(|axis| number(axis, i))).collect();
    splats.rotations = of.clone().map(|i| [6, 7, 8, 9].map(|axis| number(axis, i))).collect();
    splats.opacity_logits = of.clone().map(|i| number(10, i)).collect();
    let columns = OTHERS..OTHERS + splats.sh_stride();
    splats.sh =
        of.flat_map(|i| columns.clone().map(move |c| (c, i))).map(|(c, i)| number(c, i)).collect();
    Ok(splats)
}
