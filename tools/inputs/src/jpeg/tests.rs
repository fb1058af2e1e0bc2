use image::codecs::jpeg::JpegEncoder;
use image::{ColorType, ImageEncoder};
use proptest::prelude::*;

use super::*;

/// Made by Pillow: 64×48, 4:2:0, ten scans; and with restart marks.
const PROGRESSIVE: &[u8] = include_bytes!("progressive.jpg");
const RESTARTS: &[u8] = include_bytes!("restarts.jpg");

fn pattern(width: u32, height: u32) -> Vec<u8> {
    let value = |i: u32| (i.wrapping_mul(i) / 7 + i / width * 3) as u8;
    (0..3 * width * height).map(value).collect()
}

fn baseline(width: u32, height: u32, quality: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    encoder.write_image(&pattern(width, height), width, height, ColorType::Rgb8.into()).unwrap();
    bytes
}

#[test]
fn whole_pictures_are_whole_whatever_stands_behind_them() {
    let all = [(64, 48, 90), (17, 9, 50), (1, 1, 30)].map(|(w, h, q)| baseline(w, h, q));
    for bytes in all.iter().map(Vec::as_slice).chain([PROGRESSIVE, RESTARTS]) {
        assert_eq!(check(bytes), Ok(()));
        assert_eq!(check(&bytes[..bytes.len() - 2]), Ok(()), "without its end mark");
        assert_eq!(check(&[bytes, &[0; 30], b"a preview"].concat()), Ok(()));
    }
}

#[test]
fn cut_ones_are_told_wherever_they_are_cut_and_with_an_end_mark_too() {
    for bytes in [&baseline(64, 48, 90)[..], PROGRESSIVE, RESTARTS] {
        for len in 0..bytes.len() - 4 {
            assert!(check(&bytes[..len]).is_err(), "{len} of {}", bytes.len());
            assert!(
                check(&[&bytes[..len], &[0xFF, 0xD9]].concat()).is_err(),
                "{len}, with an end mark"
            );
        }
    }
}

#[test]
fn a_progressive_one_without_its_last_scans_is_told() {
    let scans: Vec<usize> =
        (0..PROGRESSIVE.len() - 1).filter(|at| PROGRESSIVE[*at..*at + 2] == [0xFF, SOS]).collect();
    assert!(scans.len() > 5, "{scans:?}");
    let third = [&PROGRESSIVE[..scans[scans.len() / 3]], &[0xFF, EOI]].concat();
    assert_eq!(check(&third), Err(JpegError::Scans));
}

/// A sector of a disk that was never written, in the midst of the data. Now and then the codes meet again, and as many
/// blocks come out: that cannot be told from another picture.
#[test]
fn holes_are_told() {
    let bytes = baseline(320, 180, 90);
    let data = bytes.windows(2).position(|pair| pair == [0xFF, SOS]).unwrap() + 20;
    let holes = (data..bytes.len() - 600).step_by(100);
    let told = |hole: usize| {
        let mut broken = bytes.clone();
        broken[hole..hole + 512].fill(0);
        check(&broken).is_err()
    };
    let (all, told) = (holes.clone().count(), holes.filter(|hole| told(*hole)).count());
    assert!(told * 20 >= all * 19, "{told} of {all}");
}

#[test]
fn a_frame_that_promises_more_than_the_file_has_takes_no_memory() {
    let mut bytes = PROGRESSIVE.to_vec();
    let at = bytes.windows(2).position(|pair| pair == [0xFF, SOF2]).unwrap() + 5;
    bytes[at..at + 4].fill(0xFF);
    assert!(matches!(check(&bytes), Err(JpegError::Cut { .. })));
}

proptest! {
    #[test]
    fn no_bytes_do_harm(at in 0..PROGRESSIVE.len(), value: u8, len in 0..PROGRESSIVE.len()) {
        let mut bytes = PROGRESSIVE.to_vec();
        bytes[at] = value;
        let _ = (check(&bytes), check(&bytes[..len]), check(&bytes[len..]));
    }
}
