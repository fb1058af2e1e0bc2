//! Difference pictures: `camera − render`, offset so that 128 means none.

use crate::Picture;

/// `clamp(camera − render, −128, 127) + 128` in every channel.
///
/// # Panics
/// Where the sizes differ.
pub fn difference(camera: &Picture, render: &Picture) -> Picture {
    combine(camera, render, |c, r| (c - r).clamp(-128, 127) + 128)
}

/// `clamp(render + difference − 128, 0, 255)` in every channel: undoes [`difference`] where it did
/// not clamp.
///
/// # Panics
/// Where the sizes differ.
pub fn apply(render: &Picture, difference: &Picture) -> Picture {
    combine(render, difference, |r, d| (r + d - 128).clamp(0, 255))
}

/// A picture made of two, value by value; `f` must stay within a byte.
fn combine(a: &Picture, b: &Picture, f: impl Fn(i16, i16) -> i16) -> Picture {
    assert_eq!((a.width, a.height), (b.width, b.height), "picture sizes differ");
    let values = std::iter::zip(&a.data, &b.data);
    let data = values.map(|(a, b)| f(i16::from(*a), i16::from(*b)) as u8).collect();
    Picture { width: a.width, height: a.height, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pairs of two bytes, as two pictures.
    fn all_pairs() -> (Picture, Picture) {
        let mut camera = Picture::new(256, 256);
        let mut render = Picture::new(256, 256);
        for (i, (c, r)) in camera.data.iter_mut().zip(&mut render.data).enumerate() {
            (*c, *r) = ((i / 3 / 256) as u8, (i / 3 % 256) as u8);
        }
        (camera, render)
    }

    #[test]
    fn applying_undoes_the_difference_within_its_range() {
        let (camera, render) = all_pairs();
        let back = apply(&render, &difference(&camera, &render));
        for (i, c) in camera.data.iter().enumerate() {
            let offset = i16::from(*c) - i16::from(render.data[i]);
            let lost = (offset - offset.clamp(-128, 127)).unsigned_abs();
            assert_eq!(u16::from(c.abs_diff(back.data[i])), lost);
        }
    }

    #[test]
    fn no_difference_is_grey() {
        let (camera, _) = all_pairs();
        assert!(difference(&camera, &camera).data.iter().all(|v| *v == 128));
    }

    #[test]
    fn applying_saturates() {
        let pixel = |v| Picture::from_rgb(1, 1, vec![v; 3]).unwrap();
        assert_eq!(apply(&pixel(200), &pixel(255)), pixel(255));
        assert_eq!(apply(&pixel(50), &pixel(0)), pixel(0));
    }
}
