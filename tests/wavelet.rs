//! The wavelet coder through the library's interface: any bytes must give a picture or an error.

use std::sync::{Arc, OnceLock};

use nvsprior::coder_tables::Tables;
use nvsprior::packet::{Reference, Residual, ResidualStart};
use nvsprior::residual::{
    Acknowledged, InStream, Interest, Placement, Rate, ResidualDecoder, ResidualEncoder,
    ResidualError, ResidualSetup, StreamFrame, Structure, Tune, Viewpoint,
};
use nvsprior::{Camera, Picture};
use proptest::prelude::*;

const SIZE: (u32, u32) = (96, 54);

/// A picture of shapes and texture, the same on every machine; `light` in percent.
fn shapes(width: u32, height: u32, light: i32, shift: i32) -> Picture {
    let mut picture = Picture::new(width, height);
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i as i32 / 3 % width as i32 + shift, i as i32 / 3 / width as i32);
        let texture = (x * 7919 + y * 104_729) % 23 - 11;
        let edge = if (x / 9 + y / 7) % 3 == 0 { 60 } else { 0 };
        let slope = x + y / 2 + [0, 15, 30][i % 3];
        *value = ((40 + texture + edge + slope) * light / 100).clamp(0, 255) as u8;
    }
    picture
}

fn pair() -> (Picture, Picture) {
    (shapes(SIZE.0, SIZE.1, 80, 0), shapes(SIZE.0, SIZE.1, 100, 1))
}

fn encoder(portable: bool) -> ResidualEncoder {
    let setup = ResidualSetup::new(SIZE.0, SIZE.1);
    ResidualEncoder::new(&ResidualSetup { portable, ..setup })
}

fn stream(reference: Option<Reference>, payload: &[u8]) -> Residual<'_> {
    Residual::Stream { reference, small_blocks: false, payload }
}

/// A coded difference picture.
#[derive(Clone)]
struct Coded {
    small_blocks: bool,
    payload: Vec<u8>,
}

impl Coded {
    /// Bytes that somebody made up.
    fn any(payload: &[u8]) -> Coded {
        Coded { small_blocks: false, payload: payload.to_vec() }
    }

    fn of(residual: &Residual) -> Coded {
        match residual {
            Residual::Coded { small_blocks, payload } => {
                Coded { small_blocks: *small_blocks, payload: payload.to_vec() }
            }
            other => panic!("{other:?}"),
        }
    }

    fn residual(&self) -> Residual<'_> {
        Residual::Coded { small_blocks: self.small_blocks, payload: &self.payload }
    }

    fn len(&self) -> usize {
        self.payload.len()
    }
}

fn coded(frame: &Picture, render: &Picture, rate: Rate, portable: bool) -> Coded {
    let mut encoder = encoder(portable);
    Coded::of(&encoder.encode(frame, render, rate, 0).expect("pictures of the size").residual)
}

fn decoder() -> ResidualDecoder {
    static TABLES: OnceLock<Tables> = OnceLock::new();
    ResidualDecoder::new(SIZE.0, SIZE.1, TABLES.get_or_init(Tables::generic))
}

fn decode(coded: &Coded, render: &Picture) -> Picture {
    let mut shown = render.clone();
    decoder().add(&coded.residual(), true, &mut shown).expect("any payload gives a picture");
    shown
}

#[test]
fn a_payload_cut_at_any_byte_gives_a_picture_that_grows_finer() {
    let (frame, render) = pair();
    let coded = coded(&frame, &render, Rate::Quality(50.0), true);
    let Coded { small_blocks, payload } = &coded;
    let mut decoder = decoder();
    let mut best = frame.psnr(&render);
    let last = frame.psnr(&decode(&coded, &render));
    for len in 0..payload.len() {
        let (small_blocks, payload) = (*small_blocks, &payload[..len]);
        let start = ResidualStart { reference: None, small_blocks, payload };
        let mut shown = render.clone();
        assert_eq!(decoder.add_start(&start, true, &mut shown), Ok(()));
        let psnr = frame.psnr(&shown);
        assert!(psnr > best - 0.5, "{len} of {} bytes: {psnr} after {best}", coded.len());
        best = best.max(psnr);
    }
    assert!(last > best - 0.1 && last > frame.psnr(&render) + 6.0);
}

#[test]
fn a_region_of_interest_gets_more_of_the_bits() {
    let (frame, render) = pair();
    let (x, y) = (24..56, 10..34);
    let errors = |interest: Option<&Arc<Interest>>| -> [f64; 2] {
        // A new one each time: a search begins where the last one ended.
        let mut encoder = encoder(true);
        encoder.set_interest(interest);
        let coded = encoder.encode(&frame, &render, Rate::Bytes(300), 0).unwrap();
        let own = Coded::of(&coded.residual);
        assert!((270..=298).contains(&own.len()), "{} bytes", own.len());
        assert_eq!(&decode(&own, &render), coded.reconstruction);
        let mut errors = [0.0; 2];
        let pixels = frame.data.chunks_exact(3).zip(coded.reconstruction.data.chunks_exact(3));
        for (at, (frame, shown)) in (0..).zip(pixels) {
            let inside = x.contains(&(at % SIZE.0)) && y.contains(&(at / SIZE.0));
            let off = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
            errors[usize::from(!inside)] += frame.iter().zip(shown).map(off).sum::<f64>();
        }
        errors
    };
    let plain = errors(None);
    let mut last = plain;
    for weight in [4, 16] {
        let interest = Interest::rectangle(SIZE, x.clone(), y.clone(), weight).unwrap();
        let of_interest = errors(Some(&Arc::new(interest)));
        assert!(of_interest[0] < 0.9 * last[0], "{weight}: {of_interest:?} {last:?}");
        assert!(of_interest[1] > last[1], "{weight}: {of_interest:?} {last:?}");
        last = of_interest;
    }
    // The same everywhere is as none at all.
    let even = Interest::map(2, 2, &[7; 4]).unwrap();
    assert_eq!(errors(Some(&Arc::new(even))), plain);
    assert_eq!(errors(None), plain);
}

#[test]
fn an_encoder_is_tuned_to_what_is_new() {
    let (frame, render) = pair();
    // Squared errors of two parts: the tenth of the pixels whose render is farthest from the frame, and the rest.
    let off = |a: &Picture, b: &Picture| -> Vec<f64> {
        let pixels = a.data.chunks_exact(3).zip(b.data.chunks_exact(3));
        let square = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
        pixels.map(|(a, b)| a.iter().zip(b).map(square).sum()).collect()
    };
    let far = off(&frame, &render);
    let mut sorted = far.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = sorted[sorted.len() * 9 / 10];
    let errors = |tune: Tune| -> [f64; 2] {
        let setup = ResidualSetup { tune, ..ResidualSetup::new(SIZE.0, SIZE.1) };
        let mut encoder = ResidualEncoder::new(&setup);
        let mut errors = [0.0; 2];
        // One budget is used by a few per cent more or less.
        for budget in (120..200).step_by(8) {
            let coded = encoder.encode(&frame, &render, Rate::Bytes(budget), 0).unwrap();
            assert_eq!(&decode(&Coded::of(&coded.residual), &render), coded.reconstruction);
            for (far, off) in far.iter().zip(off(&frame, coded.reconstruction)) {
                errors[usize::from(*far < limit)] += off;
            }
        }
        errors
    };
    let [plain, detection] = [errors(Tune::Psnr), errors(Tune::Detection)];
    assert!(detection[0] < plain[0], "{detection:?} {plain:?}");
}

#[test]
fn any_flipped_bit_gives_a_picture() {
    let (frame, render) = pair();
    let whole = coded(&frame, &render, Rate::Bytes(80), true);
    for bit in 0..8 * whole.len() {
        let mut damaged = whole.clone();
        damaged.payload[bit / 8] ^= 1 << (bit % 8);
        decode(&damaged, &render);
    }
}

#[test]
fn without_the_same_render_a_payload_is_refused_unless_it_looks_at_none() {
    let (frame, render) = pair();
    let rate = Rate::Quality(30.0);
    let seen = coded(&frame, &render, rate, true);
    let mut shown = render.clone();
    let refused = decoder().add(&seen.residual(), false, &mut shown);
    assert_eq!((refused, &shown), (Err(ResidualError::OtherRender), &render));

    let blind = coded(&frame, &render, rate, false);
    let mut other = render.clone();
    other.data.iter_mut().step_by(5).for_each(|value| *value = value.saturating_add(1));
    let mut shown_there = other.clone();
    decoder().add(&blind.residual(), false, &mut shown).expect("it looks at no render");
    decoder().add(&blind.residual(), false, &mut shown_there).expect("it looks at no render");
    let furthest =
        std::iter::zip(&shown.data, &shown_there.data).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(furthest <= Some(2), "{furthest:?} levels for one of the render");
    assert!(blind.len() < seen.len() * 3 / 2, "{} and {} bytes", blind.len(), seen.len());
}

#[test]
fn a_render_of_no_use_costs_little_more_than_none() {
    let (frame, _) = pair();
    let mut grey = frame.clone();
    grey.data.fill(128);
    // A picture of the same kind, but shifted.
    let astray = shapes(SIZE.0, SIZE.1, 100, 61);
    for target in [26.0, 30.0, 36.0] {
        let plain = coded(&frame, &grey, Rate::Psnr(target), true).len();
        let beside = coded(&frame, &astray, Rate::Psnr(target), true).len();
        assert!(beside <= plain + plain / 20 + 8, "{target} dB: {beside} bytes, plain {plain}");
    }
}

#[test]
fn noise_stays_within_the_longest_payload() {
    let mut noise = Picture::new(SIZE.0, SIZE.1);
    let mut other = noise.clone();
    let mut state = 1u32;
    for value in noise.data.iter_mut().chain(&mut other.data) {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = (state >> 24) as u8;
    }
    let longest = nvsprior::residual::max_payload_len(SIZE.0, SIZE.1);
    for rate in [Rate::Quality(100.0), Rate::Psnr(50.0), Rate::Bytes(1 << 20)] {
        let coded = coded(&noise, &other, rate, true);
        assert!(coded.len() <= longest, "{rate:?}: {} bytes", coded.len());
        assert!(noise.psnr(&decode(&coded, &other)) > 25.0);
    }
}

#[test]
fn pictures_of_all_sizes_come_back() {
    for (width, height) in [(1, 1), (1, 9), (7, 2), (5, 5), (33, 17), (64, 200)] {
        let (frame, render) = (shapes(width, height, 90, 3), shapes(width, height, 100, 0));
        let setup = ResidualSetup::new(width, height);
        let mut encoder = ResidualEncoder::new(&setup);
        let mut decoder = ResidualDecoder::new(width, height, &setup.tables);
        for quality in [0.0, 50.0, 100.0] {
            let coded = encoder.encode(&frame, &render, Rate::Quality(quality), 0).unwrap();
            let mut shown = render.clone();
            decoder.add(&coded.residual, true, &mut shown).unwrap();
            assert!(shown == *coded.reconstruction, "{width}×{height}");
            assert!(quality < 100.0 || coded.psnr > 45.0, "{width}×{height}: {}", coded.psnr);
        }
    }
}

#[test]
fn the_extremes_of_8_bits_come_back() {
    let mut black = Picture::new(SIZE.0, SIZE.1);
    let mut white = black.clone();
    white.data.fill(255);
    for (i, value) in black.data.iter_mut().enumerate() {
        *value = if (i / 3 + i / 288) % 2 == 0 { 255 } else { 0 };
    }
    let mut inverse = black.clone();
    inverse.data.iter_mut().for_each(|value| *value = 255 - *value);
    for (frame, render) in [(&black, &white), (&white, &black), (&black, &inverse)] {
        let coded = coded(frame, render, Rate::Quality(100.0), true);
        assert!(frame.psnr(&decode(&coded, render)) > 45.0);
    }
}

/// Check sums of payload and picture are the same on every processor. Only a change of the coder or its tables changes
/// them; the last two also change with the search for a rate.
#[test]
fn payloads_and_pictures_are_the_same_on_every_processor() {
    let (frame, render) = pair();
    let crc = |bytes: &[u8]| crc32fast::hash(bytes);
    let made = [
        (Rate::Quality(20.0), true),
        (Rate::Quality(90.0), true),
        (Rate::Quality(60.0), false),
        (Rate::Bytes(120), true),
        (Rate::Psnr(33.0), true),
    ]
    .map(|(rate, portable)| {
        let coded = coded(&frame, &render, rate, portable);
        (coded.len(), crc(&coded.payload), crc(&decode(&coded, &render).data))
    });
    assert_eq!(made, GOLDEN);
}

/// Length of the payload, its check sum, the picture's.
const GOLDEN: [(usize, u32, u32); 5] = [
    (458, 2_985_759_029, 2_562_195_432),
    (3892, 1_784_045_600, 799_008_107),
    (2281, 2_658_136_577, 4_073_536_850),
    (114, 3_494_602_977, 2_087_372_190),
    (752, 1_702_346_584, 731_170_358),
];

/// Where the frames of a slow pan are seen from.
fn viewpoint(frame: u32) -> Viewpoint {
    let camera = Camera { width: SIZE.0, height: SIZE.1, fx: 80.0, fy: 80.0, cx: 48.0, cy: 27.0 };
    let placement =
        Placement { rotation: [1.0, 0.0, 0.0, 0.0], translation: [frame as f32 * -0.1, 0.0, 0.0] };
    Viewpoint { camera, placement }
}

/// A wall that slants: nearer on the right.
fn depths() -> Vec<f32> {
    let columns = SIZE.0 as usize;
    (0..columns * SIZE.1 as usize).map(|i| 5.0 - (i % columns) as f32 / 64.0).collect()
}

/// A frame and its render: the same light on both, and a patch that moves with the scene.
fn panned(frame: u32) -> (Picture, Picture) {
    let shift = 2 * frame as i32;
    let mut frame = shapes(SIZE.0, SIZE.1, 80, shift);
    for (i, rgb) in frame.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (i as i32 % SIZE.0 as i32 + shift, i as i32 / SIZE.0 as i32);
        if (30..60).contains(&x) && (10..30).contains(&y) {
            rgb.copy_from_slice(&[200, (3 * x) as u8, (5 * y) as u8]);
        }
    }
    (frame, shapes(SIZE.0, SIZE.1, 100, shift))
}

/// Check sums of a stream's payloads and pictures are the same on every processor, and the decoder shows what the
/// encoder says.
#[test]
fn streams_are_the_same_on_every_processor() {
    let (depths, mut encoder, mut decoder) = (depths(), encoder(true), decoder());
    let acknowledged = Acknowledged::default();
    let rates = [
        Rate::Quality(40.0),
        Rate::Quality(40.0),
        Rate::Bytes(300),
        Rate::Psnr(33.0),
        Rate::Quality(70.0),
    ];
    let made: Vec<_> = rates
        .into_iter()
        .enumerate()
        .map(|(i, rate)| {
            let number = i as u32;
            let (seen, render) = panned(number);
            let viewpoint = viewpoint(number);
            let frame = StreamFrame { frame: number, viewpoint: &viewpoint, depths: &depths };
            let structure = Structure::Chain { key_every: 0 };
            let stream = InStream { frame, structure, acknowledged: &acknowledged };
            let coded = encoder.encode_in_stream(&seen, &render, rate, 0, &stream).unwrap();
            let Residual::Stream { reference, payload, .. } = coded.residual else {
                panic!("{coded:?}")
            };
            let mut shown = render.clone();
            decoder.add_in_stream(&coded.residual, &frame, true, &mut shown).unwrap();
            assert!(shown == *coded.reconstruction, "frame {number}");
            let distance = reference.map_or(0, |reference| reference.distance);
            let tag = reference.map_or(0, |reference| reference.tag);
            let made = (
                distance,
                tag,
                payload.len(),
                crc32fast::hash(payload),
                crc32fast::hash(&shown.data),
            );
            encoder.keep(&frame, &render);
            made
        })
        .collect();
    assert_eq!(made, GOLDEN_STREAM);
}

/// Distance and tag of the reference, length of the payload, its check sum, the picture's.
const GOLDEN_STREAM: [(u8, u16, usize, u32, u32); 5] = [
    (0, 0, 469, 1_945_113_111, 3_433_452_827),
    (1, 15_162, 48, 3_213_025_058, 55_869_646),
    (1, 14_209, 285, 4_186_457_406, 1_885_330_296),
    (1, 31_881, 10, 2_098_866_802, 2_245_984_659),
    (1, 61_590, 630, 2_156_703_268, 1_901_140_088),
];

/// A decoder that holds frame 0 of a stream, and how later ones name it.
fn decoder_in_stream() -> (ResidualDecoder, Reference) {
    let (mut encoder, mut decoder) = (encoder(true), decoder());
    let (depths, viewpoint, acknowledged) = (depths(), viewpoint(0), Acknowledged::default());
    let mut frame = StreamFrame { frame: 0, viewpoint: &viewpoint, depths: &depths };
    let structure = Structure::Chain { key_every: 0 };
    let (seen, render) = panned(0);
    for number in 0..2 {
        frame.frame = number;
        let stream = InStream { frame, structure, acknowledged: &acknowledged };
        let rate = Rate::Quality(40.0);
        let coded = encoder.encode_in_stream(&seen, &render, rate, 0, &stream).unwrap();
        let Residual::Stream { reference, .. } = coded.residual else { panic!("{coded:?}") };
        if let Some(reference) = reference {
            return (decoder, reference);
        }
        decoder.add_in_stream(&coded.residual, &frame, true, &mut render.clone()).unwrap();
        encoder.keep(&frame, &render);
    }
    panic!("the same frame again is predicted from the first")
}

#[test]
fn a_reference_must_be_there_and_the_same() {
    let (mut decoder, reference) = decoder_in_stream();
    let (depths, viewpoint, (_, render)) = (depths(), viewpoint(1), panned(1));
    let frame = StreamFrame { frame: 1, viewpoint: &viewpoint, depths: &depths };
    let mut shown = render.clone();
    assert!(decoder.holds(reference, 1, &viewpoint));
    let missing = ResidualError::ReferenceMissing { frame: 1, reference: 0 };
    let other = Reference { tag: !reference.tag, ..reference };
    let found = decoder.add_in_stream(&stream(Some(other), &[1, 2, 3]), &frame, true, &mut shown);
    assert_eq!(found, Err(missing));
    let far = Reference { distance: 5, ..reference };
    let found = decoder.add_in_stream(&stream(Some(far), &[1, 2, 3]), &frame, true, &mut shown);
    // Frame numbers go back beyond zero.
    assert_eq!(found, Err(ResidualError::ReferenceMissing { frame: 1, reference: u32::MAX - 3 }));
    // A device that is not portable cannot know what a frame is predicted from.
    let found =
        decoder.add_in_stream(&stream(Some(reference), &[1, 2, 3]), &frame, false, &mut shown);
    assert_eq!(found, Err(ResidualError::OtherRender));
    let few = StreamFrame { depths: &depths[1..], ..frame };
    let found = decoder.add_in_stream(&stream(Some(reference), &[1, 2, 3]), &few, true, &mut shown);
    assert_eq!(
        found,
        Err(ResidualError::Depths { expected: depths.len(), found: depths.len() - 1 })
    );
    assert!(decoder.add(&stream(Some(reference), &[1, 2, 3]), true, &mut shown).is_err());
    assert!(shown == render, "nothing changes on an error");
    assert!(
        decoder
            .add_in_stream(&stream(Some(reference), &[1, 2, 3]), &frame, true, &mut shown)
            .is_ok()
    );
}

proptest! {
    #[test]
    fn any_bytes_in_a_stream_give_a_picture(
        payloads in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..120), 1..4),
        distance in 1u8..4,
        cut: bool,
        odd in 0usize..4,
    ) {
        let (mut decoder, reference) = decoder_in_stream();
        let mut depths = depths();
        depths[odd * 100] = [f32::NAN, f32::INFINITY, -1.0, 0.0][odd];
        for (i, payload) in payloads.iter().enumerate() {
            let viewpoint = viewpoint(i as u32 + 1);
            let frame = StreamFrame { frame: u32::from(distance), viewpoint: &viewpoint, depths: &depths };
            let reference = Some(Reference { distance, ..reference });
            let (_, mut shown) = panned(1);
            if cut {
                let start =
                    ResidualStart { small_blocks: false, reference, payload };
                prop_assert!(decoder.add_start_in_stream(&start, &frame, true, &mut shown).is_ok());
            } else {
                prop_assert!(decoder.add_in_stream(&stream(reference, payload), &frame, true, &mut shown).is_ok());
            }
        }
    }

    #[test]
    fn any_bytes_give_a_picture(bytes in proptest::collection::vec(any::<u8>(), 0..200), cut: bool) {
        let (_, render) = pair();
        let mut shown = render.clone();
        if cut {
            let start =
                ResidualStart { small_blocks: false, reference: None, payload: &bytes };
            prop_assert!(decoder().add_start(&start, true, &mut shown).is_ok());
        } else {
            decode(&Coded::any(&bytes), &render);
        }
    }

    /// Tables come with a prior's file, and that may hold any.
    #[test]
    fn any_tables_give_a_picture(
        weights in proptest::collection::vec(any::<u8>(), Tables::encoded_len()),
        bytes in proptest::collection::vec(any::<u8>(), 0..200),
        extreme: bool,
        quality in 0.0..100.0_f32,
    ) {
        let (frame, render) = pair();
        let body = &weights[4..];
        // Weights of the greatest magnitudes, or any.
        let max = |b: &u8| if b & 1 == 0 { i16::MIN } else { i16::MAX };
        let body: Vec<u8> = match extreme {
            true => body.iter().flat_map(|b| max(b).to_le_bytes()).take(body.len()).collect(),
            false => body.to_vec(),
        };
        let tables = Tables::read(&[b"NVT1", &body[..]].concat()).expect("tables of any numbers");
        let mut setup = ResidualSetup::new(SIZE.0, SIZE.1);
        setup.tables = Arc::new(tables);
        let mut encoder = ResidualEncoder::new(&setup);
        let mut decoder = ResidualDecoder::new(SIZE.0, SIZE.1, &setup.tables);
        let coded = encoder.encode(&frame, &render, Rate::Quality(quality), 0).unwrap();
        let mut shown = render.clone();
        decoder.add(&coded.residual, true, &mut shown).unwrap();
        prop_assert!(shown == *coded.reconstruction);
        let residual = Residual::Coded { small_blocks: false, payload: &bytes };
        prop_assert!(decoder.add(&residual, true, &mut render.clone()).is_ok());
    }
}
