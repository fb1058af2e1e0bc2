//! The parts of a stated coordinate frame, and of the origin of the positions.

use super::super::{CoordinateFrame, PriorError};
use super::words::{Words, refusal};

const FORMAT: &str = "coordinate frame";

pub fn to_bytes(frame: &CoordinateFrame) -> Vec<u8> {
    let [x, y, z] = frame.centre;
    [x, y, z, frame.spread].into_iter().flat_map(f32::to_le_bytes).collect()
}

pub fn read(content: &[u8], at: usize) -> Result<CoordinateFrame, PriorError> {
    let mut words = Words::new(content, at);
    let [centre @ .., spread] = words.floats::<4>()?;
    words.end(FORMAT)?;
    let sound = centre.iter().all(|v| v.is_finite()) && spread > 0.0 && spread.is_finite();
    let frame = CoordinateFrame { centre, spread };
    sound.then_some(frame).ok_or_else(|| refusal(FORMAT, at, "no place and size of a prior"))
}

pub fn read_origin(content: &[u8], at: usize) -> Result<[f64; 3], PriorError> {
    let mut words = Words::new(content, at);
    let origin = words.doubles::<3>()?;
    words.end("origin")?;
    let sound = origin.iter().all(|v| v.is_finite()) && origin != [0.0; 3];
    sound.then_some(origin).ok_or_else(|| refusal("origin", at, "no place away from zero"))
}
