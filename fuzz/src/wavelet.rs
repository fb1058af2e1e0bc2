//! Payloads of the wavelet coder: any bytes must give a picture, and the same one each time.
//!
//! The first byte of the input says which picture the payload belongs to, whether the payload was cut short, and
//! whether it has small blocks.

use std::cell::RefCell;

use nvsprior::Picture;
use nvsprior::coder_tables::Tables;
use nvsprior::packet::{Residual, ResidualStart};
use nvsprior::residual::{ResidualDecoder, ResidualError};

/// Sizes of pictures. Small ones, so that inputs take microseconds.
const SIZES: [(u32, u32); 8] =
    [(1, 1), (1, 9), (7, 2), (8, 8), (16, 12), (24, 16), (33, 17), (65, 9)];

thread_local! {
    /// Decoders that have seen all earlier inputs, by size.
    static USED: RefCell<Vec<ResidualDecoder>> =
        RefCell::new(SIZES.iter().map(|size| fresh(*size)).collect());
}

fn fresh((width, height): (u32, u32)) -> ResidualDecoder {
    ResidualDecoder::new(width, height, &Tables::generic())
}

/// A picture with a slope, an edge and texture.
fn render((width, height): (u32, u32)) -> Picture {
    let mut picture = Picture::new(width, height);
    for (at, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (at as u32 / 3 % width, at as u32 / 3 / width);
        let edge = if (x / 9 + y / 7) % 3 == 0 { 60 } else { 0 };
        *value = (40 + 2 * x + y + edge + (x * 7919 + y * 104_729) % 23 + at as u32 % 3) as u8;
    }
    picture
}

pub fn run(input: &[u8]) {
    let Some((&choice, payload)) = input.split_first() else { return };
    let at = usize::from(choice & 7);
    let (start, portable) = (choice & 8 != 0, choice & 16 == 0);
    let render = render(SIZES[at]);
    let small_blocks = choice & 32 != 0;
    let decode = |decoder: &mut ResidualDecoder| {
        let mut shown = render.clone();
        let outcome = match start {
            true => {
                let start = ResidualStart { small_blocks, reference: None, payload };
                decoder.add_start(&start, portable, &mut shown)
            }
            false => decoder.add(&Residual::Coded { small_blocks, payload }, portable, &mut shown),
        };
        (outcome, shown)
    };
    let (outcome, shown) = USED.with_borrow_mut(|used| decode(&mut used[at]));
    match &outcome {
        Ok(()) => {}
        // A payload is refused that looks at another render, or at an earlier frame. Nothing is drawn then.
        Err(ResidualError::OtherRender) => assert!(!portable && shown == render),
        Err(ResidualError::Payload(_)) => assert!(!start && small_blocks && shown == render),
        Err(other) => panic!("{other}"),
    }
    // What was decoded before must not show. A decoder takes long to make, so one input in 256 is compared.
    if crc32fast::hash(input).is_multiple_of(256) {
        assert_eq!(decode(&mut fresh(SIZES[at])), (outcome, shown));
    }
}
