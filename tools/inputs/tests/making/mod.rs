//! Videos for tests.

use std::path::{Path, PathBuf};
use std::process::Command;

use image::{Rgb, RgbImage};
use nvsprior_inputs::video::{Decoder, DecoderChoice, encode_video, frame_name, on_path};
use tempfile::TempDir;

/// Size of the pan's pictures.
pub const SIZE: (u32, u32) = (640, 360);
/// How far the pan's camera moves from one frame to the next, in widths of the picture.
pub const PAN: f64 = 0.03;

/// The programs that are there. Where the tests must be complete, both are.
pub fn decoders() -> Vec<Decoder> {
    let all = [Decoder::Gstreamer, Decoder::Ffmpeg];
    let (there, missing): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|decoder| on_path(decoder.program()).is_some());
    let complete = std::env::var_os("CI").is_some();
    assert!(missing.is_empty() || !complete, "not installed: {missing:?}");
    assert!(
        !there.is_empty(),
        "neither ffmpeg nor gst-launch-1.0 is installed: scripts/setup.sh test"
    );
    for decoder in missing {
        eprintln!("not tested, since it is not installed: {}", decoder.program());
    }
    there
}

pub struct Making {
    folder: TempDir,
}

impl Making {
    pub fn new() -> Making {
        Making { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// A video of these frames, at so many a second. An ending other than .mp4 is made of an MP4.
    pub fn video(&self, name: &str, frames: impl Iterator<Item = RgbImage>, rate: f64) -> PathBuf {
        let folder = tempfile::tempdir().unwrap();
        for (i, frame) in frames.enumerate() {
            frame.save(folder.path().join(frame_name(i))).unwrap();
        }
        let path = self.path(name);
        let mp4 = path.with_extension("mp4");
        encode_video(folder.path(), rate, &mp4, DecoderChoice::Auto).unwrap();
        if mp4 != path {
            self.run("ffmpeg", &["-v", "error", "-y", "-i", text(&mp4), "-c", "copy", text(&path)]);
        }
        path
    }

    /// The video with other times, by an expression of FFmpeg's filter `setpts`.
    pub fn uneven(&self, video: &Path, name: &str, times: &str) -> PathBuf {
        let path = self.path(name);
        let filter = format!("setpts='{times}'");
        let how = ["-vf", &filter, "-fps_mode", "passthrough", "-c:v", "libx264", "-crf", "10"];
        let files = ["-v", "error", "-y", "-i", text(video)];
        self.run("ffmpeg", &[&files[..], &how, &[text(&path)]].concat());
        path
    }

    /// The video in another file, as it is coded. `times`: of its packets, by an expression of FFmpeg's filter `setts`.
    pub fn remade(&self, video: &Path, name: &str, times: &str) -> PathBuf {
        let path = self.path(name);
        let filter = format!("setts=ts={times}");
        let how = ["-c", "copy", "-bsf:v", &filter, text(&path)];
        self.run("ffmpeg", &[&["-v", "error", "-y", "-i", text(video)][..], &how].concat());
        path
    }

    /// The video coded as interlaced.
    pub fn flagged(&self, video: &Path, name: &str) -> PathBuf {
        let path = self.path(name);
        let how = ["-c:v", "libx264", "-flags", "+ildct+ilme", "-x264opts", "tff=1", "-crf", "10"];
        let files = ["-v", "error", "-y", "-i", text(video), "-vf", "setfield=tff"];
        self.run("ffmpeg", &[&files[..], &how, &[text(&path)]].concat());
        path
    }

    /// The frames of a video as bare JPEGs, one after the other.
    pub fn bare(&self, video: &Path, name: &str) -> PathBuf {
        let path = self.path(name);
        let how = ["-c:v", "mjpeg", "-q:v", "2", "-f", "mjpeg", text(&path)];
        self.run("ffmpeg", &[&["-v", "error", "-y", "-i", text(video)][..], &how].concat());
        path
    }

    /// The video without frames that are predicted from later ones.
    pub fn in_order(&self, video: &Path, name: &str) -> PathBuf {
        let path = self.path(name);
        let how = ["-c:v", "libx264", "-bf", "0", "-g", "6", "-crf", "10", text(&path)];
        self.run("ffmpeg", &[&["-v", "error", "-y", "-i", text(video)][..], &how].concat());
        path
    }

    /// The video behind a track that is a single picture, larger or smaller than its own.
    pub fn covered(&self, name: &str, video: &Path, scale: &str) -> PathBuf {
        let [path, cover] = [name, "cover.mkv"].map(|name| self.path(name));
        let (quiet, how) =
            (["-v", "error", "-y"], ["-c:v", "mjpeg", "-frames:v", "1", "-vf", scale]);
        self.run("ffmpeg", &[&quiet[..], &["-i", text(video)], &how, &[text(&cover)]].concat());
        let tracks =
            ["-i", text(&cover), "-i", text(video), "-map", "0", "-map", "1", "-c", "copy"];
        self.run("ffmpeg", &[&quiet[..], &tracks, &[text(&path)]].concat());
        path
    }

    /// The video, then the same at half the size, in one stream.
    pub fn resized(&self, name: &str, video: &Path) {
        let [whole, half, list] = ["1.mkv", "2.mkv", "list.txt"].map(|file| self.path(file));
        for (scale, file) in [("scale=iw:ih", &whole), ("scale=iw/2:ih/2", &half)] {
            let how = ["-i", text(video), "-vf", scale, "-c:v", "libvpx", "-b:v", "4M"];
            self.run("ffmpeg", &[&["-v", "error", "-y"][..], &how, &[text(file)]].concat());
        }
        self.write("list.txt", b"file 1.mkv\nfile 2.mkv\n");
        let path = self.path(name);
        let how = ["-f", "concat", "-i", text(&list), "-c", "copy", text(&path)];
        self.run("ffmpeg", &[&["-v", "error", "-y"][..], &how].concat());
    }

    /// Five frames of 51 × 37 pixels, each twice as wide as high, without subsampled colours.
    pub fn odd(&self, name: &str) -> Option<PathBuf> {
        let path = self.path(name);
        let source = "testsrc=size=51x37:rate=10:duration=0.5,setsar=2";
        let how = ["-c:v", "ffv1", "-pix_fmt", "yuv444p"];
        let words = [&["-v", "error", "-y", "-f", "lavfi", "-i", source][..], &how, &[text(&path)]];
        self.run("ffmpeg", &words.concat());
        Some(path)
    }

    /// A second of a tone.
    pub fn sound(&self, name: &str) {
        let path = self.path(name);
        let tone = ["-f", "lavfi", "-i", "sine=duration=1", "-c:a", "pcm_s16le"];
        self.run("ffmpeg", &[&["-v", "error", "-y"][..], &tone, &[text(&path)]].concat());
    }

    fn run(&self, program: &str, arguments: &[&str]) {
        let output = Command::new(program).args(arguments).output().unwrap_or_else(|error| {
            panic!("{program}, which makes the tests' videos: {error}: scripts/setup.sh test")
        });
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The brightness of a test's frame.
pub fn level(index: u32) -> f64 {
    f64::from(30 + 9 * index)
}

/// A grey frame that tells its number.
pub fn shade(width: u32, height: u32, index: u32) -> RgbImage {
    RgbImage::from_pixel(width, height, Rgb([level(index) as u8; 3]))
}

/// Dark at the left, bright at the right.
pub fn halves(width: u32, height: u32) -> RgbImage {
    let half = |x| if x < width / 2 { Rgb([20; 3]) } else { Rgb([220; 3]) };
    RgbImage::from_fn(width, height, |x, _| half(x))
}

pub fn opposite(side: &str) -> &'static str {
    match side {
        "left" => "right",
        "right" => "left",
        "top" => "bottom",
        _ => "top",
    }
}

/// The video as a camera would write it that was held turned: the matrix of its track says how to show it.
pub fn rotate(video: &Path, degrees: u32) -> PathBuf {
    let mut bytes = std::fs::read(video).unwrap();
    let head = bytes.windows(4).position(|word| word == b"tkhd").unwrap();
    // Version and flags, two times, number, room, length; then two words of room, layer, group, volume, room.
    let matrix = head + 4 + 24 + 8 + 8;
    let one = 0x1_0000i32;
    let (cos, sin) = [(one, 0), (0, one), (-one, 0), (0, -one)][degrees as usize / 90];
    let values = [cos, sin, 0, -sin, cos, 0, 0, 0, 0x4000_0000];
    for (i, value) in values.into_iter().enumerate() {
        bytes[matrix + 4 * i..][..4].copy_from_slice(&value.to_be_bytes());
    }
    let path = video.with_file_name(format!("turned {degrees}.mp4"));
    std::fs::write(&path, bytes).unwrap();
    path
}

/// What a camera sees that moves along a wall. `place`: which wall.
pub fn pan(index: u32, place: u32) -> RgbImage {
    let from = (f64::from(index) * PAN * f64::from(SIZE.0)).round() as u32;
    wall((from, 0), place)
}

/// A frame of two fields: the even rows of one picture, the odd ones of another.
pub fn woven(even: &RgbImage, odd: &RgbImage) -> RgbImage {
    RgbImage::from_fn(even.width(), even.height(), |x, y| {
        *[even, odd][y as usize % 2].get_pixel(x, y)
    })
}

/// What a camera sees of a wall that is so many pixels right of its beginning, and below.
pub fn wall((from, below): (u32, u32), place: u32) -> RgbImage {
    let (width, height) = SIZE;
    let texture = |x: u32, y: u32| {
        let value = [(48, 2.0), (16, 1.5), (6, 1.0), (2, 0.5)]
            .map(|(cell, weight)| weight * smooth(x, y, cell, place));
        (value.iter().sum::<f64>() / 5.0 * 220.0 + 15.0) as u8
    };
    RgbImage::from_fn(width, height, |x, y| {
        let value = texture(x + from, y + below);
        Rgb([value, value / 2 + 60, value])
    })
}

/// Noise between the corners of cells, 0 to 1.
fn smooth(x: u32, y: u32, cell: u32, place: u32) -> f64 {
    let noise = |i: u32, j: u32| {
        let mut hash = i.wrapping_mul(0x9E37_79B1) ^ j.wrapping_mul(0x85EB_CA77);
        hash ^= cell.wrapping_mul(0xC2B2_AE3D) ^ place.wrapping_mul(0x27D4_EB2F);
        hash = (hash ^ (hash >> 15)).wrapping_mul(0x2C1B_3C6D);
        hash = (hash ^ (hash >> 12)).wrapping_mul(0x297A_2D39);
        f64::from((hash ^ (hash >> 15)) >> 8) / f64::from(1u32 << 24)
    };
    let (i, j) = (x / cell, y / cell);
    let [fx, fy] = [x % cell, y % cell].map(|rest| f64::from(rest) / f64::from(cell));
    let row = |j| noise(i, j) + fx * (noise(i + 1, j) - noise(i, j));
    row(j) + fy * (row(j + 1) - row(j))
}

pub fn blurred(picture: &RgbImage, pixels: f32) -> RgbImage {
    image::imageops::fast_blur(picture, pixels)
}
