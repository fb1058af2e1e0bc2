//! Frames taken through a lens, and frames of which a part does not count, through the public API.

mod common;
mod scene;

use std::sync::Arc;

use common::{assert_silent, engine};
use glam::DVec2;
use nvsprior::geometry::{Distortion, Intrinsics, Lens};
use nvsprior::image::{
    Clahe, Converter, ImageView, Mask, PixelFormat, Preprocessing, WhiteBalance, psnr_of_mse,
};
use nvsprior::render::{Plan, Scene};
use nvsprior::{
    Camera, Decoder, Encoded, Encoder, EncoderOptions, Engine, Error, Picture, Pipeline, Pose, Rate,
};
use scene::{CAMERA, clean_frame, frame, on_device, pose, pose_error, wall};

const OFFSET: [f64; 6] = [0.05, -0.04, 0.06, 0.02, -0.03, 0.02];

/// A vehicle's arm: it reaches from the lower right into a third of the picture. `false` is the arm.
fn arm() -> Mask {
    let mut mask = Mask::all(CAMERA.width, CAMERA.height);
    for (i, counts) in mask.data.iter_mut().enumerate() {
        let (x, y) = ((i % 160) as i32, (i / 160) as i32);
        *counts = x + y < 150 + 12 * (y % 20) / 20;
    }
    assert!((0.3..0.4).contains(&(1.0 - mask.share())), "{}", mask.share());
    mask
}

/// Paints what is masked: bright, with stripes that move from frame to frame otherwise than the scene.
fn paint(picture: &mut Picture, mask: &Mask, t: u32) {
    for (i, rgb) in picture.data.chunks_exact_mut(3).enumerate().filter(|(i, _)| !mask.data[*i]) {
        let (x, y) = (i as u32 % 160, i as u32 / 160);
        rgb.copy_from_slice(if (x + 2 * y + 5 * t) % 16 < 8 {
            &[255, 200, 40]
        } else {
            &[230, 230, 230]
        });
    }
}

fn encoder(engine: &Engine, scene: &Arc<Scene>, options: EncoderOptions) -> Encoder {
    Encoder::new(engine, scene, &CAMERA, options).unwrap()
}

#[test]
fn a_masked_arm_costs_neither_the_pose_nor_bytes() {
    // At one quality, and for one PSNR of what counts.
    for rate in [Rate::Quality(10.0), Rate::Psnr(38.0)] {
        arm_beside_none(rate, clean_frame, 0.3);
        // What the prior does not know moves the best pose. The fewer pixels count, the farther.
        arm_beside_none(rate, two_patches, 0.5);
    }
}

/// As [`frame`], with a second patch that the prior does not know. The arm hides it.
fn two_patches(engine: &Engine, scene: &Arc<Scene>, pose: &Pose) -> Picture {
    let mut picture = frame(engine, scene, pose);
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i / 3 % 160, i / 3 / 160);
        if (125..145).contains(&x) && (60..80).contains(&y) {
            *value = value.saturating_sub(60);
        }
    }
    picture
}

/// `max`: how far the pose may be off, pixels.
fn arm_beside_none(rate: Rate, frame: fn(&Engine, &Arc<Scene>, &Pose) -> Picture, max: f64) {
    let engine = engine();
    let options = EncoderOptions { rate: Some(rate), ..EncoderOptions::default() };
    let scene = engine.upload(&wall(1)).unwrap();
    let mask = arm();
    let [mut plain, mut masked, mut naked] =
        [0, 1, 2].map(|_| encoder(&engine, &scene, options.clone()));
    masked.set_mask(Some(&mask)).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let mut bytes = [0; 3];
    for t in 0..4u32 {
        let truth = pose(t.into());
        let seen = frame(&engine, &scene, &truth);
        let mut covered = seen.clone();
        paint(&mut covered, &mask, t);
        let start = (t == 0).then(|| truth.stepped(&OFFSET));
        let plain = plain.encode(&seen, start).unwrap();
        let found = masked.encode(&covered, start).unwrap();
        let naked = naked.encode(&covered, start).unwrap();
        let errors = [&plain, &found, &naked].map(|e| pose_error(&e.pose, &truth));
        assert!(found.stats.certain, "frame {t}: {:?}", found.stats);
        assert!(errors[1] < max, "frame {t}: {errors:?}");
        let psnr = [&plain, &found, &naked].map(|e| e.stats.psnr);
        println!("{rate:?} {t}: poses off by {errors:.3?} px, {psnr:.2?} dB");
        for (sum, encoded) in bytes.iter_mut().zip([&plain, &found, &naked]) {
            *sum += encoded.packet.len();
        }
        let decoded = decoder.decode(&found.packet).unwrap();
        assert_eq!(decoded.picture, found.picture, "frame {t}");
        // Inside of the arm the topside sees the prior.
        let inside = Mask { data: mask.data.iter().map(|counts| !counts).collect(), ..mask };
        let off = psnr_of_mse(inside.mse(&decoded.picture, &found.render));
        println!("  inside of the arm {off:.2} dB from the render");
        assert!(off > 38.0, "frame {t}: {off} dB");
    }
    println!(
        "bytes of four frames: {} without an arm, {} masked, {} not masked",
        bytes[0], bytes[1], bytes[2]
    );
    // Packets of next to nothing may differ by a byte.
    assert!(bytes[1] <= bytes[0] + 4, "{bytes:?}");
    assert!(bytes[2] > 2 * bytes[0], "{bytes:?}");
    assert_silent(&engine);
}

/// Packets of some frames, whose masked pixels have colours by `paint`.
fn packets(
    engine: &Engine,
    scene: &Arc<Scene>,
    options: &EncoderOptions,
    paint: impl Fn(&mut Picture, &Mask, u32),
) -> Vec<Vec<u8>> {
    let mask = arm();
    let mut encoder = encoder(engine, scene, options.clone());
    encoder.set_mask(Some(&mask)).unwrap();
    let packet = |t: u32| {
        let truth = pose(t.into());
        let mut seen = frame(engine, scene, &truth);
        paint(&mut seen, &mask, t);
        let start = (t == 0).then(|| truth.stepped(&[0.2, -0.1, 0.1, 0.05, -0.09, 0.06]));
        encoder.encode(&seen, start).unwrap().packet
    };
    (0..3).map(packet).collect()
}

#[test]
fn what_masked_pixels_show_does_not_matter_at_all() {
    let engine = engine();
    let treated =
        Preprocessing { white_balance: WhiteBalance::GrayWorld, clahe: Clahe::new(2.5, 8).ok() };
    let scene = engine.upload(&wall(1)).unwrap();
    let treated = engine.upload(&wall(1).with_preprocessing(treated)).unwrap();
    let options = EncoderOptions::default();
    for scene in [&scene, &treated] {
        let arm = packets(&engine, scene, &options, paint);
        let black = packets(&engine, scene, &options, |picture, mask, _| {
            let pixels = picture.data.chunks_exact_mut(3).zip(&mask.data);
            pixels.filter(|(_, counts)| !**counts).for_each(|(rgb, _)| rgb.fill(0));
        });
        assert!(arm == black);
    }
    assert_silent(&engine);
}

#[test]
fn a_target_is_reached_over_what_counts() {
    let (engine, scene) = on_device(&wall(1));
    let (mask, truth) = (arm(), pose(0.0));
    let mut seen = frame(&engine, &scene, &truth);
    paint(&mut seen, &mask, 0);
    for target in [36.0, 40.0] {
        let rate = Some(Rate::Psnr(target));
        let mut encoder =
            encoder(&engine, &scene, EncoderOptions { rate, ..EncoderOptions::default() });
        encoder.set_mask(Some(&mask)).unwrap();
        let Encoded { picture, stats, .. } = encoder.encode(&seen, Some(truth)).unwrap();
        let psnr = psnr_of_mse(mask.mse(&picture, &seen));
        assert!((stats.psnr - psnr).abs() < 1e-9, "{} is not {psnr}", stats.psnr);
        assert!(stats.rate_kept && psnr >= target && psnr < target + 1.0, "{psnr} dB for {target}");
    }
}

#[test]
fn masks_that_do_not_fit_are_refused_and_the_old_one_stays() {
    let (engine, scene) = on_device(&wall(1));
    let mut encoder = encoder(&engine, &scene, EncoderOptions::default());
    let (mask, truth) = (arm(), pose(0.0));
    encoder.set_mask(Some(&mask)).unwrap();
    let small = encoder.set_mask(Some(&Mask::all(159, 90))).unwrap_err();
    assert_eq!(small.to_string(), "mask of 159×90 pixels for a camera of 160×90");
    let none = encoder.set_mask(Some(&Mask::none(160, 90))).unwrap_err();
    assert!(matches!(none, Error::MaskEmpty), "{none}");
    let mut seen = frame(&engine, &scene, &truth);
    paint(&mut seen, &mask, 0);
    let found = encoder.encode(&seen, Some(truth)).unwrap();
    assert!(found.stats.psnr > 30.0, "the arm is still masked: {} dB", found.stats.psnr);

    // It is scaled with the camera, and taken off.
    let half = CAMERA.resized(80, 45);
    encoder.set_camera(&half).unwrap();
    let view = ImageView::packed(160, 90, PixelFormat::Rgb8, &seen.data, 480);
    let mut small = Picture::new(80, 45);
    Converter::new(80, 45).unwrap().convert(&view, &mut small).unwrap();
    let scaled = encoder.encode(&small, Some(truth)).unwrap();
    assert!(scaled.stats.psnr > 28.0, "{} dB", scaled.stats.psnr);
    encoder.set_mask(None).unwrap();
    let naked = encoder.encode(&small, Some(truth)).unwrap();
    assert!(naked.packet.len() > 2 * scaled.packet.len());
    assert_silent(&engine);
}

#[test]
fn a_pipeline_masks_as_the_encoder_does() {
    let (engine, scene) = on_device(&wall(1));
    let options = EncoderOptions::default();
    let one_by_one = packets(&engine, &scene, &options, paint);
    let mask = arm();
    let mut encoder = encoder(&engine, &scene, options);
    encoder.set_mask(Some(&mask)).unwrap();
    let mut pipeline = Pipeline::new(encoder);
    let (mut encoded, mut found) = (Encoded::default(), Vec::new());
    for t in 0..3u32 {
        let truth = pose(t.into());
        let mut seen = frame(&engine, &scene, &truth);
        paint(&mut seen, &mask, t);
        let start = (t == 0).then(|| truth.stepped(&[0.2, -0.1, 0.1, 0.05, -0.09, 0.06]));
        if pipeline.push(&seen, start, &mut encoded).unwrap() {
            found.push(encoded.packet.clone());
        }
    }
    assert!(pipeline.flush(&mut encoded).unwrap());
    found.push(encoded.packet.clone());
    assert!(found == one_by_one);
}

/// The wall as a lens shows it, from a pinhole render four times as fine.
fn through(lens: &Lens, engine: &Engine, scene: &Arc<Scene>, pose: &Pose) -> Picture {
    let (width, height) = lens.size();
    // It sees a little more than the lens.
    let wide = Camera { fx: 90.0, fy: 90.0, ..CAMERA }.resized(1280, 720);
    let mut fine = Picture::new(wide.width, wide.height);
    engine.renderer(scene, &wide, Plan::picture()).unwrap().picture(pose, &mut fine).unwrap();
    let mut picture = Picture::new(width, height);
    for (i, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
        let corner = DVec2::new((i as u32 % width).into(), (i as u32 / width).into());
        let mut sums = [0u32; 3];
        for part in 0..16 {
            let inside = DVec2::new(f64::from(part % 4), f64::from(part / 4)) / 4.0 + 0.125;
            let Some(ray) = lens.ray(corner + inside) else { continue };
            let x = f64::from(wide.fx) * ray.x + f64::from(wide.cx);
            let y = f64::from(wide.fy) * ray.y + f64::from(wide.cy);
            let (x, y) = (x.clamp(0.0, 1279.0) as usize, y.clamp(0.0, 719.0) as usize);
            let from = &fine.data[3 * (1280 * y + x)..][..3];
            sums.iter_mut().zip(from).for_each(|(sum, v)| *sum += u32::from(*v));
        }
        rgb.copy_from_slice(&sums.map(|sum| ((sum + 8) / 16) as u8));
    }
    picture
}

#[test]
fn frames_through_a_lens_are_found_as_those_of_a_pinhole() {
    let (engine, scene) = on_device(&wall(1));
    let intrinsics =
        Intrinsics { width: 400, height: 225, fx: 310.0, fy: 311.0, cx: 203.0, cy: 110.0 };
    for distortion in [
        Distortion::brown(&[-0.3, 0.1, 0.003, -0.002, -0.01]).unwrap(),
        Distortion::Fisheye([-0.05, 0.02, -0.004, 0.001]),
    ] {
        let lens = Lens::new(intrinsics, distortion).unwrap();
        // Wider than the lens in its corners: what it does not show is masked.
        let own = lens.pinhole_at(160);
        let camera = Camera { fx: 0.93 * own.fx, fy: 0.93 * own.fy, ..own };
        let mut converter = Converter::undistorting(&lens, &camera).unwrap();
        let covered = converter.covered().unwrap().clone();
        assert!((0.85..1.0).contains(&covered.share()), "{}", covered.share());
        let options = EncoderOptions::default();
        let mut encoder = Encoder::new(&engine, &scene, &camera, options.clone()).unwrap();
        encoder.set_mask(Some(&covered)).unwrap();
        let mut plain = Encoder::new(&engine, &scene, &camera, options).unwrap();
        let mut seen = Picture::new(0, 0);
        for t in 0..3 {
            let truth = pose(t.into());
            let image = through(&lens, &engine, &scene, &truth);
            let view = ImageView::packed(400, 225, PixelFormat::Rgb8, &image.data, 1200);
            converter.convert(&view, &mut seen).unwrap();
            let start = (t == 0).then(|| truth.stepped(&OFFSET));
            let found = encoder.encode(&seen, start).unwrap();
            let error = pose_error(&found.pose, &truth);
            assert!(found.stats.certain && error < 0.4, "{distortion:?} {t}: {error} px");
            assert!(found.stats.render_psnr > 27.0, "{} dB", found.stats.render_psnr);
            // With the distortion left in, the scene does not fit.
            let view = ImageView::packed(400, 225, PixelFormat::Rgb8, &image.data, 1200);
            let mut bent = Picture::new(0, 0);
            let mut scaler = Converter::new(camera.width, camera.height).unwrap();
            scaler.convert(&view, &mut bent).unwrap();
            let bent = plain.encode(&bent, start).unwrap();
            assert!(bent.stats.render_psnr < found.stats.render_psnr - 3.0);
        }
    }
    assert_silent(&engine);
}

#[test]
fn a_mask_of_all_pixels_changes_nothing() {
    let (engine, scene) = on_device(&wall(1));
    let truth = pose(0.0);
    let seen = clean_frame(&engine, &scene, &truth);
    let mut packets = [None, Some(Mask::all(160, 90))].map(|mask| {
        let mut encoder = encoder(&engine, &scene, EncoderOptions::default());
        encoder.set_mask(mask.as_ref()).unwrap();
        encoder.encode(&seen, Some(truth)).unwrap().packet
    });
    assert_eq!(std::mem::take(&mut packets[0]), packets[1]);
}
