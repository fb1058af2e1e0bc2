//! Displaced blocks: what a frame of a stream takes from the picture of an earlier one.

use std::sync::OnceLock;

use nvsprior::coder_tables::Tables;
use nvsprior::packet::Residual;
use nvsprior::residual::{
    Acknowledged, InStream, Placement, Rate, ResidualDecoder, ResidualEncoder, ResidualSetup,
    StreamFrame, Structure, Viewpoint,
};
use nvsprior::{Camera, Picture};
use proptest::prelude::*;

const SIZE: (u32, u32) = (128, 72);
static DEPTHS: [f32; 128 * 72] = [4.0; 128 * 72];
const CHAIN: Structure = Structure::Chain { key_every: 0 };

/// A wall that the camera looks at without moving.
fn render() -> Picture {
    let mut picture = Picture::new(SIZE.0, SIZE.1);
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i as i32 / 3 % SIZE.0 as i32, i as i32 / 3 / SIZE.0 as i32);
        let edge = if (x / 5 + y / 4) % 2 == 0 { 70 } else { 0 };
        *value = (80 + edge + [0, 10, 25][i % 3]) as u8;
    }
    picture
}

/// A fish swims before it: what is seen of it stays the same, some pixels further in each frame.
fn frame(t: i32) -> Picture {
    let mut picture = render();
    for (i, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (i as i32 % SIZE.0 as i32 - 10 - 5 * t, i as i32 / SIZE.0 as i32 - 14 - 2 * t);
        if (0..44).contains(&x) && (0..36).contains(&y) {
            let scales = ((x * 7919 + y * 104_729 + x * y * 31) % 97).abs();
            let stripe = if (x / 6 + y / 9) % 2 == 0 { 90 } else { 20 };
            *rgb.first_chunk_mut().expect("three") =
                [stripe + scales, 60 + scales / 2, stripe / 2].map(|v| v as u8);
        }
    }
    picture
}

fn viewpoint() -> Viewpoint {
    let camera = Camera { width: SIZE.0, height: SIZE.1, fx: 90.0, fy: 90.0, cx: 64.0, cy: 36.0 };
    let placement = Placement { rotation: [1.0, 0.0, 0.0, 0.0], translation: [0.0; 3] };
    Viewpoint { camera, placement }
}

/// A coded frame, and what the encoder says that it shows.
struct Coded {
    residual: Residual<'static>,
    shown: Picture,
    psnr: f64,
}

impl Coded {
    fn len(&self) -> usize {
        let Residual::Stream { payload, .. } = self.residual else { panic!("of no stream") };
        payload.len()
    }

    fn is_inter(&self) -> bool {
        matches!(self.residual, Residual::Stream { reference: Some(_), .. })
    }
}

/// Codes frames as a stream.
fn encode(frames: &[Picture], rate: Rate) -> Vec<Coded> {
    let setup = ResidualSetup::new(SIZE.0, SIZE.1);
    let mut encoder = ResidualEncoder::new(&ResidualSetup { portable: true, ..setup });
    let (viewpoint, render) = (viewpoint(), render());
    let code = |(t, picture): (usize, &Picture)| {
        let frame = StreamFrame { frame: t as u32, viewpoint: &viewpoint, depths: &DEPTHS };
        let acknowledged = &Acknowledged::default();
        let stream = InStream { frame, structure: CHAIN, acknowledged };
        let coded = encoder.encode_in_stream(picture, &render, rate, 0, &stream).unwrap();
        let Residual::Stream { reference, small_blocks, payload } = coded.residual else {
            panic!("{:?}", coded.residual)
        };
        let payload: &'static [u8] = payload.to_vec().leak();
        let (shown, psnr) = (coded.reconstruction.clone(), coded.psnr);
        let residual = Residual::Stream { reference, small_blocks, payload };
        encoder.keep(&frame, &render);
        Coded { residual, shown, psnr }
    };
    frames.iter().enumerate().map(code).collect()
}

fn frames() -> Vec<Picture> {
    (0..6).map(frame).collect()
}

fn decoder() -> ResidualDecoder {
    ResidualDecoder::new(SIZE.0, SIZE.1, &Tables::generic())
}

fn decode(decoder: &mut ResidualDecoder, t: usize, residual: &Residual) -> Picture {
    let viewpoint = viewpoint();
    let frame = StreamFrame { frame: t as u32, viewpoint: &viewpoint, depths: &DEPTHS };
    let mut shown = render();
    decoder.add_in_stream(residual, &frame, true, &mut shown).unwrap();
    shown
}

#[test]
fn what_moves_takes_fewer_bytes() {
    for target in [28.0, 31.0, 34.0] {
        let all = encode(&frames(), Rate::Psnr(target));
        assert!(all.iter().all(|coded| coded.psnr >= target) && all.iter().any(Coded::is_inter));
        let with = all[1..].iter().map(Coded::len).sum::<usize>();
        let setup = ResidualSetup::new(SIZE.0, SIZE.1);
        let mut encoder = ResidualEncoder::new(&setup);
        let render = render();
        let mut intra = |picture: &Picture| {
            let coded = encoder.encode(picture, &render, Rate::Psnr(target), 0).unwrap();
            coded.residual.payload().len()
        };
        let all = frames();
        let without: usize = all[1..].iter().map(&mut intra).sum();
        // Intra frames have small blocks, too: at few bytes they say nearly as much.
        let of = if target < 30.0 { 19 } else { 17 };
        assert!(with * 20 < without * of, "{target} dB: {with} bytes, {without} intra");
    }
}

#[test]
fn both_sides_show_the_same() {
    for rate in [Rate::Quality(10.0), Rate::Quality(80.0), Rate::Bytes(200), Rate::Psnr(31.0)] {
        let mut decoder = decoder();
        for (t, coded) in encode(&frames(), rate).iter().enumerate() {
            let shown = decode(&mut decoder, t, &coded.residual);
            assert!(shown == coded.shown, "{rate:?} frame {t}");
        }
    }
}

/// Light that changes all over, and nothing that moves: blocks say nothing.
#[test]
fn where_nothing_moves_payloads_are_as_without() {
    let lit = |t: i32| {
        let mut picture = render();
        for (i, value) in picture.data.iter_mut().enumerate() {
            let x = i as i32 / 3 % SIZE.0 as i32;
            *value = (i32::from(*value) - 10 - x / 8 - t).clamp(0, 255) as u8;
        }
        picture
    };
    let frames: Vec<_> = (0..5).map(lit).collect();
    let all = encode(&frames, Rate::Quality(60.0));
    assert!(all[1..].iter().any(Coded::is_inter));
    let is_plain =
        |coded: &Coded| matches!(coded.residual, Residual::Stream { small_blocks: false, .. });
    assert!(all.iter().all(is_plain));
}

/// Check sums of payloads and pictures are the same on every processor.
#[test]
fn payloads_are_the_same_on_every_processor() {
    let made = [Rate::Quality(30.0), Rate::Psnr(33.0)].map(|rate| {
        let (mut payloads, mut pictures) = (crc32fast::Hasher::new(), crc32fast::Hasher::new());
        for coded in encode(&frames(), rate) {
            let Residual::Stream { payload, .. } = coded.residual else { panic!() };
            payloads.update(payload);
            pictures.update(&coded.shown.data);
        }
        (payloads.finalize(), pictures.finalize())
    });
    assert_eq!(made, GOLDEN);
}

/// Check sums of the payloads and of the pictures.
const GOLDEN: [(u32, u32); 2] = [(639_948_254, 856_580_113), (4_163_372_025, 2_116_495_546)];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn any_flipped_bits_give_a_picture(at in any::<prop::sample::Index>(), mask in 1_u8..) {
        static ALL: OnceLock<Vec<Coded>> = OnceLock::new();
        let all = ALL.get_or_init(|| encode(&frames()[..2], Rate::Quality(20.0)));
        let mut decoder = decoder();
        decode(&mut decoder, 0, &all[0].residual);
        let Residual::Stream { reference, small_blocks, payload } = all[1].residual else {
            panic!()
        };
        prop_assert!(small_blocks && reference.is_some());
        let mut payload = payload.to_vec();
        let at = at.index(payload.len());
        payload[at] ^= mask;
        decode(&mut decoder, 1, &Residual::Stream { reference, small_blocks, payload: &payload });
    }
}
