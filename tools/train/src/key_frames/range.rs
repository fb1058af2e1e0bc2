//! The distance from cameras to the splats that they show.

use glam::DVec3;
use nvsprior::prior::Splats;
use nvsprior::{Camera, Pose};

use crate::coverage::median;

/// Most splats of a sample, evenly spaced in the prior's list.
const SPLATS: usize = 20_000;

/// Splats that stand for a prior's.
pub struct Sample {
    positions: Vec<DVec3>,
    near: f64,
}

impl Sample {
    /// Takes a sample of splats, which are culled up to the plane `near`.
    pub fn of(splats: &Splats, near: f32) -> Sample {
        let every = splats.len().div_ceil(SPLATS).max(1);
        let positions = splats.positions.iter().step_by(every);
        let positions = positions.map(|p| DVec3::from(p.map(f64::from))).collect();
        Sample { positions, near: near.into() }
    }

    /// The poses of the views that show any of the splats, and the median of their median distances
    /// to the splats that they show.
    pub fn seen_by(&self, views: &[(Camera, Pose)]) -> (Vec<Pose>, Option<f64>) {
        let seen =
            views.iter().filter_map(|(camera, pose)| Some((*pose, self.distance(camera, pose)?)));
        let (poses, distances): (Vec<Pose>, Vec<f64>) = seen.unzip();
        (poses, median(distances))
    }

    /// Median distance from a camera to the splats whose centres it shows.
    fn distance(&self, camera: &Camera, pose: &Pose) -> Option<f64> {
        let within = |v: f64, side: u32| (0.0..f64::from(side)).contains(&v);
        let distances = self.positions.iter().filter_map(|position| {
            let p = pose.rotation * *position + pose.translation;
            let x = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
            let y = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
            let shown = p.z > self.near && within(x, camera.width) && within(y, camera.height);
            shown.then(|| p.length())
        });
        median(distances.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_what_is_in_front_and_within_the_picture() {
        // On the axis at 1 to 5, behind the camera, before the near plane, and beside the picture.
        let z = [1.0, 2.0, 3.0, 4.0, 5.0, -2.0, 0.1];
        let mut positions: Vec<[f32; 3]> = z.iter().map(|z| [0.0, 0.0, *z]).collect();
        positions.push([1.1, 0.0, 1.0]);
        let count = positions.len();
        let splats = Splats {
            origin: [0.0; 3],
            positions,
            log_scales: vec![[-3.0; 3]; count],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
            opacity_logits: vec![1.0; count],
            sh: vec![0.0; 3 * count],
            sh_degree: 0,
        };
        let camera = Camera { width: 20, height: 20, fx: 10.0, fy: 10.0, cx: 10.0, cy: 10.0 };
        let away = Pose::from_wxyz([0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -9.0]).unwrap();
        let sample = Sample::of(&splats, 0.2);
        let (poses, range) = sample.seen_by(&[(camera, away), (camera, Pose::IDENTITY)]);
        assert_eq!((poses, range), (vec![Pose::IDENTITY], Some(3.0)));
        assert_eq!(sample.seen_by(&[(camera, away)]), (vec![], None));
    }
}
