//! Preprocessing: what the prior states, the encoder does to its frames.

mod common;
mod scene;

use common::{assert_silent, engine};
use nvsprior::image::{
    Clahe, Converter, ImageView, PixelFormat, Preprocessing, Preprocessor, WhiteBalance,
};
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{KeyFrames, ply, with_coder_tables};
use nvsprior::render::Scene;
use nvsprior::{
    Decoder, Encoded, Encoder, EncoderOptions, Engine, Error, Picture, Pipeline, Prior, Rate,
};
use scene::{CAMERA, clean_frame, frame, on_device, pose, wall};

const FRAMES: usize = 3;

fn preprocessing() -> Preprocessing {
    let clahe = Some(Clahe::new(2.5, 6).unwrap());
    Preprocessing { white_balance: WhiteBalance::GrayWorld, clahe }
}

fn treated(picture: &Picture) -> Picture {
    let mut treated = picture.clone();
    Preprocessor::new(&preprocessing()).apply(&mut treated);
    treated
}

fn frames(engine: &Engine) -> Vec<Picture> {
    let scene = engine.upload(&wall(1)).unwrap();
    (0..FRAMES).map(|t| frame(engine, &scene, &pose(t as f64))).collect()
}

fn options() -> EncoderOptions {
    EncoderOptions { rate: Some(Rate::Quality(40.0)), ..EncoderOptions::default() }
}

/// Encodes frames, each from its pose.
fn encode(
    engine: &Engine,
    scene: &std::sync::Arc<Scene>,
    frames: &[Picture],
    options: EncoderOptions,
) -> Vec<Encoded> {
    let mut encoder = Encoder::new(engine, scene, &CAMERA, options).unwrap();
    let encode = |(t, frame)| encoder.encode(frame, Some(pose(t as f64))).unwrap();
    frames.iter().enumerate().map(encode).collect()
}

#[test]
fn an_encoder_treats_its_frames_as_the_prior_says() {
    let engine = engine();
    let plain = engine.upload(&wall(1)).unwrap();
    let preprocessed = engine.upload(&wall(1).with_preprocessing(preprocessing())).unwrap();
    assert_eq!(preprocessed.id(), plain.id());
    let raw = frames(&engine);
    let treated: Vec<_> = raw.iter().map(treated).collect();
    let expected = encode(&engine, &plain, &treated, options());
    let found = encode(&engine, &preprocessed, &raw, options());
    let given = EncoderOptions { frames_treated: true, ..options() };
    let given = encode(&engine, &preprocessed, &treated, given);
    let untreated = encode(&engine, &plain, &raw, options());
    // Decoding does not depend on it.
    let mut decoder = Decoder::new(&engine, &plain);
    for t in 0..FRAMES {
        assert_eq!(found[t].packet, expected[t].packet, "frame {t}");
        assert_eq!(given[t].packet, expected[t].packet, "frame {t}");
        assert_ne!(untreated[t].packet, expected[t].packet, "frame {t}");
        assert_eq!(found[t].stats.psnr, expected[t].stats.psnr);
        assert_eq!(found[t].stats.psnr, found[t].picture.psnr(&treated[t]));
        assert_eq!(found[t].stats.render_psnr, found[t].render.psnr(&treated[t]));
        let decoded = decoder.decode(&found[t].packet).unwrap();
        assert_eq!(decoded.picture, expected[t].picture, "frame {t}");
    }
    assert_silent(&engine);
}

#[test]
fn a_pipeline_treats_its_frames_too() {
    let (engine, scene) = on_device(&wall(1).with_preprocessing(preprocessing()));
    let raw = frames(&engine);
    let expected = encode(&engine, &scene, &raw, options());
    let encoder = Encoder::new(&engine, &scene, &CAMERA, options()).unwrap();
    let mut pipeline = Pipeline::new(encoder);
    let mut encoded = Encoded::default();
    for (t, frame) in raw.iter().enumerate() {
        if pipeline.push(frame, Some(pose(t as f64)), &mut encoded).unwrap() {
            assert_eq!(encoded.packet, expected[t - 1].packet);
            assert_eq!(encoded.stats.psnr, expected[t - 1].stats.psnr);
        }
    }
    assert!(pipeline.flush(&mut encoded).unwrap());
    assert_eq!(encoded.packet, expected[FRAMES - 1].packet);
}

#[test]
fn frames_of_any_format_and_size_are_treated_after_conversion() {
    let (engine, scene) = on_device(&wall(1).with_preprocessing(preprocessing()));
    // Twice the camera's size, with a cast.
    let (width, height) = (2 * CAMERA.width, 2 * CAMERA.height);
    let small = &frames(&engine)[0];
    let pixel = |at: usize| {
        let (x, y) = (at % width as usize / 2, at / width as usize / 2);
        let from = 3 * (y * CAMERA.width as usize + x);
        [small.data[from + 2] / 4, small.data[from + 1] / 2, small.data[from] / 5]
    };
    let bgr: Vec<u8> = (0..(width * height) as usize).flat_map(pixel).collect();
    let view = ImageView::packed(width, height, PixelFormat::Bgr8, &bgr, 3 * width as usize);
    let mut converted = Picture::default();
    Converter::new(CAMERA.width, CAMERA.height).unwrap().convert(&view, &mut converted).unwrap();
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options()).unwrap();
    let encoded = encoder.encode(&converted, Some(pose(0.0))).unwrap();
    assert_eq!(encoder.treated_frame(), &treated(&converted));
    assert_eq!(encoded.stats.psnr, encoded.picture.psnr(&treated(&converted)));
}

#[test]
fn the_frame_that_is_given_stays_and_a_wrong_one_is_refused() {
    let (engine, scene) = on_device(&wall(1).with_preprocessing(preprocessing()));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options()).unwrap();
    assert!(encoder.treated_frame().data.is_empty());
    let refused = encoder.encode(&Picture::new(8, 8), Some(pose(0.0)));
    assert!(matches!(refused, Err(Error::FrameSize { .. })));
    let mut broken = Picture::new(CAMERA.width, CAMERA.height);
    broken.data.pop();
    assert!(matches!(encoder.encode(&broken, Some(pose(0.0))), Err(Error::FrameSize { .. })));
    let black = Picture::new(CAMERA.width, CAMERA.height);
    encoder.encode(&black, Some(pose(0.0))).unwrap();
    assert!(black.data.iter().all(|value| *value == 0));
}

#[test]
fn another_engine_and_another_size_are_treated_in_the_same_way() {
    let (engine, scene) = on_device(&wall(1).with_preprocessing(preprocessing()));
    let plain = engine.upload(&wall(1)).unwrap();
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options()).unwrap();
    let camera = CAMERA.resized(80, 45);
    encoder.set_camera(&camera).unwrap();
    let mut small = Picture::new(80, 45);
    let full = clean_frame(&engine, &plain, &pose(0.0));
    let view = ImageView::packed(160, 90, PixelFormat::Rgb8, &full.data, 480);
    Converter::new(80, 45).unwrap().convert(&view, &mut small).unwrap();
    encoder.encode(&small, Some(pose(0.0))).unwrap();
    assert_eq!(encoder.treated_frame(), &treated(&small));
    // The prior that it goes on with says how.
    encoder.move_to(&engine, &plain).unwrap();
    encoder.encode(&small, Some(pose(0.0))).unwrap();
    assert_eq!(encoder.treated_frame(), &small);
}

#[test]
fn preprocessing_goes_from_container_to_container() {
    let prior = wall(1);
    let open = |bytes: &[u8]| Prior::from_bytes(bytes, "prior", &Default::default()).unwrap();
    let (splats, options, none) = (prior.splats(), prior.options(), KeyFrames::NONE);
    let written = |preprocessing: &Preprocessing| {
        let mut bytes = Vec::new();
        ply::write_ply(splats, options, &none, preprocessing, &mut bytes).unwrap();
        bytes
    };
    let plain = open(&written(&Preprocessing::NONE));
    assert!(plain.preprocessing().is_none());
    let stated = open(&written(&preprocessing()));
    assert_eq!((stated.preprocessing(), stated.id()), (&preprocessing(), plain.id()));

    // It stays when another part is replaced.
    let mut bytes = Vec::new();
    compact::write(splats, &stated.besides(), &Quantisation::default(), &mut bytes).unwrap();
    let tables = nvsprior::coder_tables::Tables::generic();
    let all = open(&with_coder_tables(&bytes, Some(&tables)).unwrap());
    assert!(all.preprocessing() == &preprocessing() && all.coder_tables().is_some());
}
