//! The part of the lens of the mapping run's camera.

use super::super::PriorError;
use super::words::{Words, refusal};
use crate::geometry::{Distortion, Intrinsics, Lens};

const FORMAT: &str = "lens";
const NONE: u8 = 0;
const BROWN: u8 = 1;
const FISHEYE: u8 = 2;

pub fn to_bytes(lens: &Lens) -> Vec<u8> {
    let Intrinsics { width, height, fx, fy, cx, cy } = *lens.intrinsics();
    let (model, coefficients): (u8, &[f64]) = match lens.distortion() {
        Distortion::None => (NONE, &[]),
        Distortion::Brown(k) => (BROWN, k),
        Distortion::Fisheye(k) => (FISHEYE, k),
    };
    let mut bytes: Vec<u8> = [width, height].into_iter().flat_map(u32::to_le_bytes).collect();
    bytes.extend([fx, fy, cx, cy].into_iter().flat_map(f64::to_le_bytes));
    bytes.push(model);
    bytes.extend(coefficients.iter().flat_map(|k| k.to_le_bytes()));
    bytes
}

pub fn read(content: &[u8], at: usize) -> Result<Lens, PriorError> {
    let mut words = Words::new(content, at);
    let (width, height) = (words.word()?, words.word()?);
    let [fx, fy, cx, cy] = words.doubles()?;
    let (offset, model) = (words.at(), words.byte()?);
    let distortion = match model {
        NONE => Distortion::None,
        BROWN => Distortion::Brown(words.doubles()?),
        FISHEYE => Distortion::Fisheye(words.doubles()?),
        other => return Err(refusal(FORMAT, offset, format!("a distortion {other}"))),
    };
    words.end(FORMAT)?;
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
    Lens::new(intrinsics, distortion).map_err(|error| refusal(FORMAT, at, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_comes_back() {
        let intrinsics = Intrinsics {
            width: 1920,
            height: 1080,
            fx: 1000.25,
            fy: 1001.5,
            cx: 960.125,
            cy: 540.0625,
        };
        for distortion in [
            Distortion::None,
            Distortion::brown(&[-0.1, 0.02, 1e-4, -2e-4]).unwrap(),
            Distortion::Fisheye([0.01, -0.002, 0.0, 1e-4]),
        ] {
            let lens = Lens::new(intrinsics, distortion).unwrap();
            let bytes = to_bytes(&lens);
            assert_eq!(read(&bytes, 99).unwrap(), lens);
            for length in 0..bytes.len() {
                assert!(read(&bytes[..length], 99).is_err(), "{length} bytes");
            }
            assert!(read(&[&bytes[..], &[0]].concat(), 99).is_err());
            let mut other = bytes.clone();
            other[40] = 3;
            let error = read(&other, 99).unwrap_err();
            assert!(matches!(error, PriorError::Field { offset: 139, .. }), "{error}");
        }
    }
}
