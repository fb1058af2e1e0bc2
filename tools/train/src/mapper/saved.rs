//! A training's state as bytes, so that it can go on after an interruption.
//!
//! All numbers are little-endian: the magic `NVSPMAP2`; the fingerprint of what is trained, the steps done, the splats
//! in use, the numbers of each of three sets of planes, and the number of pictures (u32 each); the planes (f32); the
//! light of each picture (12 f64: the columns of the gain, the offset) with its pose (7 f64: x, y, z, w, translation);
//! a CRC-32 over all before it.

use crate::trainer::TrainingState;
use glam::{DMat3, DQuat, DVec3};
use nvsprior::Pose;

use super::{Exposure, MapState};

const MAGIC: &[u8; 8] = b"NVSPMAP2";
const HEADER: usize = 8 + 5 * 4;
/// Numbers of a picture's light and pose.
const PICTURE: usize = 12 + 7;

/// Why a saved state cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SavedError {
    #[error("not the state of a training")]
    Foreign,
    #[error("cut off or changed since it was written")]
    Damaged,
    #[error("of another training: other pictures, points or options")]
    Other,
}

/// The bytes of a state. `fingerprint` names what is trained, and how.
pub fn write_state(state: &MapState, fingerprint: u32) -> Vec<u8> {
    let TrainingState { parameters, first, second } = &state.training;
    let numbers = parameters.len() as u32;
    let mut bytes = Vec::with_capacity(HEADER + 12 * parameters.len() + 4);
    bytes.extend(MAGIC);
    let pictures = state.exposures.len() as u32;
    for word in [fingerprint, state.step, state.alive, numbers, pictures] {
        bytes.extend(word.to_le_bytes());
    }
    for planes in [parameters, first, second] {
        planes.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    }
    for (Exposure { gain, offset }, pose) in state.exposures.iter().zip(&state.poses) {
        let light = gain.to_cols_array().into_iter().chain(offset.to_array());
        let Pose { rotation, translation } = pose;
        let numbers = light.chain(rotation.to_array()).chain(translation.to_array());
        numbers.for_each(|number| bytes.extend(number.to_le_bytes()));
    }
    let check = crc32fast::hash(&bytes);
    bytes.extend(check.to_le_bytes());
    bytes
}

/// The state of bytes, if it is that of `fingerprint`.
pub fn read_state(bytes: &[u8], fingerprint: u32) -> Result<MapState, SavedError> {
    if !bytes.starts_with(MAGIC) {
        return Err(SavedError::Foreign);
    }
    let (content, check) = bytes.split_last_chunk::<4>().ok_or(SavedError::Damaged)?;
    let body = content.get(HEADER..).ok_or(SavedError::Damaged)?;
    let word = |i: usize| {
        let at = 8 + 4 * i;
        u32::from_le_bytes([content[at], content[at + 1], content[at + 2], content[at + 3]])
    };
    let (numbers, pictures) = (word(3) as usize, word(4) as usize);
    let planes = numbers.checked_mul(12).ok_or(SavedError::Damaged)?;
    let expected = pictures.checked_mul(8 * PICTURE).and_then(|own| planes.checked_add(own));
    if expected != Some(body.len()) || crc32fast::hash(content) != u32::from_le_bytes(*check) {
        return Err(SavedError::Damaged);
    }
    if word(0) != fingerprint {
        return Err(SavedError::Other);
    }
    let (body, pictures) = body.split_at(planes);
    let (values, _) = body.as_chunks::<4>();
    let planes = |which: usize| {
        let own = &values[which * numbers..(which + 1) * numbers];
        own.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    };
    let training = TrainingState { parameters: planes(0), first: planes(1), second: planes(2) };
    let pictures = pictures.as_chunks::<{ 8 * PICTURE }>().0.iter().map(light_and_pose);
    let (exposures, poses) = pictures.unzip();
    Ok(MapState { step: word(1), alive: word(2), training, exposures, poses })
}

fn light_and_pose(bytes: &[u8; 8 * PICTURE]) -> (Exposure, Pose) {
    let (numbers, _) = bytes.as_chunks::<8>();
    let number = |i: usize| f64::from_le_bytes(numbers[i]);
    let triple = |first: usize| DVec3::from([0, 1, 2].map(|k| number(first + k)));
    let gain = DMat3::from_cols(triple(0), triple(3), triple(6));
    let rotation = DQuat::from_array([12, 13, 14, 15].map(number));
    (Exposure { gain, offset: triple(9) }, Pose { rotation, translation: triple(16) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> MapState {
        let planes = |by: f32| (0..28).map(|i| i as f32 * by).collect();
        let training =
            TrainingState { parameters: planes(1.5), first: planes(-2.0), second: planes(0.1) };
        let gain = DMat3::from_cols_array(&[1.1, 0.2, 0.0, -0.1, 0.9, 0.3, 0.05, 0.0, 1.0]);
        let light = Exposure { gain, offset: DVec3::new(0.1, -0.2, 0.3) };
        let poses = vec![Pose::IDENTITY, Pose::exp(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])];
        MapState { step: 700, alive: 2, training, exposures: vec![Exposure::NONE, light], poses }
    }

    #[test]
    fn a_state_comes_back() {
        assert_eq!(read_state(&write_state(&state(), 9), 9), Ok(state()));
    }

    #[test]
    fn what_is_cut_changed_or_foreign_is_refused() {
        let bytes = write_state(&state(), 9);
        assert_eq!(read_state(&bytes, 10), Err(SavedError::Other));
        for length in 0..bytes.len() {
            assert!(read_state(&bytes[..length], 9).is_err(), "{length}");
        }
        for place in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[place] ^= 4;
            assert!(read_state(&bytes, 9).is_err(), "{place}");
        }
    }
}
