//! How a picture of the device differs from its twin's.

use std::path::PathBuf;

use nvsprior::image::psnr_of_mse;
use nvsprior::render::Plan;
use nvsprior::{Camera, Pose, Prior};
use nvsprior_reference::{Rendered, Twin};

use crate::common;

// On lavapipe colours agree to 2e-6 in random scenes without close decisions, and to 5e-6 in the
// reef prior. The reef's picture, with all close decisions, is at 97 dB. Other devices'
// exponentials may be less exact.
/// Least PSNR of linear RGB, clamped to [0, 1], in dB.
const MIN_PSNR: f64 = 75.0;
/// Largest error of a colour beyond what close decisions explain: an eighth of an 8-bit step.
const COLOUR: f64 = 5e-4;
/// Most that the transmittance may be off beyond that.
const TRANSMITTANCE: f64 = 5e-4;
/// Largest error of the depth beyond what close decisions explain, as a share of the depth (of 1 if the depth is less).
const DEPTH: f64 = 5e-4;

/// Draws the prior on the device and with the twin. Fails if the pictures differ by more than the
/// tolerances; the message then names a file with the difference picture.
pub fn assert_same(name: &str, prior: &Prior, camera: &Camera, pose: &Pose) {
    let engine = common::engine();
    let scene = engine.upload(prior).unwrap();
    let mut renderer = engine.renderer(&scene, camera, Plan::picture()).unwrap();
    let gpu = renderer.draw(pose).unwrap();
    let twin = Twin::new(prior).render(camera, pose);
    let fault = fault(gpu, &twin);
    common::assert_silent(&engine);
    if let Some(fault) = fault {
        let path = write_difference(name, camera, gpu, &twin);
        panic!("{name}: {fault}; difference × 64 in {}", path.display());
    }
}

/// What is wrong with a picture, if anything.
pub fn fault(gpu: &[f32], twin: &Rendered) -> Option<String> {
    assert_eq!(gpu.len(), twin.pixels.len() * 5, "floats of the picture");
    let mut square = 0.0;
    for (at, pixel) in gpu.chunks_exact(5).enumerate() {
        let depth = DEPTH * twin.pixels[at][3].max(1.0);
        let tolerances = [COLOUR, COLOUR, COLOUR, depth, TRANSMITTANCE];
        for (k, tolerance) in tolerances.into_iter().enumerate() {
            let (got, expected) = (f64::from(pixel[k]), twin.pixels[at][k]);
            let risk = twin.risk[at][k];
            // Several decisions may depend on each other, so the sum of their jumps is only a guide.
            if !((got - expected).abs() <= tolerance + 1.5 * risk) {
                return Some(format!(
                    "pixel {at}, channel {k}: {got}, twin {expected}, at risk {risk:e}"
                ));
            }
            if k < 3 {
                square += (got.clamp(0.0, 1.0) - expected.clamp(0.0, 1.0)).powi(2);
            }
        }
    }
    let psnr = psnr_of_mse(square / (3.0 * twin.pixels.len() as f64));
    (!(psnr >= MIN_PSNR)).then(|| format!("{psnr:.1} dB against the twin"))
}

/// Writes the difference as a PNG, 64 times, around middle grey.
fn write_difference(name: &str, camera: &Camera, gpu: &[f32], twin: &Rendered) -> PathBuf {
    let pixels = std::iter::zip(gpu.chunks_exact(5), &twin.pixels);
    let bytes = pixels.flat_map(|(gpu, twin)| {
        [0, 1, 2].map(|k| {
            let difference = 64.0 * (f64::from(gpu[k]) - twin[k]);
            (255.0 * difference + 127.5).clamp(0.0, 255.0) as u8
        })
    });
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
    image::RgbImage::from_raw(camera.width, camera.height, bytes.collect())
        .expect("three bytes per pixel")
        .save(&path)
        .expect("a file in the target folder");
    path
}

#[test]
fn a_difference_that_no_decision_explains_is_a_fault() {
    let mut twin = Rendered { pixels: vec![[0.5; 5]; 1000], risk: vec![[0.0; 5]; 1000] };
    let mut gpu = vec![0.5; 5000];
    assert_eq!(fault(&gpu, &twin), None);
    gpu[2501] = 0.502;
    assert!(fault(&gpu, &twin).is_some_and(|f| f.contains("pixel 500, channel 1")));
    twin.risk[500][1] = 0.0015;
    assert_eq!(fault(&gpu, &twin), None);
    gpu[2501] = f32::NAN;
    assert!(fault(&gpu, &twin).is_some());
    // A little everywhere: within each pixel's tolerance, but too much for the picture.
    let gpu: Vec<f32> = vec![0.5004; 5000];
    assert!(fault(&gpu, &twin).is_some_and(|f| f.contains("dB")));
}
