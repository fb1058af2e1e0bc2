//! Are red and blue exchanged? Libraries differ in the order of a pixel's bytes.

use crate::Picture;

/// Frames that are looked at.
const FRAMES: u32 = 3;
/// So many times as far from the render as with red and blue exchanged.
const MUCH: u64 = 2;

/// Looks at an encoder's first frames, until one is told.
#[derive(Default)]
pub struct ColourOrder {
    looked: u32,
}

impl ColourOrder {
    /// Whether a frame is much nearer to the prior's render with red and blue exchanged.
    pub fn is_exchanged(&mut self, frame: &Picture, render: &Picture) -> bool {
        if self.looked >= FRAMES {
            return false;
        }
        self.looked += 1;
        let square = |a: u8, b: u8| u64::from(a.abs_diff(b)).pow(2);
        let (mut as_given, mut exchanged) = (0, 0);
        let (frame, render) = (frame.data.as_chunks::<3>().0, render.data.as_chunks::<3>().0);
        for (frame, render) in frame.iter().zip(render) {
            as_given += square(frame[0], render[0]) + square(frame[2], render[2]);
            exchanged += square(frame[2], render[0]) + square(frame[0], render[2]);
        }
        let found = as_given > MUCH * exchanged;
        if found {
            self.looked = FRAMES;
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(rgb: [u8; 3]) -> Picture {
        let data = (0..64u8).flat_map(|i| rgb.map(|value| value.wrapping_add(i)));
        Picture::from_rgb(8, 8, data.collect()).expect("its size")
    }

    #[test]
    fn an_exchange_is_told_once_and_only_of_first_frames() {
        let (render, exchanged) = (picture([20, 90, 150]), picture([150, 90, 20]));
        let mut order = ColourOrder::default();
        assert!(!order.is_exchanged(&render, &render));
        assert!(order.is_exchanged(&exchanged, &render));
        assert!(!order.is_exchanged(&exchanged, &render), "once");
        let mut late = ColourOrder::default();
        (0..FRAMES).for_each(|_| assert!(!late.is_exchanged(&render, &render)));
        assert!(!late.is_exchanged(&exchanged, &render));
    }

    #[test]
    fn what_is_as_near_in_both_orders_is_not_told() {
        let told = |frame, render| ColourOrder::default().is_exchanged(&frame, &render);
        assert!(!told(picture([80; 3]), picture([80; 3])), "both are right");
        assert!(!told(picture([90; 3]), picture([20, 90, 150])), "grey");
        assert!(!told(picture([90, 50, 130]), picture([100, 60, 95])), "not much nearer");
    }
}
