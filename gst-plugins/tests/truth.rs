//! What the elements tell of how far pictures are from what the camera saw.

#[path = "../../tests/common/mod.rs"]
mod common;
mod fixture;
#[path = "../../tests/scene/mod.rs"]
mod scene;

use fixture::{Fixture, Pipeline, fixture};
use gst_video::VideoRegionOfInterestMeta;
use nvsprior::truth::{BLOCK, TruthLevel};
use nvsprior::{Decoded, Decoder, Picture, Trust};
use scene::{CAMERA, wall};

const NAMES: [(&str, TruthLevel); 3] = [
    ("nvsp-differs", TruthLevel::Differs),
    ("nvsp-wrong", TruthLevel::Wrong),
    ("nvsp-not-seen", TruthLevel::NotSeen),
];

/// Frames with something that the prior does not show.
fn frames() -> Vec<Picture> {
    let mut frames = fixture().frames[..4].to_vec();
    for frame in &mut frames {
        for y in 40..75 {
            let row = 3 * (y * CAMERA.width as usize + 30);
            frame.data[row..row + 3 * 40].iter_mut().for_each(|value| *value = 255 - *value);
        }
    }
    frames
}

/// Packets by the element, and what the library makes of them, each whole or the start of it.
fn packets(properties: &str, share: usize) -> (Vec<Vec<u8>>, Vec<Decoded>) {
    let encoder = fixture().encoder(properties);
    let given = Pipeline::new(&format!("{} ! {encoder}", Fixture::source())).run(&frames());
    let cut = |packet: Vec<u8>| packet[..packet.len() * share / 100].to_vec();
    let packets: Vec<_> = given.bytes().into_iter().map(cut).collect();
    let engine = common::engine();
    let scene = engine.upload(&wall(1)).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let decode = |packet: &Vec<u8>| {
        let mut decoded = Decoded::default();
        decoder.decode_into(packet, Trust::Start, &mut decoded).unwrap();
        decoded
    };
    let decoded = packets.iter().map(decode).collect();
    (packets, decoded)
}

/// What a decoder with these properties shows.
fn show(packets: &[Vec<u8>], properties: &str) -> (fixture::Given, Vec<gst::Structure>) {
    let source = "appsrc name=source format=time caps=video/x-nvsprior,trust=start";
    let pipeline = Pipeline::new(&format!("{source} ! {} {properties}", fixture().decoder()));
    pipeline.play();
    packets.iter().enumerate().for_each(|(index, packet)| pipeline.push(index, packet));
    pipeline.end();
    let shown = pipeline.drain();
    assert_eq!(shown.buffers.len(), packets.len());
    (shown, pipeline.element_messages())
}

/// Each region holds blocks of its level, and all such blocks lie in one, unless there are too many regions.
fn check_regions(buffer: &gst::Buffer, decoded: &Decoded) -> usize {
    let regions: Vec<_> = buffer.iter_meta::<VideoRegionOfInterestMeta>().collect();
    let map = &decoded.truth;
    let blocks = |level: TruthLevel| {
        let of_level = map.levels.iter().enumerate().filter(move |(_, of)| **of == level as u8);
        of_level.map(|(at, _)| (at as u32 % map.columns * BLOCK, at as u32 / map.columns * BLOCK))
    };
    assert!(regions.len() <= 16);
    for region in &regions {
        let (x, y, width, height) = region.rect();
        let (_, level) = NAMES.iter().find(|(name, _)| *name == region.roi_type()).unwrap();
        let within = |(left, top): &(u32, u32)| {
            (x..x + width).contains(left) && (y..y + height).contains(top)
        };
        assert!(blocks(*level).any(|block| within(&block)), "{:?}", region.rect());
        assert!(x + width <= CAMERA.width && y + height <= CAMERA.height);
    }
    for (name, level) in NAMES {
        let covered = |(left, top): &(u32, u32)| {
            regions.iter().filter(|region| region.roi_type() == name).any(|region| {
                let (x, y, width, height) = region.rect();
                (x..x + width).contains(left) && (y..y + height).contains(top)
            })
        };
        assert!(regions.len() == 16 || blocks(level).all(|block| covered(&block)), "{name}");
    }
    regions.len()
}

#[test]
fn regions_and_messages_are_the_librarys_map() {
    let (mut regions, mut off) = (0, 0);
    for share in [100, 70] {
        let (packets, expected) = packets("rate=bytes bytes=120", share);
        let (shown, messages) = show(&packets, "truth-messages=true");
        assert_eq!(messages.len(), packets.len());
        for ((buffer, message), decoded) in shown.buffers.iter().zip(&messages).zip(&expected) {
            regions += check_regions(buffer, decoded);
            let map = &decoded.truth;
            assert_eq!(message.name(), "nvspdec-truth");
            assert_eq!(message.get::<u32>("frame"), Ok(decoded.frame));
            assert_eq!(message.get::<u32>("columns"), Ok(map.columns));
            assert_eq!(message.get::<u32>("rows"), Ok(map.rows));
            assert_eq!(message.get::<u32>("block"), Ok(BLOCK));
            let levels = message.get::<gst::glib::Bytes>("levels").unwrap();
            assert_eq!(levels[..], map.levels[..]);
            let names = ["as-seen", "differs", "wrong", "not-seen"];
            let shares = names.map(|name| message.get::<f64>(name).unwrap());
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{shares:?}");
            let wrong = map.count(TruthLevel::Wrong) as f64 / map.levels.len() as f64;
            assert_eq!(shares[2], wrong);
            let thresholds = map.thresholds.map(|of| of.map(f64::from));
            let told = ["differs-above", "wrong-above"].map(|name| message.get::<f64>(name).ok());
            assert_eq!(told, [thresholds.map(|of| of[0]), thresholds.map(|of| of[1])]);
            off += map.count(TruthLevel::Differs) + map.count(TruthLevel::Wrong);
        }
        assert!(shown.bytes().iter().zip(&expected).all(|(shown, of)| *shown == of.picture.data));
    }
    assert!(regions > 4 && off > 4, "{regions} regions, {off} blocks");
}

#[test]
fn the_overlay_is_the_librarys() {
    let (packets, mut expected) = packets("rate=bytes bytes=120", 100);
    let (shown, messages) = show(&packets, "overlay=true");
    assert!(messages.is_empty(), "nobody asked for any");
    for (shown, decoded) in shown.bytes().iter().zip(&mut expected) {
        let plain = decoded.picture.clone();
        decoded.truth.draw_over(&mut decoded.picture);
        assert!(decoded.picture != plain && *shown == decoded.picture.data);
    }
}

#[test]
fn without_maps_nothing_is_seen() {
    let (packets, expected) = packets("rate=bytes bytes=120 truth=false", 100);
    let (shown, messages) = show(&packets, "truth-messages=true");
    for ((buffer, message), decoded) in shown.buffers.iter().zip(&messages).zip(&expected) {
        assert_eq!(check_regions(buffer, decoded), 1);
        let region = buffer.meta::<VideoRegionOfInterestMeta>().unwrap();
        assert_eq!((region.roi_type(), region.rect()), ("nvsp-not-seen", (0, 0, 160, 90)));
        assert_eq!(message.get::<f64>("not-seen"), Ok(1.0));
        assert!(!message.has_field("differs-above"));
    }
}

/// A topside tells it as a decoder does.
#[test]
fn a_topside_marks_pictures_too() {
    let topside = "truth-messages=true post-messages=true";
    let pipeline = fixture().link("bit-rate=8000 loss=0", topside);
    let shown = pipeline.run(&frames());
    let messages = pipeline.element_messages();
    let of = |name: &str| messages.iter().filter(|of| of.name() == name).count();
    assert_eq!((of("nvsptopside-truth"), of("nvsptopside-frame")), (4, 4));
    let regions =
        shown.buffers.iter().map(|of| of.iter_meta::<VideoRegionOfInterestMeta>().count());
    assert!(regions.sum::<usize>() > 0);
    let drawn_over = fixture().link("bit-rate=8000 loss=0", "overlay=true").run(&frames());
    assert!(drawn_over.bytes() != shown.bytes());
}
