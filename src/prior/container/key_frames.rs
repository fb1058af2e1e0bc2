//! The part of key frames: ten bytes each.
//!
//! As for splats, only additions, products, quotients and square roots are used: the poses are the
//! same on every machine.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DQuat, DVec3};

use super::super::{KeyFrames, PriorError};
use super::words::{Words, refusal};
use crate::Pose;

/// What errors call them.
const FORMAT: &str = "key frames";

/// Largest code of a coordinate.
const MAX: f64 = u16::MAX as f64;

/// The code of a quaternion's component that is zero. The largest code is twice this.
const ZERO: i32 = 511;

/// The most that the squares of the three smaller components can add up to: 3/4, and a little for rounding.
const MAX_SQUARES: f64 = 0.76;

/// The part of at least one key frame; of none, nothing.
pub fn to_bytes(key_frames: &KeyFrames) -> Vec<u8> {
    let Some(ends) = key_frames.bounds() else { return Vec::new() };
    let bounds = Bounds::of(&ends);
    let mut bytes = (key_frames.len() as u32).to_le_bytes().to_vec();
    bytes.extend([bounds.min, bounds.max].as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    for pose in key_frames.poses() {
        bytes.extend(bounds.code(pose.centre(), &ends).into_iter().flat_map(u16::to_le_bytes));
        bytes.extend(pack(pose.rotation).to_le_bytes());
    }
    bytes
}

/// Reads the part, whose content begins at byte `at` of the file.
pub fn read(content: &[u8], at: usize) -> Result<KeyFrames, PriorError> {
    let mut words = Words::new(content, at);
    let count = words.word()? as usize;
    if count == 0 || count > KeyFrames::MAX {
        return Err(refusal(FORMAT, at, format!("{count} of them: 1 to {}", KeyFrames::MAX)));
    }
    let bounds = Bounds { min: words.floats()?, max: words.floats()? };
    if !bounds.are_sound() {
        return Err(refusal(FORMAT, at + 4, "no bounds of camera positions"));
    }
    let mut poses = Vec::new();
    for _ in 0..count {
        let place = [words.short()?, words.short()?, words.short()?];
        let (offset, rotation) = (words.at(), unpack(words.word()?));
        let rotation = rotation.ok_or_else(|| refusal(FORMAT, offset, "no rotation"))?;
        poses.push(Pose::from_centre(rotation, bounds.position(place)));
    }
    words.end(FORMAT)?;
    KeyFrames::new(poses)
}

/// Least and greatest camera position on each axis.
struct Bounds {
    min: [f32; 3],
    max: [f32; 3],
}

impl Bounds {
    /// `ends`: least and greatest positions.
    fn of(ends: &[DVec3; 2]) -> Bounds {
        // Rounded to f32. It stays within the range of f32: key frames are checked for that.
        let [min, max] = ends.map(|v| v.to_array().map(|v| v as f32));
        Bounds { min, max }
    }

    fn are_sound(&self) -> bool {
        let pairs = || self.min.iter().zip(&self.max);
        pairs().all(|(min, max)| min.is_finite() && max.is_finite() && min <= max)
    }

    /// The least and greatest position on an axis.
    fn axis(&self, axis: usize) -> (f64, f64) {
        (self.min[axis].into(), self.max[axis].into())
    }

    /// A position in 65,535ths of the bounds, which are those of `ends`.
    fn code(&self, position: DVec3, [least, greatest]: &[DVec3; 2]) -> [u16; 3] {
        std::array::from_fn(|axis| {
            let (min, max) = self.axis(axis);
            let own = position[axis];
            // A step may be finer than what rounding has moved the bounds by. So the ends are the bounds, and stay that
            // when they are read and written again.
            let share = if max <= min || own <= least[axis] {
                0.0
            } else if own >= greatest[axis] {
                1.0
            } else {
                (own - min) / (max - min)
            };
            // What rounding the bounds has put outside of them is clamped.
            (share * MAX).round() as u16
        })
    }

    fn position(&self, code: [u16; 3]) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|axis| {
            let ((min, max), share) = (self.axis(axis), f64::from(code[axis]) / MAX);
            min * (1.0 - share) + max * share
        }))
    }
}

/// Packs a unit quaternion, (w, x, y, z): two bits name the largest component, which counts as
/// positive; the others follow in order, ten bits each.
fn pack(rotation: DQuat) -> u32 {
    // A rotation that was read gets the same word again, even if two components are equal or two words give one
    // rotation: the first word that a reader turns into this rotation is taken.
    word_of(rotation).unwrap_or_else(|| {
        let q = components(rotation);
        let mut largest = 0;
        for place in 1..4 {
            if q[place].abs() > q[largest].abs() {
                largest = place;
            }
        }
        let word = pack_without(q, largest);
        unpack(word).and_then(word_of).unwrap_or(word)
    })
}

/// The first word that stands for exactly this rotation.
fn word_of(rotation: DQuat) -> Option<u32> {
    let words = (0..4).map(|largest| pack_without(components(rotation), largest));
    words.into_iter().find(|word| unpack(*word) == Some(rotation))
}

fn components(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

fn pack_without(q: [f64; 4], largest: usize) -> u32 {
    let sign = 1_f64.copysign(q[largest]);
    let others = (0..4).filter(|place| *place != largest);
    others.fold(largest as u32, |word, place| {
        let steps = (sign * q[place] / FRAC_1_SQRT_2 * f64::from(ZERO)).round() as i32;
        word << 10 | (steps.clamp(-ZERO, ZERO) + ZERO) as u32
    })
}

/// The unit quaternion of a word; `None` if the component named as largest would not be the largest.
fn unpack(word: u32) -> Option<DQuat> {
    let mut q = [0.0; 4];
    let largest = (word >> 30) as usize;
    for (place, shift) in (0..4).filter(|place| *place != largest).zip([20, 10, 0]) {
        let steps = (word >> shift & 1023) as i32 - ZERO;
        if steps > ZERO {
            return None;
        }
        q[place] = f64::from(steps) / f64::from(ZERO) * FRAC_1_SQRT_2;
    }
    let squares: f64 = q.iter().map(|v| v * v).sum();
    q[largest] = (1.0 - squares).sqrt();
    (squares <= MAX_SQUARES).then(|| DQuat::from_xyzw(q[1], q[2], q[3], q[0]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::prior::key_frames::tests::sample_key_frames;

    /// The poses and those read from what was written.
    fn read_back(key_frames: &KeyFrames) -> KeyFrames {
        let bytes = to_bytes(key_frames);
        assert_eq!(bytes.len(), 28 + 10 * key_frames.len());
        read(&bytes, 76).unwrap()
    }

    fn assert_near(before: &KeyFrames, after: &KeyFrames) {
        assert_eq!(before.len(), after.len());
        let [min, max] = before.bounds().unwrap();
        for (a, b) in before.poses().iter().zip(after.poses()) {
            let off = (a.centre() - b.centre()).abs();
            for axis in 0..3 {
                // Half a step, and what rounding the bounds to f32 may move them by.
                let far = min[axis].abs().max(max[axis].abs());
                let limit = 0.51 * (max[axis] - min[axis]) / MAX + 1.3e-7 * far + 1e-44;
                assert!(off[axis] <= limit, "{} of {limit}", off[axis]);
            }
            // Twice the quaternion's error: at worst √12 half steps of √½/511.
            assert!(a.angle_to(b) <= 0.0049, "{} rad", a.angle_to(b));
        }
    }

    #[test]
    fn poses_come_back_within_half_a_step() {
        let key_frames = sample_key_frames(40);
        assert_near(&key_frames, &read_back(&key_frames));
        assert!(to_bytes(&KeyFrames::NONE).is_empty());
        // One, and several at one place.
        for count in [1, 3] {
            let run = sample_key_frames(count);
            let place = DVec3::new(1.0, -2.5, 1e3);
            let poses = run.poses().iter().map(|p| Pose::from_centre(p.rotation, place));
            let alike = KeyFrames::new(poses.collect()).unwrap();
            assert_near(&alike, &read_back(&alike));
        }
    }

    #[test]
    fn cameras_at_the_ends_of_f32_stay_finite() {
        let max = f64::from(f32::MAX);
        let pose = |x| Pose::from_centre(DQuat::from_rotation_y(0.3), DVec3::new(x, max, 0.0));
        let key_frames = KeyFrames::new(vec![pose(-max), pose(max), pose(1.0)]).unwrap();
        assert_near(&key_frames, &read_back(&key_frames));
    }

    #[test]
    fn special_rotations_are_exact() {
        let h = FRAC_1_SQRT_2;
        for q in [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [h, 0.0, h, 0.0], [0.0, -h, 0.0, h]]
        {
            let pose = Pose::from_wxyz(q, [0.0; 3]).unwrap();
            let read = unpack(pack(pose.rotation)).unwrap();
            assert!(Pose { rotation: read, ..pose }.angle_to(&pose) < 1e-7, "{q:?}");
        }
    }

    #[test]
    fn what_no_writer_leaves_is_refused() {
        let valid = to_bytes(&sample_key_frames(3));
        let error = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = valid.clone();
            change(&mut bytes);
            read(&bytes, 76).unwrap_err()
        };
        for count in [0, 65_537, u32::MAX] {
            let error = error(&|b| b[..4].copy_from_slice(&count.to_le_bytes()));
            assert!(matches!(error, PriorError::Field { offset: 76, .. }), "{error}");
        }
        let cut = error(&|b| b[..4].copy_from_slice(&4_u32.to_le_bytes()));
        assert!(matches!(cut, PriorError::Truncated { needed: 136, found: 134 }), "{cut}");
        assert!(matches!(error(&|b| b.truncate(27)), PriorError::Truncated { .. }));
        for (at, value) in [(4, f32::NAN), (8, f32::INFINITY), (12, 1e30)] {
            let error = error(&|b| b[at..at + 4].copy_from_slice(&value.to_le_bytes()));
            assert!(matches!(error, PriorError::Field { offset: 80, .. }), "{error}");
        }
        // An invalid code, and three components so large that the fourth cannot be larger.
        for word in [1023, u32::MAX >> 2, 1022 << 20 | 1022 << 10 | 1022] {
            let error = error(&|b| b[44..48].copy_from_slice(&word.to_le_bytes()));
            assert!(matches!(error, PriorError::Field { offset: 120, .. }), "{error}");
        }
    }

    proptest! {
        #[test]
        fn what_was_read_is_written_the_same_again(
            rows in proptest::collection::vec(proptest::array::uniform7(-1.0..1.0_f64), 1..40),
            size in 1e-3..1e6_f64,
        ) {
            let poses = rows.iter().filter_map(|r| {
                Pose::from_wxyz([r[0], r[1], r[2], r[3]], [r[4] * size, r[5] * size, r[6] * size])
            });
            let key_frames = KeyFrames::new(poses.collect()).unwrap();
            prop_assume!(!key_frames.is_empty());
            let read = read_back(&key_frames);
            assert_near(&key_frames, &read);
            prop_assert_eq!(to_bytes(&read), to_bytes(&key_frames));
        }

        #[test]
        fn arbitrary_sections_are_an_error_or_key_frames(
            mut bytes in proptest::collection::vec(any::<u8>(), 0..200),
            count in 0..20_u32,
        ) {
            if let Some(word) = bytes.first_chunk_mut::<4>() {
                *word = count.to_le_bytes();
            }
            if let Ok(found) = read(&bytes, 76) {
                prop_assert_eq!(found.len(), count as usize);
                prop_assert!(KeyFrames::new(found.poses().to_vec()).is_ok());
            }
        }
    }
}
