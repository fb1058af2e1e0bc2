//! From how different sides a mapping run saw each splat: what tells its depth.

use glam::{DQuat, DVec3};
use nvsprior::prior::Splats;
use nvsprior::vulkan::Error;
use nvsprior::{Camera, Engine, Pose, Prior};

use crate::coverage::median;
use crate::drawn::Drawn;

/// Splats with less opacity show nothing. (Training makes surfaces of many faint splats.)
const OPAQUE: f64 = 0.02;
/// A splat is seen if it lies no deeper than so many times the depth of its pixel, and the pixel shows something.
const BEHIND: f64 = 1.1;
const SHOWN: f32 = 0.5;
/// Angle between two views of a splat from which on they are two sides, degrees.
pub const TWO_SIDES: f64 = 15.0;
/// How far round the next picture is taken, degrees.
const ARC: f64 = 30.0;

/// Arcs up and down are asked for only if those to the sides are this much nearer to other cameras.
const STEEP: f64 = 0.8;

/// The views of a splat that are farthest apart, as directions from it.
#[derive(Clone, Copy)]
struct Sides {
    ends: [DVec3; 2],
    seen: bool,
}

impl Sides {
    const NONE: Sides = Sides { ends: [DVec3::ZERO; 2], seen: false };

    fn angle(&self) -> f64 {
        self.ends[0].angle_between(self.ends[1])
    }

    /// Takes another view, if it is farther from one of the two than these are from each other.
    fn see(&mut self, direction: DVec3) {
        if !self.seen {
            *self = Sides { ends: [direction; 2], seen: true };
            return;
        }
        let [a, b] = self.ends;
        let (from_a, from_b) = (a.angle_between(direction), b.angle_between(direction));
        if from_a.max(from_b) > self.angle() {
            self.ends = if from_a >= from_b { [a, direction] } else { [direction, b] };
        }
    }
}

/// From how different sides the splats of a prior were seen.
pub struct Parallax {
    /// Of each splat: the largest angle between two views of it, radians. `None`: it is seen in none, or shows nothing.
    pub angles: Vec<Option<f64>>,
}

/// A picture to take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    pub pose: Pose,
    /// What to look at.
    pub about: DVec3,
    /// Which way round, from the cameras that there are: `left`, `right`, `above` or `below`.
    pub side: &'static str,
}

impl Parallax {
    /// Of a prior, by the views that it was trained on.
    pub fn of(
        engine: &Engine,
        prior: &Prior,
        views: &[(Camera, Pose)],
        told: &mut dyn FnMut(),
    ) -> Result<Parallax, Error> {
        let (splats, mut drawn) = (prior.splats(), Drawn::new(engine, prior)?);
        let mut sides = vec![Sides::NONE; splats.len()];
        for (camera, pose) in views {
            see(splats, camera, pose, drawn.draw(camera, pose)?, &mut sides);
            told();
        }
        let shows = |index: usize| splats.opacity(index) > OPAQUE;
        let angle =
            |(index, sides): (usize, &Sides)| (sides.seen && shows(index)).then(|| sides.angle());
        Ok(Parallax { angles: sides.iter().enumerate().map(angle).collect() })
    }

    /// The middle of all angles, radians; `None`: nothing was seen.
    pub fn median(&self) -> Option<f64> {
        let mut angles: Vec<f64> = self.angles.iter().flatten().copied().collect();
        angles.sort_by(f64::total_cmp);
        angles.get(angles.len() / 2).copied()
    }

    /// Share of what was seen that was seen from two sides.
    pub fn from_two_sides(&self) -> f64 {
        let seen = self.angles.iter().flatten().count();
        let both = self.angles.iter().flatten().filter(|angle| angle.to_degrees() >= TWO_SIDES);
        both.count() as f64 / seen.max(1) as f64
    }

    /// The picture to take next: an arc around the middle of what was seen from one side only, to where no camera is
    /// near. `None`: all was seen from two sides.
    pub fn wanted(&self, splats: &Splats, views: &[(Camera, Pose)]) -> Option<Wanted> {
        let weak = |angle: &Option<f64>| angle.is_some_and(|a| a.to_degrees() < TWO_SIDES);
        let places = self.angles.iter().zip(&splats.positions).filter(|(angle, _)| weak(angle));
        let places: Vec<DVec3> = places.map(|(_, p)| DVec3::from(p.map(f64::from))).collect();
        let middle = |axis: usize| median(places.iter().map(|place| place[axis]).collect());
        let about = DVec3::new(middle(0)?, middle(1)?, middle(2)?);
        let from = usual(views, about)?;
        let seen = from.rotation * about + from.translation;
        let distance = |to: DVec3| move |pose: &Pose| (pose.centre() - to).length();
        let turned = |(side, axis, angle): (&'static str, DVec3, f64)| Wanted {
            pose: orbited(&from, seen, axis, angle.to_radians()),
            about,
            side,
        };
        let turns = [
            ("right", DVec3::Y, ARC),
            ("left", DVec3::Y, -ARC),
            ("above", DVec3::X, ARC),
            ("below", DVec3::X, -ARC),
        ];
        let apart = |wanted: &Wanted| {
            let to = wanted.pose.centre();
            let level = matches!(wanted.side, "left" | "right");
            let nearest = views.iter().map(|(_, pose)| distance(to)(pose)).fold(f64::MAX, f64::min);
            nearest * if level { 1.0 } else { STEEP }
        };
        turns.map(turned).into_iter().max_by(|a, b| apart(a).total_cmp(&apart(b)))
    }
}

/// Of the views that look towards a point, the one at the middle distance.
fn usual(views: &[(Camera, Pose)], to: DVec3) -> Option<Pose> {
    let distance = |pose: &Pose| (pose.centre() - to).length();
    let ahead = |pose: &Pose| (pose.rotation * to + pose.translation).z > 0.0;
    let mut poses: Vec<Pose> = views.iter().map(|(_, pose)| *pose).filter(ahead).collect();
    poses.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    poses.get(poses.len() / 2).copied()
}

/// A camera that went round a point by an angle, about an axis of its own through that point; it turns as much. `seen`:
/// the point, in the camera's axes.
pub fn orbited(pose: &Pose, seen: DVec3, axis: DVec3, angle: f64) -> Pose {
    let rotation = DQuat::from_axis_angle(axis, angle);
    Pose { rotation, translation: seen - rotation * seen }.after(pose)
}

/// Notes which splats a view sees. `pixels`: as they are [drawn](Drawn::draw).
fn see(splats: &Splats, camera: &Camera, pose: &Pose, pixels: &[[f32; 5]], sides: &mut [Sides]) {
    let centre = pose.centre();
    for (position, sides) in splats.positions.iter().zip(sides) {
        let place = DVec3::from(position.map(f64::from));
        let p = pose.rotation * place + pose.translation;
        let x = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
        let y = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
        let within = |v: f64, side: u32| v >= 0.0 && v < f64::from(side);
        if !(p.z > 0.0 && within(x, camera.width) && within(y, camera.height)) {
            continue;
        }
        let [_, _, _, depth, transmittance] =
            pixels[y as usize * camera.width as usize + x as usize];
        let shown = 1.0 - transmittance;
        if shown > SHOWN && p.z < BEHIND * f64::from(depth / shown) {
            sides.see((centre - place).normalize_or_zero());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_views_farthest_apart_count() {
        let mut sides = Sides::NONE;
        let at =
            |degrees: f64| DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
        for degrees in [0.0, 5.0, -3.0, 12.0, 2.0] {
            sides.see(at(degrees));
        }
        assert!((sides.angle().to_degrees() - 15.0).abs() < 1e-6, "{}", sides.angle().to_degrees());
    }

    #[test]
    fn a_camera_that_goes_round_looks_at_the_same_point() {
        let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, -2.0, 3.0]).unwrap();
        let about = pose.inverse().rotation * DVec3::new(0.1, -0.2, 2.0) + pose.centre();
        for axis in [DVec3::X, DVec3::Y] {
            let other = orbited(&pose, DVec3::new(0.1, -0.2, 2.0), axis, 0.5);
            let (before, after) = (pose.centre() - about, other.centre() - about);
            assert!((before.length() - after.length()).abs() < 1e-9);
            let seen = [pose, other].map(|pose| pose.rotation * about + pose.translation);
            assert!((seen[0] - seen[1]).length() < 1e-9);
        }
    }

    #[test]
    fn what_one_side_saw_asks_for_an_arc() {
        let splats = Splats {
            origin: [0.0; 3],
            positions: vec![[0.0, 0.0, 4.0]],
            log_scales: vec![[-3.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            opacity_logits: vec![3.0],
            sh: vec![0.0; 3],
            sh_degree: 0,
        };
        let camera = Camera { width: 20, height: 20, fx: 10.0, fy: 10.0, cx: 10.0, cy: 10.0 };
        let from = |x: f64| Pose::from_centre(DQuat::IDENTITY, DVec3::new(x, 0.0, 0.0));
        let views = [(camera, from(0.0)), (camera, from(0.2)), (camera, from(0.9))];
        let seen = |degrees: f64| Parallax { angles: vec![Some(degrees.to_radians()), None] };
        let wanted = seen(5.0).wanted(&splats, &views).unwrap();
        // The usual camera stands at 0.2; another one is far to its right.
        assert_eq!((wanted.about, wanted.side), (DVec3::new(0.0, 0.0, 4.0), "left"));
        let place = wanted.pose.centre();
        assert!(place.x < -1.7 && place.y.abs() < 1e-6, "{wanted:?}");
        assert_eq!(seen(20.0).wanted(&splats, &views), None);
        assert_eq!((seen(5.0).from_two_sides(), seen(20.0).from_two_sides()), (0.0, 1.0));
        assert_eq!(Parallax { angles: vec![None] }.median(), None);
    }
}
