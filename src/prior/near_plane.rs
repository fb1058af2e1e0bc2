//! The near plane of a scene whose file does not state one.

/// Spread of a scene below which the usual near plane would cut what its cameras see. See
/// [`CoordinateFrame::spread`](super::CoordinateFrame::spread).
const SMALL: f32 = 0.5;
/// The near plane of a smaller scene, as a part of its spread. A power of two: nothing is rounded.
const PART: f32 = 1.0 / 16.0;

/// The near plane of a scene of this spread: `usual`, unless the scene is small. It is never above `usual`.
///
/// Trainers that scale a scene into a unit cube draw what is nearer than 0.2; whoever saves such a scene in another
/// program's format loses the note that says so.
pub fn near_plane(usual: f32, spread: f32) -> f32 {
    if spread < SMALL { usual.min((spread * PART).max(f32::MIN_POSITIVE)) } else { usual }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_scenes_alone_have_a_nearer_plane() {
        for spread in [0.5, 1.6, 8.3, 1e6, f32::MAX] {
            assert_eq!(near_plane(0.2, spread), 0.2, "{spread}");
        }
        assert_eq!(near_plane(0.2, 0.25), 0.015_625);
        assert_eq!(near_plane(0.01, 0.25), 0.01, "never above the usual one");
        assert!(near_plane(0.2, f32::MIN_POSITIVE) > 0.0);
    }
}
