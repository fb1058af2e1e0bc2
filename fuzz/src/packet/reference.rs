//! References made ones that the topside holds. A tag is a check of a picture, which no random bytes match.

use nvsprior::packet::{Reference, Residual};
use nvsprior::residual::{Placement, ResidualDecoder, StreamFrame, Viewpoint, difference};
use nvsprior::{Camera, Picture};

/// Bit of the first byte: the frame that the reference names is held.
pub const HELD: u8 = 1 << 2;

/// The earlier frame's payload.
const EARLIER: &[u8] = b"any bytes are a picture";

/// Forgets earlier frames. Then decodes the frame that a reference names, and names it right, if that is asked for.
pub fn provide(
    choice: u8,
    reference: &mut Reference,
    decoder: &mut ResidualDecoder,
    frame: &StreamFrame,
    render: &Picture,
) {
    forget(decoder, frame, render);
    if choice & HELD == 0 {
        return;
    }
    let Viewpoint { camera, placement } = *frame.viewpoint;
    let [x, y, z] = placement.translation;
    let placement = Placement { translation: [x + 0.05, y, z], ..placement };
    let viewpoint = Viewpoint { camera, placement };
    let number = frame.frame.wrapping_sub(reference.distance.into());
    let earlier = StreamFrame { frame: number, viewpoint: &viewpoint, depths: frame.depths };
    let residual = Residual::Stream { reference: None, small_blocks: false, payload: EARLIER };
    let mut shown = render.clone();
    decoder.add_in_stream(&residual, &earlier, true, &mut shown).expect("any bytes are a picture");
    reference.tag = tag(&viewpoint, &difference(&shown, render));
    assert!(decoder.holds(*reference, frame.frame, frame.viewpoint));
}

/// Frames of another camera are forgotten, even if the new one's cannot be decoded.
fn forget(decoder: &mut ResidualDecoder, frame: &StreamFrame, render: &Picture) {
    let Viewpoint { camera, placement } = *frame.viewpoint;
    let camera = Camera { fx: camera.fx + 1.0, ..camera };
    let viewpoint = Viewpoint { camera, placement };
    let other = StreamFrame { frame: frame.frame, viewpoint: &viewpoint, depths: frame.depths };
    let reference = Some(Reference { distance: 1, tag: 0 });
    let residual = Residual::Stream { reference, small_blocks: false, payload: &[] };
    let outcome = decoder.add_in_stream(&residual, &other, true, &mut render.clone());
    assert!(outcome.is_err(), "nothing of this camera is held");
}

/// The tag of a reference, as `src/packet/mod.rs` defines it.
fn tag(viewpoint: &Viewpoint, difference: &Picture) -> u16 {
    let Camera { fx, fy, cx, cy, .. } = viewpoint.camera;
    let Placement { rotation, translation } = viewpoint.placement;
    let mut hasher = crc32fast::Hasher::new();
    for value in [fx, fy, cx, cy].into_iter().chain(rotation).chain(translation) {
        hasher.update(&value.to_le_bytes());
    }
    hasher.update(&difference.data);
    let check = hasher.finalize();
    (check ^ check >> 16) as u16
}
