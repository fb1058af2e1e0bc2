//! The part of a key frame that a step of training looks at.

use crate::Camera;

/// The size of the parts that pictures of a size are trained by: half of it, unless that is very small.
pub fn part_size([width, height]: [u32; 2]) -> [u32; 2] {
    [width.div_ceil(2).max(64).min(width), height.div_ceil(2).max(64).min(height)]
}

/// The corner of the part around a pixel.
pub fn corner_around([x, y]: [usize; 2], size: [u32; 2], part: [u32; 2]) -> [u32; 2] {
    let corner =
        |at: usize, size: u32, part: u32| (at as u32).saturating_sub(part / 2).min(size - part);
    [corner(x, size[0], part[0]), corner(y, size[1], part[1])]
}

/// The camera whose whole picture is that part.
pub fn camera_of(camera: &Camera, [left, top]: [u32; 2], [width, height]: [u32; 2]) -> Camera {
    let (cx, cy) = (camera.cx - left as f32, camera.cy - top as f32);
    Camera { width, height, cx, cy, ..*camera }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_lies_inside_its_picture_and_shows_the_pixel() {
        for size in [[320, 180], [100, 70], [40, 30], [641, 359]] {
            let part = part_size(size);
            for at in [[0, 0], [size[0] - 1, size[1] - 1], [size[0] / 2, size[1] / 3]] {
                let corner = corner_around(at.map(|v| v as usize), size, part);
                for k in 0..2 {
                    assert!(corner[k] + part[k] <= size[k], "{corner:?} + {part:?} in {size:?}");
                    assert!((corner[k]..corner[k] + part[k]).contains(&at[k]), "{at:?}");
                }
            }
        }
    }

    #[test]
    fn a_point_shows_at_its_place_in_the_part() {
        let camera = Camera { width: 320, height: 180, fx: 200.0, fy: 200.0, cx: 160.0, cy: 90.0 };
        let part = camera_of(&camera, [70, 20], [160, 90]);
        let across = |camera: &Camera| 0.2 * camera.fx + camera.cx;
        assert_eq!(across(&part), across(&camera) - 70.0);
        assert_eq!((part.width, part.height), (160, 90));
    }
}
