//! Packets through modem frames to pictures, with losses: what arrived must give the best possible picture.

mod common;
mod scene;

use common::Random;
use nvsprior::residual::ResidualCoder;
use nvsprior::{Decoded, Decoder, Encoder, EncoderOptions, Picture, Rate, Trust};
use nvsprior_link::modem::{Collector, CollectorOptions, Sharer};
use scene::{CAMERA, frame, on_device, pose, wall};

/// The modem frames of a packet, without protection.
fn split(packet: &[u8], mtu: usize) -> Vec<Vec<u8>> {
    let mut sharer = Sharer::default();
    sharer.split(packet, mtu).unwrap();
    sharer.shares().map(<[u8]>::to_vec).collect()
}

/// Rows that two pictures have in common from the top.
fn common_rows(a: &Picture, b: &Picture) -> u32 {
    let row = a.width as usize * 3;
    let same = a.data.chunks(row).zip(b.data.chunks(row)).take_while(|(a, b)| a == b);
    same.count() as u32
}

#[test]
fn a_frame_of_webp_that_is_lost_costs_the_rows_after_it() {
    let (engine, scene) = on_device(&wall(1));
    let options = EncoderOptions {
        rate: Some(Rate::Quality(40.0)),
        residual: ResidualCoder::Webp,
        ..EncoderOptions::default()
    };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let camera = frame(&engine, &scene, &pose(0.0));
    let encoded = encoder.encode(&camera, Some(pose(0.0))).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let mut decoded = Decoded::default();
    let mut random = Random::new(1);
    for mtu in [31, 64, 256, 1024] {
        let frames = split(&encoded.packet, mtu);
        let mut last = (f64::INFINITY, CAMERA.height);
        for lost in (1..frames.len()).rev() {
            let options = CollectorOptions { shares: frames.len(), ..CollectorOptions::new(mtu) };
            let mut collector = Collector::new(options).unwrap();
            let mut order: Vec<_> = (0..frames.len()).filter(|index| *index != lost).collect();
            order.sort_by_key(|_| random.bits());
            for index in order {
                collector.push(0.0, &frames[index]).unwrap();
            }
            let received = collector.newest(0).unwrap();
            assert!(!received.complete);
            if decoder.decode_into(received.bytes, Trust::Start, &mut decoded).is_err() {
                // At the smallest MTU the camera comes with the second frame.
                assert_eq!((mtu, lost), (31, 1));
                continue;
            }
            let (rows, shown) = (decoded.rows, &decoded.picture);
            assert!(decoded.damage.is_some() && rows <= last.1);
            assert!(common_rows(shown, &encoded.picture) >= rows, "frame {lost} of MTU {mtu}");
            let psnr = shown.psnr(&camera);
            assert!(psnr >= encoded.stats.render_psnr - 0.3 && psnr <= encoded.stats.psnr + 1e-9);
            assert!(rows > 0 || *shown == encoded.render);
            last = (psnr, rows);
            collector.push(0.0, &frames[lost]).unwrap();
            let whole = collector.newest(0).unwrap();
            assert_eq!((whole.bytes, whole.complete), (&encoded.packet[..], true));
        }
        if frames.len() > 20 {
            assert!(
                last.1 < CAMERA.height / 4,
                "a loss near the start leaves few rows: {}",
                last.1
            );
        }
    }
}

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
