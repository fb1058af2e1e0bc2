//! The decoded difference pictures that later frames are predicted from.

use crate::packet::{Latent, Reference};
use crate::{Camera, Picture};

use super::difference::difference_into;
use super::warp::Viewpoint;

/// Frames that are remembered, and so the greatest distance of a reference.
pub const REFERENCES: usize = 32;

/// The last frames of a stream, in memory that is set aside for all of them with the first.
///
/// A reference is what a decoder shows less what it renders: both sides have that in the same bytes. Its *tag* is a
/// check of these bytes, of the camera and of the pose. So a frame of the same number from another stream is not taken
/// for it.
#[derive(Default)]
pub struct References {
    kept: Vec<ReferenceFrame>,
    /// The slot that comes next.
    next: usize,
}

/// A frame that others may be predicted from.
pub struct ReferenceFrame {
    /// Its number, modulo 2²⁴.
    pub frame: u32,
    /// How many frames it came after an intra frame; for encoders.
    pub position: u32,
    /// Check of all else.
    pub tag: u16,
    /// Where it was seen from.
    pub viewpoint: Viewpoint,
    /// What is shown less the render; see [`super::difference()`].
    pub difference: Picture,
    /// What is shown.
    pub shown: Picture,
    /// Whether the slot holds a frame.
    used: bool,
}

impl ReferenceFrame {
    fn size(&self) -> (u32, u32) {
        (self.difference.width, self.difference.height)
    }
}

/// How many frames one frame lies behind another, modulo the numbers that packets state.
pub fn frames_behind(behind: u32, frame: u32) -> u32 {
    frame.wrapping_sub(behind) % Latent::FRAMES
}

impl References {
    pub fn clear(&mut self) {
        self.kept.iter_mut().for_each(|kept| kept.used = false);
    }

    /// Remembers a frame, in place of the oldest, or of one of the same number. The pictures have the camera's size.
    pub fn keep(
        &mut self,
        frame: u32,
        viewpoint: &Viewpoint,
        position: u32,
        shown: &Picture,
        render: &Picture,
    ) {
        self.prepare(viewpoint);
        let same = |kept: &ReferenceFrame| kept.used && frames_behind(kept.frame, frame) == 0;
        let index = self.kept.iter().position(same).unwrap_or_else(|| {
            self.next = (self.next + 1) % REFERENCES;
            self.next
        });
        let kept = &mut self.kept[index];
        (kept.frame, kept.position) = (frame % Latent::FRAMES, position);
        (kept.viewpoint, kept.used) = (*viewpoint, true);
        difference_into(shown, render, &mut kept.difference);
        kept.shown.clone_from(shown);
        kept.tag = tag(viewpoint, &kept.difference);
    }

    /// Makes room for frames of a view. If its camera is another, all frames are forgotten.
    pub fn prepare(&mut self, viewpoint: &Viewpoint) {
        let Camera { width, height, .. } = viewpoint.camera;
        let first = self.kept.first();
        if first.is_some_and(|kept| kept.viewpoint.camera == viewpoint.camera) {
            return;
        }
        if first.is_some_and(|kept| kept.size() == (width, height)) {
            self.clear();
            self.kept.iter_mut().for_each(|kept| kept.viewpoint = *viewpoint);
            return;
        }
        let empty = || {
            let [difference, shown] = [(); 2].map(|()| Picture::new(width, height));
            let (viewpoint, used) = (*viewpoint, false);
            ReferenceFrame { frame: 0, position: 0, tag: 0, viewpoint, difference, shown, used }
        };
        self.kept.clear();
        self.kept.reserve_exact(REFERENCES);
        self.kept.extend(std::iter::repeat_with(empty).take(REFERENCES));
    }

    /// The frame that a packet about `frame`, seen from `viewpoint`, is predicted from, if it is there and the same.
    pub fn find(
        &self,
        reference: Reference,
        frame: u32,
        viewpoint: &Viewpoint,
    ) -> Option<&ReferenceFrame> {
        let distance = u32::from(reference.distance);
        let is = |kept: &&ReferenceFrame| {
            kept.used
                && frames_behind(kept.frame, frame) == distance
                && kept.tag == reference.tag
                && kept.viewpoint.camera == viewpoint.camera
        };
        self.kept.iter().find(is)
    }

    /// The newest frame before `frame` that may be a reference frame and that `suits`, and how to name it.
    pub fn newest(
        &self,
        frame: u32,
        suits: impl Fn(&ReferenceFrame) -> bool,
    ) -> Option<(Reference, &ReferenceFrame)> {
        let near = |kept: &&ReferenceFrame| {
            let behind = frames_behind(kept.frame, frame);
            kept.used && (1..=REFERENCES as u32).contains(&behind) && suits(kept)
        };
        let kept = self.kept.iter().filter(near);
        let newest = kept.min_by_key(|kept| frames_behind(kept.frame, frame))?;
        let distance = frames_behind(newest.frame, frame) as u8;
        Some((Reference { distance, tag: newest.tag }, newest))
    }
}

/// Check of what a reference is.
fn tag(viewpoint: &Viewpoint, difference: &Picture) -> u16 {
    let mut hasher = crc32fast::Hasher::new();
    let Camera { fx, fy, cx, cy, .. } = viewpoint.camera;
    let [w, x, y, z] = viewpoint.placement.rotation;
    let [a, b, c] = viewpoint.placement.translation;
    for value in [fx, fy, cx, cy, w, x, y, z, a, b, c] {
        hasher.update(&value.to_bits().to_le_bytes());
    }
    hasher.update(&difference.data);
    let check = hasher.finalize();
    (check ^ check >> 16) as u16
}

#[cfg(test)]
mod tests {
    use crate::search::Placement;

    use super::*;

    fn viewpoint(x: f32) -> Viewpoint {
        let camera = Camera { width: 8, height: 6, fx: 9.0, fy: 9.0, cx: 4.0, cy: 3.0 };
        let placement = Placement { rotation: [1.0, 0.0, 0.0, 0.0], translation: [x, 0.0, 0.0] };
        Viewpoint { camera, placement }
    }

    fn keep(references: &mut References, frame: u32, shown: u8, render: u8) {
        references.keep(frame, &viewpoint(0.0), 0, &picture(shown), &picture(render));
    }

    fn picture(value: u8) -> Picture {
        let mut picture = Picture::new(8, 6);
        picture.data.fill(value);
        picture
    }

    #[test]
    fn frames_are_found_by_number_and_content() {
        let mut references = References::default();
        assert!(references.newest(5, |_| true).is_none());
        keep(&mut references, 3, 9, 7);
        keep(&mut references, 4, 9, 8);
        let (reference, kept) = references.newest(5, |_| true).expect("two are kept");
        assert_eq!((reference.distance, kept.frame, kept.difference.data[0]), (1, 4, 129));
        let found = references.find(reference, 5, &viewpoint(0.0)).expect("it is kept");
        assert_eq!(found.frame, 4);
        let other = Reference { tag: reference.tag ^ 1, ..reference };
        assert!(references.find(other, 5, &viewpoint(0.0)).is_none(), "another content");
        assert!(references.find(reference, 6, &viewpoint(0.0)).is_none(), "another number");
        let mut elsewhere = viewpoint(0.0);
        elsewhere.camera.fx += 1.0;
        assert!(references.find(reference, 5, &elsewhere).is_none(), "another camera");
        references.clear();
        assert!(references.find(reference, 5, &viewpoint(0.0)).is_none());
    }

    #[test]
    fn the_tag_tells_pose_and_content_apart() {
        let difference = picture(100);
        let tags = [tag(&viewpoint(0.0), &difference), tag(&viewpoint(1.0), &difference)];
        assert_ne!(tags[0], tags[1]);
        assert_ne!(tags[0], tag(&viewpoint(0.0), &picture(101)));
    }

    #[test]
    fn numbers_wrap_and_old_frames_go() {
        let mut references = References::default();
        let last = 0x00FF_FFFF;
        keep(&mut references, last, 1, 0);
        let (reference, _) = references.newest(2, |_| true).expect("three behind");
        assert_eq!(reference.distance, 3);
        // A decoder that joined late knows the low 16 bits alone.
        assert!(references.find(reference, 0x0001_0002, &viewpoint(0.0)).is_some());
        for frame in 0..REFERENCES as u32 {
            keep(&mut references, frame, 1, 0);
        }
        assert!(references.find(reference, 2, &viewpoint(0.0)).is_none(), "its place was taken");
        assert!(references.newest(0, |_| true).is_none(), "later frames are no reference frames");
        assert!(references.newest(500, |_| true).is_none(), "too far");
    }

    #[test]
    fn a_frame_that_comes_twice_takes_one_place() {
        let mut references = References::default();
        for _ in 0..2 * REFERENCES {
            keep(&mut references, 1, 1, 0);
        }
        assert_eq!(references.kept.iter().filter(|kept| kept.used).count(), 1);
    }
}
