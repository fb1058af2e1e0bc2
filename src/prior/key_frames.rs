//! Key frames: camera poses at which the prior is rendered as a thumbnail, to find a lost camera again.
//!
//! They are poses of the mapping run, thinned out. They travel with the prior: in a file of our own, in the comments of
//! a `.ply`, or beside a foreign file. They are no part of the prior's identity.

mod text;

use glam::DVec3;

use super::error::PriorError;
use super::limits::MAX_KEY_FRAMES;
use crate::Pose;
pub(super) use text::{pose_from_words, words};

/// A checked list of key frames, possibly empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeyFrames {
    poses: Vec<Pose>,
}

/// How far the length of a key frame's quaternion may be from 1.
const UNIT_TOLERANCE: f64 = 1e-6;

impl KeyFrames {
    /// Most key frames of a prior.
    pub const MAX: usize = MAX_KEY_FRAMES;

    /// None.
    pub const NONE: KeyFrames = KeyFrames { poses: Vec::new() };

    /// Checks world-to-camera poses, lengths in the prior's unit: at most [`MAX`](Self::MAX) of them, all numbers
    /// finite, quaternions of unit length, cameras within the range of f32. An error names the first pose that fails.
    pub fn new(poses: Vec<Pose>) -> Result<KeyFrames, PriorError> {
        if poses.len() > Self::MAX {
            return Err(PriorError::TooManyKeyFrames { count: poses.len() });
        }
        for (index, pose) in poses.iter().enumerate() {
            fault(pose).map_or(Ok(()), |reason| Err(PriorError::KeyFrame { index, reason }))?;
        }
        Ok(KeyFrames { poses })
    }

    /// Those of a prior whose splats count from `origin`.
    pub fn relative_to(&self, origin: DVec3) -> KeyFrames {
        KeyFrames { poses: self.poses.iter().map(|pose| pose.relative_to(origin)).collect() }
    }

    /// The poses, from the prior's [`origin`](super::Prior::origin).
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Thins out `poses`, in their order. A pose is left out if an earlier kept one is nearer than `distance` (the
    /// prior's unit) and looks in a direction less than `angle` (radians) away. So every pose left out has such a kept
    /// pose, and no two kept poses are that near. Roll about the optical axis does not count: the search for a lost
    /// camera works for any roll. If `distance` or `angle` is not above 0, all poses are kept.
    ///
    /// Fails as [`new`](Self::new) does, also if more than [`MAX`](Self::MAX) remain. The time grows with the number of
    /// poses times the number kept.
    pub fn thinned(poses: &[Pose], distance: f64, angle: f64) -> Result<KeyFrames, PriorError> {
        let mut kept: Vec<(DVec3, DVec3)> = Vec::new();
        let mut key_frames = Vec::new();
        for (index, pose) in poses.iter().enumerate() {
            fault(pose).map_or(Ok(()), |reason| Err(PriorError::KeyFrame { index, reason }))?;
            let (centre, direction) = (pose.centre(), viewing_direction(pose));
            let near = |(other, looking): &(DVec3, DVec3)| {
                centre.distance(*other) < distance && angle_between(direction, *looking) < angle
            };
            // A run's newest poses are the likeliest to be near.
            if kept.iter().rev().any(near) {
                continue;
            }
            if kept.len() == Self::MAX {
                return Err(PriorError::TooManyKeyFrames { count: Self::MAX + 1 });
            }
            kept.push((centre, direction));
            key_frames.push(*pose);
        }
        KeyFrames::new(key_frames)
    }

    /// Least and greatest camera position on each axis, in the prior's unit; `None` if there are no
    /// key frames.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let mut centres = self.poses.iter().map(Pose::centre);
        let first = centres.next()?;
        Some(centres.fold([first; 2], |[min, max], c| [min.min(c), max.max(c)]))
    }
}

/// What is wrong with a pose as a key frame.
fn fault(pose: &Pose) -> Option<&'static str> {
    if !pose.is_finite() {
        return Some("a number that is not finite");
    }
    if !((pose.rotation.length() - 1.0).abs() <= UNIT_TOLERANCE) {
        return Some("a quaternion that has not the length 1");
    }
    let reached = pose.centre().to_array().iter().all(|v| (*v as f32).is_finite());
    (!reached).then_some("a camera farther away than f32 reaches")
}

/// The camera's optical axis in the world, `Rᵀ (0, 0, 1)`.
fn viewing_direction(pose: &Pose) -> DVec3 {
    pose.rotation.conjugate() * DVec3::Z
}

/// Angle between two directions, radians; exact for small ones, too.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

#[cfg(test)]
pub(crate) mod tests;
