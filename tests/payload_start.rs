//! The start of a payload whose end is missing must give the best possible picture.

mod common;
mod scene;

use nvsprior::{Decoded, Decoder, Encoder, EncoderOptions, Rate, Trust};
use scene::{CAMERA, frame, on_device, pose, wall};

#[test]
fn what_arrives_of_a_wavelet_payload_makes_the_whole_picture_finer() {
    let (engine, scene) = on_device(&wall(1));
    let options = EncoderOptions { rate: Some(Rate::Quality(80.0)), ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let camera = frame(&engine, &scene, &pose(0.0));
    let encoded = encoder.encode(&camera, Some(pose(0.0))).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let mut decoded = Decoded::default();
    let mut best = encoded.stats.render_psnr;
    let whole = encoded.packet.len();
    for part in 1..=8 {
        let start = &encoded.packet[..31 + 18 + (whole - 49) * part / 8];
        decoder.decode_into(start, Trust::Start, &mut decoded).unwrap();
        let psnr = decoded.picture.psnr(&camera);
        assert_eq!((decoded.damage.is_none(), decoded.rows), (part == 8, CAMERA.height));
        assert!(psnr > best - 0.2, "{part} eighths: {psnr} dB after {best} dB");
        best = best.max(psnr);
    }
    assert_eq!(decoded.picture, encoded.picture);
    assert!(best > encoded.stats.render_psnr + 3.0);
}
