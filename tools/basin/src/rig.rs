//! What the vehicle carries in black water: two cameras side by side, and two lamps.

use glam::{DQuat, DVec3};
use nvsprior::{Camera, Pose};

use super::lamp::{LEFT, Lamp, RIGHT};

/// The cameras and lamps of a dive at the tower. Other sites are lit from above, and have one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    /// Horizontal field of view, degrees.
    pub lens: f64,
    pub camera: RigCamera,
    pub lamps: Lamps,
}

/// A camera of the stereo pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigCamera {
    First,
    /// 0.2 m to the right of the first, with another response, gain and white balance.
    Second,
}

/// Which lamps are on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lamps {
    Both,
    Left,
    Right,
}

impl Rig {
    /// A narrow and a wide lens, degrees.
    pub const NARROW: f64 = 33.0;
    pub const WIDE: f64 = 80.0;

    /// The lens's pinhole camera at a width: 16:9.
    pub fn pinhole(&self, width: u32) -> Camera {
        let height = (9 * width + 8) / 16;
        let [cx, cy] = [width, height].map(|side| side as f32 / 2.0);
        let f = cx / (self.lens.to_radians() / 2.0).tan() as f32;
        Camera { width, height, fx: f, fy: f, cx, cy }
    }

    /// The pose of the camera that takes the pictures. `first`: that of the first one.
    pub(crate) fn pose(&self, first: &Pose) -> Pose {
        match self.camera {
            RigCamera::First => *first,
            // No mount is exact: it looks a little to the left, and is turned about its axis.
            RigCamera::Second => {
                let turn = DQuat::from_rotation_z(0.006) * DQuat::from_rotation_y(0.009);
                let rotation = turn * first.rotation;
                let centre = first.centre() + first.rotation.inverse() * (BASELINE * DVec3::X);
                Pose::from_centre(rotation, centre)
            }
        }
    }

    /// Tells passes by different rigs apart: each has its own snow and noise.
    pub(crate) fn tag(&self) -> u32 {
        3 * self.camera as u32 + self.lamps as u32
    }

    pub(crate) fn lit(&self) -> &'static [Lamp] {
        static BOTH: [Lamp; 2] = [LEFT, RIGHT];
        match self.lamps {
            Lamps::Both => &BOTH,
            Lamps::Left => &BOTH[..1],
            Lamps::Right => &BOTH[1..],
        }
    }
}

impl Default for Rig {
    fn default() -> Rig {
        Rig { lens: Rig::NARROW, camera: RigCamera::First, lamps: Lamps::Both }
    }
}

/// From the first camera to the second, metres.
const BASELINE: f64 = 0.2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lenses_see_as_wide_as_they_say() {
        for lens in [Rig::NARROW, Rig::WIDE] {
            let camera = Rig { lens, ..Rig::default() }.pinhole(640);
            let wide = 2.0 * (camera.cx / camera.fx).atan().to_degrees();
            assert!((f64::from(wide) - lens).abs() < 1e-4, "{wide}");
            assert_eq!((camera.width, camera.height), (640, 360));
        }
    }

    #[test]
    fn the_second_camera_stands_to_the_right_of_the_first() {
        let first = Pose::from_centre(DQuat::from_rotation_y(0.7), DVec3::new(1.0, -2.0, 0.5));
        let second = Rig { camera: RigCamera::Second, ..Rig::default() }.pose(&first);
        let seen = first.rotation * second.centre() + first.translation;
        assert!((seen - BASELINE * DVec3::X).length() < 1e-9, "{seen}");
        assert!((0.005..0.02).contains(&first.angle_to(&second)));
    }
}
