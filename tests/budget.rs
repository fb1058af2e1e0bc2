//! What a frame may take: renders, and time by a clock. Packets decode to the same whatever ended the search.

mod common;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use common::{assert_silent, engine, random_prior};
use nvsprior::prior::{Extras, KeyFrames};
use nvsprior::render::{Plan, Scene};
use nvsprior::tracking::{Clock, StartKind};
use nvsprior::{
    Camera, Decoder, Encoded, Encoder, EncoderOptions, Error, ErrorKind, Picture, Pose,
};

const CAMERA: Camera = Camera { width: 160, height: 96, fx: 140.0, fy: 140.0, cx: 80.0, cy: 48.0 };
/// Key frames; the last one is the dive's place.
const KEY_FRAMES: usize = 40;

fn scene() -> Arc<Scene> {
    static SCENE: OnceLock<Arc<Scene>> = OnceLock::new();
    let made = || {
        let aside =
            |i: usize| Pose::exp(&[0.0, 0.0, 0.0, 0.0, 0.15 * (KEY_FRAMES - i) as f64, 0.0]);
        let key_frames = KeyFrames::new((1..=KEY_FRAMES).map(aside).collect()).unwrap();
        let extras = Extras { key_frames, ..Extras::default() };
        let prior = random_prior(11, 3_000, 1).with_extras(extras).unwrap();
        engine().upload(&prior).unwrap()
    };
    SCENE.get_or_init(made).clone()
}

/// The camera's pose at a frame.
fn pose(frame: usize) -> Pose {
    let t = frame as f64;
    Pose::exp(&[0.02 * t, 0.01 * t, 0.0, 0.0, 0.004 * t, 0.002 * t])
}

/// What it sees.
fn view(frame: usize) -> Picture {
    let mut renderer = engine().renderer(&scene(), &CAMERA, Plan::picture()).unwrap();
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    renderer.picture(&pose(frame), &mut picture).unwrap();
    let noise = |i: usize| ((i as u32).wrapping_mul(2_654_435_761) >> 28) as u8;
    picture.data.iter_mut().enumerate().for_each(|(i, v)| *v = v.saturating_add(noise(i)));
    picture
}

fn dark() -> Picture {
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    let noise = |i: usize| (i as u32).wrapping_mul(2_654_435_761) >> 31;
    picture.data.iter_mut().enumerate().for_each(|(i, value)| *value = noise(i) as u8);
    picture
}

/// Light frames, two dark ones among them.
fn dive() -> Vec<Picture> {
    (0..8).map(|frame| if frame == 3 || frame == 4 { dark() } else { view(frame) }).collect()
}

fn encoder(options: EncoderOptions) -> Encoder {
    Encoder::new(&engine(), &scene(), &CAMERA, options).unwrap()
}

fn bounded(lost_renders: u32) -> EncoderOptions {
    let mut options = EncoderOptions::default();
    options.refine.lost_renders = lost_renders;
    options
}

/// Encodes the dive, whose first frame has its pose with it. Each packet decodes to the encoder's picture.
fn encode(encoder: &mut Encoder) -> Vec<Encoded> {
    let mut decoder = Decoder::new(&engine(), &scene());
    let encode = |(frame, picture): (usize, &Picture)| {
        let encoded = encoder.encode(picture, (frame == 0).then(|| pose(0))).unwrap();
        let decoded = decoder.decode(&encoded.packet).unwrap();
        assert_eq!(decoded.picture, encoded.picture, "frame {frame}");
        encoded
    };
    dive().iter().enumerate().map(encode).collect()
}

fn renders(encoded: &Encoded) -> u32 {
    encoded.stats.renders.iter().sum()
}

/// A clock that goes on by a millisecond each time that it is read.
fn stepping() -> (Clock, Arc<AtomicU64>) {
    let time = Arc::new(AtomicU64::new(0));
    let read = time.clone();
    let now = move || Duration::from_millis(read.fetch_add(1, Ordering::Relaxed));
    (Clock::new(now), time)
}

#[test]
fn a_dark_frame_takes_no_more_renders_than_allowed() {
    /// Most of a frame's first search: `GaussNewtonOptions::warm`, and again if it does not keep its promise.
    const FIRST: u32 = 2 * 24;
    let free = encode(&mut encoder(bounded(96)));
    for lost_renders in [1, 2, 4, 12, 30] {
        let encoded = encode(&mut encoder(bounded(lost_renders)));
        for (frame, (one, free)) in encoded.iter().zip(&free).enumerate() {
            let is_dark = frame == 3 || frame == 4;
            assert_eq!(one.stats.certain, !is_dark, "frame {frame} with {lost_renders}");
            assert!(renders(one) <= FIRST + lost_renders, "{:?}", one.stats);
            assert!(!one.stats.out_of_time);
            if is_dark {
                assert!(renders(one) <= renders(free), "{} {}", renders(one), renders(free));
            } else {
                assert!(one.stats.render_psnr > free.stats.render_psnr - 0.1, "frame {frame}");
            }
        }
    }
    assert_silent(&engine());
}

#[test]
fn each_render_more_that_is_allowed_is_one_more_at_most() {
    let taken = [2, 3, 4, 6, 8, 16].map(|lost_renders| {
        let encoded = encode(&mut encoder(bounded(lost_renders)));
        (lost_renders, renders(&encoded[3]))
    });
    let (least, first) = taken[0];
    for (lost_renders, renders) in taken {
        assert!(renders <= first + lost_renders - least + least, "{taken:?}");
    }
}

#[test]
fn without_a_frame_time_packets_are_as_ever() {
    let plain = encode(&mut encoder(EncoderOptions::default()));
    let (clock, time) = stepping();
    let options = EncoderOptions { clock, ..EncoderOptions::default() };
    let other = encode(&mut encoder(options));
    assert_eq!(time.load(Ordering::Relaxed), 0, "nobody asks what time it is");
    // With time to spare, too, as measuring leaves no trace.
    let frame_time = Some(Duration::from_secs(3_600));
    let timed = encode(&mut encoder(EncoderOptions { frame_time, ..EncoderOptions::default() }));
    for ((plain, other), timed) in plain.iter().zip(&other).zip(&timed) {
        assert_eq!(plain.packet, other.packet);
        assert_eq!(plain.packet, timed.packet);
        assert!(!timed.stats.out_of_time);
    }
}

#[test]
fn a_frame_whose_time_is_up_is_sent_and_the_search_goes_on() {
    for milliseconds in [4, 6, 10, 20, 60] {
        let (clock, _) = stepping();
        let frame_time = Some(Duration::from_millis(milliseconds));
        let mut encoder =
            encoder(EncoderOptions { frame_time, clock, ..EncoderOptions::default() });
        let encoded = encode(&mut encoder);
        let ended = encoded.iter().filter(|encoded| encoded.stats.out_of_time).count();
        assert!(milliseconds > 20 || ended > 0, "{milliseconds} ms");
        for (frame, one) in encoded.iter().enumerate() {
            let off = (one.pose.centre() - pose(frame).centre()).length();
            assert!(!one.stats.certain || off < 0.02, "{milliseconds} ms, frame {frame}: {off}");
        }
        // Its time is enough for what follows.
        if milliseconds >= 20 {
            assert!(encoded[7].stats.certain, "{milliseconds} ms");
        }
    }
}

#[test]
fn a_time_too_short_for_a_render_and_a_coding_is_refused() {
    let (clock, _) = stepping();
    let frame_time = Some(Duration::from_millis(1));
    let options = EncoderOptions { frame_time, clock, ..EncoderOptions::default() };
    let error = Encoder::new(&engine(), &scene(), &CAMERA, options).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Argument);
    // By this clock a search of two renders takes one reading, and so does a coding.
    assert!(matches!(error, Error::FrameTimeShort { most: 1.0, least: 1.5 }), "{error}");
    let (clock, _) = stepping();
    let frame_time = Some(Duration::from_millis(2));
    let mut least = encoder(EncoderOptions { frame_time, clock, ..EncoderOptions::default() });
    for encoded in encode(&mut least) {
        assert_eq!(renders(&encoded), 1, "the picture that is sent");
        assert!(encoded.stats.out_of_time && !encoded.stats.certain);
    }
}

#[test]
fn a_first_frame_is_found_although_key_frames_are_not_rendered() {
    let lost = |lost_renders| encoder(bounded(lost_renders));
    let mut prepared = lost(96);
    assert_eq!(prepared.prepare(KEY_FRAMES).unwrap(), 0);
    let wanted = prepared.encode(&view(0), None::<Pose>).unwrap().stats;
    assert!(wanted.certain && wanted.start == StartKind::KeyFrame, "{wanted:?}");
    // With fewer renders it takes more frames. What is rendered is kept, and no frame is certain and wrong.
    for (lost_renders, most) in [(96, 1), (30, 4), (12, 10)] {
        let mut encoder = lost(lost_renders);
        let (mut left, mut frames) = (KEY_FRAMES, 0);
        loop {
            let stats = encoder.encode(&view(0), None::<Pose>).unwrap().stats;
            frames += 1;
            if stats.certain {
                assert!(stats.render_psnr > wanted.render_psnr - 0.3, "{stats:?}");
                break;
            }
            assert!(frames < most, "{lost_renders} renders: lost after {frames} frames");
            let now = encoder.prepare(0).unwrap();
            assert!(now <= left);
            left = now;
        }
    }
}
