//! Key frames of a mapping run: the poses at which a lost camera is looked for.

mod range;

use nvsprior::prior::{KeyFrames, PriorError, Splats};
use nvsprior::{Camera, Pose};

pub use range::Sample;

/// Distance between key frames, as a share of the median distance to the splats. A step aside of 5 % of that distance
/// moves a picture by about 4 % of its width. The searches for a pose work from 10° off, which moves it by 15 %.
const SHARE: f64 = 0.05;

/// Angle between the directions of key frames at one place, degrees.
pub const ANGLE: f64 = 10.0;

/// Key frames of some views, and how they came about.
pub struct Thinned {
    pub key_frames: KeyFrames,
    /// How many of the views show the prior.
    pub seeing: usize,
    /// How far away what they show is.
    pub range: f64,
    /// How far apart key frames are.
    pub distance: f64,
}

impl Thinned {
    /// `None` if no view shows any of the splats; `angle` in degrees.
    pub fn of(
        sample: &Sample,
        views: &[(Camera, Pose)],
        distance: Option<f64>,
        angle: f64,
    ) -> Result<Option<Thinned>, PriorError> {
        let (poses, range) = sample.seen_by(views);
        let Some(range) = range else { return Ok(None) };
        let distance = distance.unwrap_or(SHARE * range);
        let key_frames = KeyFrames::thinned(&poses, distance, angle.to_radians())?;
        Ok(Some(Thinned { key_frames, seeing: poses.len(), range, distance }))
    }
}

/// The default key frames of a mapping run; none if it shows none of the splats.
pub fn of_run(
    splats: &Splats,
    near: f32,
    views: &[(Camera, Pose)],
) -> Result<KeyFrames, PriorError> {
    let thinned = Thinned::of(&Sample::of(splats, near), views, None, ANGLE)?;
    Ok(thinned.map_or(KeyFrames::NONE, |thinned| thinned.key_frames))
}
