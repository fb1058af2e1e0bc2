//! `nvsprior console --rtp`: what a receiver decodes is the picture.

use std::net::UdpSocket;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::{Console, vehicle};
use crate::dive::{Dive, pictures};

/// A program that ends with the test.
struct Receiver(Child);

impl Drop for Receiver {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn has(element: &str) -> bool {
    let inspect = Command::new("gst-inspect-1.0").args(["--exists", element]).status();
    inspect.is_ok_and(|status| status.success())
}

/// A free UDP port.
fn port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Writes what comes to a port to a folder, as PNG.
fn receiver(dive: &Dive, port: u16, decoder: &str) -> Receiver {
    let folder = dive.path("video");
    std::fs::create_dir(&folder).unwrap();
    let caps = "application/x-rtp,media=video,encoding-name=H264,clock-rate=90000,payload=96";
    let line = format!(
        "udpsrc port={port} caps={caps} ! rtph264depay ! {decoder} ! videoconvert \
         ! video/x-raw,format=RGB ! pngenc ! multifilesink max-files=3 location={}/%06d.png",
        folder.display()
    );
    let mut launch = Command::new("gst-launch-1.0");
    let launch = launch.arg("--quiet").args(line.split_whitespace()).stdout(Stdio::null());
    Receiver(launch.spawn().unwrap())
}

/// The last video frame that is whole.
fn last(dive: &Dive) -> Option<image::RgbImage> {
    let files = std::fs::read_dir(dive.path("video")).unwrap();
    let mut files: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    files.sort();
    files.into_iter().rev().find_map(|file| Some(image::open(file).ok()?.to_rgb8()))
}

/// Mean squared difference of the lower half of two pictures of one size: words stand in the upper one.
fn difference(a: &image::RgbImage, b: &image::RgbImage) -> f64 {
    let half = a.as_raw().len() / 2;
    let pairs = a.as_raw()[half..].iter().zip(&b.as_raw()[half..]);
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum::<f64>() / half as f64
}

#[test]
fn a_receiver_sees_the_picture_with_its_age() {
    let decoder = ["avdec_h264", "openh264dec", "vah264dec"].into_iter().find(|name| has(name));
    let sends = has("udpsink") && ["x264enc", "openh264enc", "vah264enc"].into_iter().any(has);
    let Some(decoder) = decoder.filter(|_| sends) else {
        println!("skipped: GStreamer with coder and decoder of H.264 is not here");
        return;
    };
    let dive = Dive::new();
    let port = port();
    let _receiver = receiver(&dive, port, decoder);
    let console = Console::start(&dive, &format!("--udp 127.0.0.1:0 --rtp 127.0.0.1:{port}"));
    let _vehicle = vehicle(&dive, &console.udp, "--forth-and-back");
    console.until("a residual", |state| state["picture"]["has_residual"] == true);
    let start = Instant::now();
    let mut best = f64::INFINITY;
    // Words have the top of the picture: white on black, and each video frame has another age.
    let mut tops = std::collections::BTreeSet::new();
    while !(best < 150.0 && tops.len() > 3) {
        assert!(start.elapsed() < Duration::from_secs(60), "{best}, {} ages", tops.len());
        std::thread::sleep(Duration::from_millis(50));
        let Some(seen) = last(&dive) else { continue };
        let (width, height) = (seen.width(), seen.height());
        assert_eq!((width % 4, height % 2), (0, 0));
        let filter = image::imageops::FilterType::Triangle;
        for frame in pictures() {
            let frame =
                image::RgbImage::from_raw(frame.width, frame.height, frame.data.clone()).unwrap();
            let frame = image::imageops::resize(&frame, width, height, filter);
            best = best.min(difference(&seen, &frame));
        }
        let bright = seen.enumerate_pixels().filter(|(x, y, pixel)| {
            *x < width / 2 && *y < 48 && pixel.0.iter().all(|value| *value > 200)
        });
        tops.insert(
            bright
                .map(|(x, y, _)| u64::from(y * width + x))
                .fold(7_u64, |sum, at| sum.wrapping_mul(31).wrapping_add(at)),
        );
    }
    assert_eq!(console.state()["warnings"].to_string().matches("No video").count(), 0);
}
