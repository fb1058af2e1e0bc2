//! The wavelet coder with small blocks: what is predicted from the render is chosen block by block.

use nvsprior::Picture;
use nvsprior::coder_tables::Tables;
use nvsprior::packet::{Residual, ResidualStart};
use nvsprior::residual::{Rate, ResidualDecoder, ResidualEncoder, ResidualError, ResidualSetup};
use proptest::prelude::*;

const SIZE: (u32, u32) = (128, 72);

/// A textured wall.
fn wall(light: i32) -> Picture {
    let mut picture = Picture::new(SIZE.0, SIZE.1);
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i as i32 / 3 % SIZE.0 as i32, i as i32 / 3 / SIZE.0 as i32);
        let texture = (x * 7919 + y * 104_729) % 37 - 18;
        let edge = if (x / 5 + y / 4) % 2 == 0 { 70 } else { 0 };
        *value = ((60 + texture + edge + [0, 10, 25][i % 3]) * light / 100).clamp(0, 255) as u8;
    }
    picture
}

/// The wall as it is seen, with a smooth object in front of it, and its render.
fn pair() -> (Picture, Picture) {
    let mut frame = wall(97);
    for (i, rgb) in frame.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (i % SIZE.0 as usize, i / SIZE.0 as usize);
        if (40..76).contains(&x) && (20..52).contains(&y) {
            rgb.copy_from_slice(&[180, 40 + x as u8 / 4, 30]);
        }
    }
    (frame, wall(100))
}

fn encoder(portable: bool) -> ResidualEncoder {
    let setup = ResidualSetup::new(SIZE.0, SIZE.1);
    ResidualEncoder::new(&ResidualSetup { portable, ..setup })
}

fn decoder() -> ResidualDecoder {
    ResidualDecoder::new(SIZE.0, SIZE.1, &Tables::generic())
}

fn coded(payload: &[u8]) -> Residual<'_> {
    Residual::Coded { small_blocks: true, payload }
}

/// A payload with small blocks, and what the encoder says that it shows.
fn small(pair: &(Picture, Picture), rate: Rate, portable: bool) -> (Vec<u8>, Picture) {
    let mut encoder = encoder(portable);
    let coded = encoder.encode(&pair.0, &pair.1, rate, 0).unwrap();
    match coded.residual {
        Residual::Coded { small_blocks: true, payload } => {
            (payload.to_vec(), coded.reconstruction.clone())
        }
        other => panic!("{other:?}"),
    }
}

fn decode(payload: &[u8], render: &Picture) -> Picture {
    let mut shown = render.clone();
    decoder().add(&coded(payload), true, &mut shown).expect("any payload gives a picture");
    shown
}

/// Checks that a payload gives a picture, unless it says that blocks are displaced: there is no earlier frame.
fn check_any(payload: &[u8], render: &Picture) {
    let mut shown = render.clone();
    match decoder().add(&coded(payload), true, &mut shown) {
        Ok(()) => {}
        Err(ResidualError::Payload(_)) => assert!(shown == *render),
        Err(other) => panic!("{other:?}"),
    }
}

/// A scene as it was mapped pays nothing: its payloads have no small blocks.
#[test]
fn where_nothing_is_new_there_are_no_small_blocks() {
    let (frame, render) = (wall(92), wall(100));
    for rate in [Rate::Quality(10.0), Rate::Quality(60.0), Rate::Bytes(200), Rate::Psnr(35.0)] {
        let mut encoder = encoder(true);
        let coded = encoder.encode(&frame, &render, rate, 0).unwrap();
        let plain = matches!(coded.residual, Residual::Coded { small_blocks: false, .. });
        assert!(plain, "{rate:?}: {:?}", coded.residual);
    }
}

#[test]
fn the_decoder_shows_what_the_encoder_says() {
    let pair = pair();
    let rates = [
        Rate::Quality(0.0),
        Rate::Quality(100.0),
        Rate::Bytes(400),
        Rate::Bytes(90),
        Rate::Psnr(30.0),
    ];
    for rate in rates {
        for portable in [true, false] {
            let (payload, shown) = small(&pair, rate, portable);
            assert!(decode(&payload, &pair.1) == shown, "{rate:?} {portable}");
        }
    }
}

#[test]
fn a_payload_cut_at_any_byte_gives_a_picture_that_grows_finer() {
    let pair = pair();
    let (frame, render) = &pair;
    let (payload, _) = small(&pair, Rate::Quality(30.0), true);
    let mut decoder = decoder();
    let mut best = frame.psnr(render);
    for len in 0..payload.len() {
        let start = ResidualStart { reference: None, small_blocks: true, payload: &payload[..len] };
        let mut shown = render.clone();
        assert_eq!(decoder.add_start(&start, true, &mut shown), Ok(()));
        let psnr = frame.psnr(&shown);
        // The first bytes take the wrong details away; what stands there comes after.
        assert!(psnr > best - 1.5, "{len} of {} bytes: {psnr} after {best}", payload.len());
        best = best.max(psnr);
    }
    assert!(frame.psnr(&decode(&payload, render)) > best - 0.1);
}

#[test]
fn another_render_is_refused_if_it_is_looked_at() {
    let pair = pair();
    let (seen, _) = small(&pair, Rate::Quality(30.0), true);
    let mut shown = pair.1.clone();
    let refused = decoder().add(&coded(&seen), false, &mut shown);
    assert_eq!(refused, Err(ResidualError::OtherRender));
    assert!(shown == pair.1);
    let (blind, _) = small(&pair, Rate::Quality(30.0), false);
    assert_eq!(decoder().add(&coded(&blind), false, &mut shown), Ok(()));
}

/// Check sums of payload and picture are the same on every processor.
#[test]
fn payloads_and_pictures_are_the_same_on_every_processor() {
    let pair = pair();
    let rates = [
        (Rate::Quality(10.0), true),
        (Rate::Quality(70.0), true),
        (Rate::Quality(40.0), false),
        (Rate::Bytes(150), true),
        (Rate::Psnr(31.0), true),
    ];
    let made = rates.map(|(rate, portable)| {
        let (payload, _) = small(&pair, rate, portable);
        let crc = |bytes: &[u8]| crc32fast::hash(bytes);
        (payload.len(), crc(&payload), crc(&decode(&payload, &pair.1).data))
    });
    assert_eq!(made, GOLDEN);
}

/// Length of the payload, its check sum, the picture's.
const GOLDEN: [(usize, u32, u32); 5] = [
    (201, 1_156_878_862, 1_692_545_437),
    (1486, 2_017_510_816, 632_788_937),
    (526, 2_823_269_522, 1_914_928_106),
    (143, 3_873_079_113, 1_511_480_107),
    (96, 4_179_062_706, 2_763_986_830),
];

proptest! {
    #[test]
    fn any_bytes_give_a_picture(bytes in proptest::collection::vec(any::<u8>(), 0..200), cut: bool) {
        let (_, render) = pair();
        let mut shown = render.clone();
        if cut {
            let start = ResidualStart {
                small_blocks: true,
                reference: None,
                payload: &bytes,
            };
            prop_assert!(decoder().add_start(&start, true, &mut shown).is_ok());
        } else {
            check_any(&bytes, &render);
        }
    }

    #[test]
    fn any_flipped_bits_give_a_picture(at in any::<prop::sample::Index>(), mask in 1_u8..) {
        let pair = pair();
        let (mut payload, _) = small(&pair, Rate::Quality(10.0), true);
        let at = at.index(payload.len());
        payload[at] ^= mask;
        check_any(&payload, &pair.1);
    }

    #[test]
    fn pictures_of_any_size_come_back(
        width in 1_u32..40,
        height in 1_u32..40,
        seed: u8,
        quality in 0.0_f32..100.0,
    ) {
        let picture = |add: usize| {
            let mut picture = Picture::new(width, height);
            let value = |i: usize| (i * (7 + 31 * add) + usize::from(seed)) % 251;
            picture.data.iter_mut().enumerate().for_each(|(i, to)| *to = value(i) as u8);
            picture
        };
        let (frame, render) = (picture(0), picture(1));
        let setup = ResidualSetup::new(width, height);
        let mut encoder = ResidualEncoder::new(&setup);
        let coded = encoder.encode(&frame, &render, Rate::Quality(quality), 0).unwrap();
        let mut shown = render.clone();
        let mut decoder = ResidualDecoder::new(width, height, &setup.tables);
        decoder.add(&coded.residual, true, &mut shown).unwrap();
        prop_assert!(shown == *coded.reconstruction);
    }
}
