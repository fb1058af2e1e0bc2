//! Streams through the public API: frames that are predicted from frames, and what happens if one of these is missing.

mod common;
mod scene;

use std::sync::{Arc, OnceLock};

use common::{assert_silent, engine};
use nvsprior::image::Mask;
use nvsprior::packet::{Latent, Residual};
use nvsprior::render::Scene;
use nvsprior::residual::ResidualError;
use nvsprior::{
    Camera, Decoded, Decoder, Encoded, Encoder, EncoderOptions, Error, Mode, Packet, Picture,
    Pipeline, Pose, Rate, Structure, Trust,
};
use scene::{CAMERA, clean_frame, frame, pose, wall, wall_with_box};

const CHAIN: Mode = Mode::Stream(Structure::Chain { key_every: 0 });

fn options(mode: Mode) -> EncoderOptions {
    EncoderOptions { mode, rate: Some(Rate::Quality(40.0)), ..EncoderOptions::default() }
}

fn uploaded() -> Arc<Scene> {
    static SCENE: OnceLock<Arc<Scene>> = OnceLock::new();
    SCENE.get_or_init(|| engine().upload(&wall(1)).unwrap()).clone()
}

fn new_encoder(options: EncoderOptions) -> Encoder {
    Encoder::new(&engine(), &uploaded(), &CAMERA, options).unwrap()
}

fn new_decoder() -> Decoder {
    Decoder::new(&engine(), &uploaded())
}

/// Frames of a slow dive, with a patch that the prior does not know.
fn frames() -> &'static [Picture] {
    static FRAMES: OnceLock<Vec<Picture>> = OnceLock::new();
    FRAMES.get_or_init(|| {
        (0..12).map(|t| frame(&engine(), &uploaded(), &pose(0.2 * f64::from(t)))).collect()
    })
}

fn encode(encoder: &mut Encoder, frames: &[Picture]) -> Vec<Encoded> {
    let hint = |t: usize| (t == 0).then(|| pose(0.0));
    frames.iter().enumerate().map(|(t, frame)| encoder.encode(frame, hint(t)).unwrap()).collect()
}

/// Checks that a packet gives the picture that the encoder showed.
fn check_whole(decoder: &mut Decoder, encoded: &Encoded) -> Decoded {
    let decoded = decoder.decode(&encoded.packet).unwrap();
    let stats = &encoded.stats;
    assert!(decoded.damage.is_none(), "frame {}: {:?}", stats.frame, decoded.damage);
    assert_eq!(decoded.picture, encoded.picture, "frame {}", stats.frame);
    // A packet says 16 bits of its number; a decoder that knows no earlier one takes the others for 0.
    let [shown, expected] =
        [decoded.reference, stats.reference].map(|number| number.map(|n| n as u16));
    assert_eq!(shown, expected);
    decoded
}

/// Checks that a packet gives the render alone, since a frame is missing.
fn check_missing(decoder: &mut Decoder, encoded: &Encoded) {
    let decoded = decoder.decode(&encoded.packet).unwrap();
    let due = encoded.stats.reference.expect("an inter frame");
    let missing = match decoded.damage {
        Some(Error::Residual(ResidualError::ReferenceMissing { frame, reference })) => {
            assert_eq!(frame, encoded.stats.frame);
            reference
        }
        other => panic!("frame {}: {other:?}", encoded.stats.frame),
    };
    assert_eq!((missing, decoded.reference), (due, Some(due)));
    assert_eq!(decoded.picture, encoded.render, "frame {}", encoded.stats.frame);
    assert!(!decoded.kept && decoded.rows == 0);
}

#[test]
fn nothing_drifts_at_any_rate_and_structure() {
    let structures = [
        Structure::Chain { key_every: 5 },
        Structure::Layers { key_every: 0 },
        Structure::Keys { key_every: 6 },
    ];
    for rate in [Rate::Quality(40.0), Rate::Bytes(260), Rate::Psnr(38.0)] {
        for structure in structures {
            let mode = Mode::Stream(structure);
            let mut encoder = new_encoder(EncoderOptions { rate: Some(rate), ..options(mode) });
            let mut decoder = new_decoder();
            let all = encode(&mut encoder, frames());
            for encoded in &all {
                assert!(check_whole(&mut decoder, encoded).kept);
                assert!(encoded.stats.psnr > encoded.stats.render_psnr);
                if let Rate::Bytes(budget) = rate {
                    assert!(encoded.packet.len() <= budget);
                }
            }
            let inter = all.iter().filter(|encoded| encoded.stats.reference.is_some()).count();
            assert!(inter > 6, "{rate:?} {structure:?}: {inter} inter frames");
        }
    }
    assert_silent(&engine());
}

/// A fast dive past something new: after some searches the tracker draws a pose that none of them has drawn.
#[test]
fn nothing_drifts_however_the_search_ends() {
    let at = |t: u8| {
        let t = f64::from(t);
        Pose::IDENTITY.stepped(&[1.5 - 0.15 * t, 0.02 * t, 0.0, 0.0, 0.0, 0.0])
    };
    let with_box = engine().upload(&wall_with_box(1)).unwrap();
    let frames: Vec<_> = (0..12).map(|t| clean_frame(&engine(), &with_box, &at(t))).collect();
    let (mut encoder, mut decoder) = (new_encoder(options(CHAIN)), new_decoder());
    let mut inter = 0;
    for (t, frame) in frames.iter().enumerate() {
        let encoded = encoder.encode(frame, (t == 0).then(|| at(0))).unwrap();
        inter += usize::from(encoded.stats.reference.is_some());
        check_whole(&mut decoder, &encoded);
    }
    assert!(inter > 3, "{inter} inter frames");
}

#[test]
fn streams_take_fewer_bytes() {
    let bytes = |mode| {
        let all = encode(&mut new_encoder(options(mode)), frames());
        // The first is intra either way.
        all[1..].iter().map(|encoded| encoded.packet.len()).sum::<usize>()
    };
    let (intra, chain) = (bytes(Mode::Intra), bytes(CHAIN));
    assert!(chain * 10 < intra * 8, "{chain} bytes for {intra}");
}

#[test]
fn a_frame_of_a_stream_that_stands_alone_costs_no_more() {
    let [alone, stream] = [Mode::Intra, CHAIN].map(|mode| {
        let encoded = encode(&mut new_encoder(options(mode)), &frames()[..1]);
        encoded[0].packet.clone()
    });
    assert_eq!(stream.len(), alone.len());
    let residual = Packet::decode(&stream).unwrap().residual;
    assert!(matches!(residual, Residual::Stream { reference: None, .. }));
}

#[test]
fn a_loss_ends_at_the_next_key_frame() {
    let mode = Mode::Stream(Structure::Chain { key_every: 5 });
    let all = encode(&mut new_encoder(options(mode)), frames());
    let mut decoder = new_decoder();
    for (t, encoded) in all.iter().enumerate() {
        match t {
            2 => {}
            3 | 4 => check_missing(&mut decoder, encoded),
            _ => drop(check_whole(&mut decoder, encoded)),
        }
    }
}

#[test]
fn a_lost_frame_on_which_none_leans_costs_itself() {
    let all = encode(
        &mut new_encoder(options(Mode::Stream(Structure::Layers { key_every: 0 }))),
        frames(),
    );
    let mut decoder = new_decoder();
    for (t, encoded) in all.iter().enumerate().filter(|(t, _)| t % 2 == 0) {
        check_whole(&mut decoder, encoded);
        assert!(t % 4 > 0 || encoded.stats.reference.is_none_or(|reference| reference % 4 == 0));
    }
    let keys = Mode::Stream(Structure::Keys { key_every: 0 });
    let all = encode(&mut new_encoder(options(keys)), frames());
    let mut decoder = new_decoder();
    // Key frames, those in which prediction saves nothing too, and a few others.
    let arrived = |(t, encoded): &(usize, &Encoded)| {
        encoded.stats.reference.is_none() || [3, 4, 7, 11].contains(t)
    };
    let arrived: Vec<_> = all.iter().enumerate().filter(arrived).collect();
    assert!(arrived.len() < 10);
    for (_, encoded) in arrived {
        check_whole(&mut decoder, encoded);
    }
}

#[test]
fn a_frame_that_came_in_part_is_no_reference() {
    let all = encode(&mut new_encoder(options(CHAIN)), frames());
    let mut decoder = new_decoder();
    check_whole(&mut decoder, &all[0]);
    check_whole(&mut decoder, &all[1]);
    let mut decoded = Decoded::default();
    let start = &all[2].packet[..all[2].packet.len() * 3 / 4];
    decoder.decode_into(start, Trust::Start, &mut decoded).unwrap();
    // What came of it is shown: it is predicted from a frame that is there.
    assert!(decoded.damage.is_some() && !decoded.kept && decoded.rows == CAMERA.height);
    assert_eq!(decoded.reference, Some(1));
    assert!(decoded.picture.psnr(&frames()[2]) > all[2].stats.render_psnr + 1.0);
    check_missing(&mut decoder, &all[3]);
    // If the rest comes after all, those after it are valid again.
    check_whole(&mut decoder, &all[2]);
    check_whole(&mut decoder, &all[3]);
    // The same without trust: the render alone, and no reference.
    let decoded = decoder.decode(&all[4].packet[..all[4].packet.len() - 1]).unwrap();
    assert!(decoded.damage.is_some() && decoded.rows == 0 && decoded.reference.is_none());
    check_missing(&mut decoder, &all[5]);
}

#[test]
fn packets_may_come_twice_and_out_of_order() {
    let keys = Mode::Stream(Structure::Keys { key_every: 4 });
    let all = encode(&mut new_encoder(options(keys)), frames());
    let mut decoder = new_decoder();
    for t in [0, 2, 1, 3, 3, 0, 2, 4, 6, 5, 1, 7] {
        check_whole(&mut decoder, &all[t]);
    }
}

#[test]
fn a_topside_that_joins_late_shows_renders_up_to_the_next_key_frame() {
    let mode = Mode::Stream(Structure::Chain { key_every: 6 });
    let all = encode(&mut new_encoder(options(mode)), frames());
    let mut decoder = new_decoder();
    decoder.add_camera(&CAMERA).unwrap();
    for (t, encoded) in all.iter().enumerate().skip(3) {
        if t < 6 {
            check_missing(&mut decoder, encoded);
        } else {
            check_whole(&mut decoder, encoded);
        }
    }
    // It may also ask for an intra frame.
    let mut encoder = new_encoder(options(CHAIN));
    encode(&mut encoder, &frames()[..3]);
    encoder.announce();
    let asked = encoder.encode(&frames()[3], None).unwrap();
    assert_eq!(asked.stats.reference, None);
    check_whole(&mut new_decoder(), &asked);
}

#[test]
fn no_frame_of_another_run_is_taken_for_a_reference() {
    let first = encode(&mut new_encoder(options(CHAIN)), frames());
    // The vehicle starts again, and numbers its frames as before. Its frames are others.
    let mut again: Vec<_> = frames().to_vec();
    again.reverse();
    let mut encoder = new_encoder(options(CHAIN));
    let hint = |t: usize| (t == 0).then(|| pose(0.2 * 11.0));
    let second: Vec<_> =
        again.iter().enumerate().map(|(t, f)| encoder.encode(f, hint(t)).unwrap()).collect();
    let mut decoder = new_decoder();
    first.iter().for_each(|encoded| drop(check_whole(&mut decoder, encoded)));
    // The new first frame is lost.
    let inter = second[1..].iter().take_while(|encoded| encoded.stats.reference.is_some());
    assert!(inter.clone().count() > 3);
    inter.for_each(|encoded| check_missing(&mut decoder, encoded));
    second.iter().for_each(|encoded| drop(check_whole(&mut decoder, encoded)));
}

#[test]
fn another_camera_or_a_reset_begins_a_new_stream() {
    let mut encoder = new_encoder(options(CHAIN));
    let mut decoder = new_decoder();
    for encoded in encode(&mut encoder, &frames()[..2]) {
        check_whole(&mut decoder, &encoded);
    }
    let other = Camera { fx: CAMERA.fx * 1.001, ..CAMERA };
    encoder.set_camera(&other).unwrap();
    let encoded = encoder.encode(&frames()[2], None).unwrap();
    assert_eq!(encoded.stats.reference, None);
    check_whole(&mut decoder, &encoded);
    let encoded = encoder.encode(&frames()[3], None).unwrap();
    assert_eq!(encoded.stats.reference, Some(2));
    check_whole(&mut decoder, &encoded);
    encoder.set_camera(&CAMERA).unwrap();
    assert_eq!(encoder.encode(&frames()[4], None).unwrap().stats.reference, None);
    assert_eq!(encoder.encode(&frames()[5], None).unwrap().stats.reference, Some(4));
    encoder.reset();
    assert_eq!(encoder.encode(&frames()[6], pose(1.2)).unwrap().stats.reference, None);
}

#[test]
fn frame_numbers_wrap() {
    for first_frame in [Latent::FRAMES - 4, u32::MAX - 3] {
        let mut encoder = new_encoder(EncoderOptions { first_frame, ..options(CHAIN) });
        let all = encode(&mut encoder, frames());
        let mut decoder = new_decoder();
        all.iter().for_each(|encoded| drop(check_whole(&mut decoder, encoded)));
        assert!(all[5].stats.reference.is_some());
    }
}

#[test]
fn only_acknowledged_frames_are_references() {
    let mut encoder = new_encoder(options(Mode::Stream(Structure::Acknowledged)));
    let mut decoder = new_decoder();
    let mut references = Vec::new();
    let mut acknowledged = Vec::new();
    for (t, frame) in frames().iter().enumerate() {
        // Word of a frame takes three frames to come back; every third packet is lost.
        if let Some(frame) = t.checked_sub(3).and_then(|t| acknowledged[t]) {
            encoder.acknowledge(frame);
        }
        let encoded = encoder.encode(frame, (t == 0).then(|| pose(0.0))).unwrap();
        references.push(encoded.stats.reference);
        let decoded = (t % 3 != 2).then(|| check_whole(&mut decoder, &encoded));
        acknowledged.push(decoded.map(|decoded| decoded.frame));
    }
    assert_eq!(references[..3], [None; 3]);
    // Each is predicted from the newest frame that was acknowledged, or from none if that saves nothing.
    let newest = [0, 1, 1, 3, 4, 4, 6, 7, 7];
    for (found, due) in references[3..].iter().zip(newest) {
        assert!(found.is_none_or(|found| found == due), "{references:?}");
    }
    assert!(references.iter().flatten().count() > 1, "{references:?}");
}

#[test]
fn a_pipeline_gives_the_same_packets() {
    let mut pipeline = Pipeline::new(new_encoder(options(CHAIN)));
    let mut encoded = Encoded::default();
    let mut packets = Vec::new();
    for (t, frame) in frames().iter().enumerate() {
        if pipeline.push(frame, (t == 0).then(|| pose(0.0)), &mut encoded).unwrap() {
            packets.push(encoded.packet.clone());
        }
    }
    assert!(pipeline.flush(&mut encoded).unwrap());
    packets.push(encoded.packet.clone());
    let alone = encode(&mut new_encoder(options(CHAIN)), frames());
    assert!(alone.iter().map(|encoded| &encoded.packet).eq(&packets));
}

#[test]
fn masked_pixels_stay_those_of_the_render() {
    let mut mask = Mask::all(CAMERA.width, CAMERA.height);
    mask.data[..160 * 30].fill(false);
    let mut encoder = new_encoder(options(CHAIN));
    encoder.set_mask(Some(&mask)).unwrap();
    let mut decoder = new_decoder();
    let all = encode(&mut encoder, frames());
    for encoded in &all {
        check_whole(&mut decoder, encoded);
    }
    assert!(all.iter().filter(|encoded| encoded.stats.reference.is_some()).count() > 6);
    let (shown, render) = (&all[11].picture.data[..160 * 10 * 3], &all[11].render.data);
    let off = shown.iter().zip(render).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off < Some(40), "{off:?}");
}

#[test]
fn a_render_that_is_good_enough_breaks_no_stream() {
    let mut encoder = new_encoder(options(CHAIN));
    let mut decoder = new_decoder();
    for (t, frame) in frames().iter().enumerate() {
        // Every third frame asks for no more than the render has, or for no residual at all.
        encoder.set_rate(match t % 6 {
            2 => Some(Rate::Psnr(1.0)),
            5 => None,
            _ => Some(Rate::Quality(40.0)),
        });
        let encoded = encoder.encode(frame, (t == 0).then(|| pose(0.0))).unwrap();
        let decoded = check_whole(&mut decoder, &encoded);
        assert_eq!(decoded.kept, t % 3 != 2);
    }
    // A frame that could not be coded is no reference of others.
    encoder.set_rate(Some(Rate::Bytes(5)));
    let failed = encoder.encode(&frames()[0], None);
    assert!(matches!(failed, Err(Error::Budget { .. })));
    encoder.set_rate(Some(Rate::Quality(40.0)));
    let encoded = encoder.encode(&frames()[11], None).unwrap();
    check_whole(&mut decoder, &encoded);
}
