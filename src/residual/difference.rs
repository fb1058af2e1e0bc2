//! Difference pictures: `camera − render`, offset so that 128 means none.

use crate::Picture;

/// `clamp(camera − render, −128, 127) + 128` in every channel.
///
/// # Panics
/// If the sizes differ.
pub fn difference(frame: &Picture, render: &Picture) -> Picture {
    let mut into = Picture::new(frame.width, frame.height);
    difference_into(frame, render, &mut into);
    into
}

/// [`difference`], into a picture of the same size.
///
/// # Panics
/// If the sizes differ.
pub(super) fn difference_into(frame: &Picture, render: &Picture, into: &mut Picture) {
    for other in [render, &*into] {
        assert_eq!((frame.width, frame.height), (other.width, other.height), "sizes differ");
    }
    let values = std::iter::zip(&frame.data, &render.data);
    for (to, (&c, &r)) in into.data.iter_mut().zip(values) {
        *to = ((i16::from(c) - i16::from(r)).clamp(-128, 127) + 128) as u8;
    }
}

/// `clamp(render + difference − 128, 0, 255)`, in place, byte by byte. Undoes [`difference`],
/// except for bytes that it clamped.
pub fn add(difference: &[u8], render: &mut [u8]) {
    for (to, &d) in render.iter_mut().zip(difference) {
        *to = (i16::from(*to) + i16::from(d) - 128).clamp(0, 255) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pairs of two bytes, as two pictures.
    fn all_pairs() -> (Picture, Picture) {
        let mut frame = Picture::new(256, 256);
        let mut render = Picture::new(256, 256);
        for (i, (c, r)) in frame.data.iter_mut().zip(&mut render.data).enumerate() {
            (*c, *r) = ((i / 3 / 256) as u8, (i / 3 % 256) as u8);
        }
        (frame, render)
    }

    #[test]
    fn adding_undoes_the_difference_within_its_range() {
        let (frame, render) = all_pairs();
        let mut back = render.clone();
        add(&difference(&frame, &render).data, &mut back.data);
        for (i, c) in frame.data.iter().enumerate() {
            let offset = i16::from(*c) - i16::from(render.data[i]);
            let lost = (offset - offset.clamp(-128, 127)).unsigned_abs();
            assert_eq!(u16::from(c.abs_diff(back.data[i])), lost);
        }
    }

    #[test]
    fn no_difference_is_grey() {
        let (frame, _) = all_pairs();
        assert!(difference(&frame, &frame).data.iter().all(|v| *v == 128));
    }

    #[test]
    fn adding_saturates() {
        let mut render = [200, 50, 7];
        add(&[255, 0, 128], &mut render);
        assert_eq!(render, [255, 0, 7]);
    }
}
