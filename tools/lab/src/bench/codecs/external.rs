//! Coders that are programs of their own.

use std::path::Path;

use anyhow::Context as _;
use nvsprior::Picture;
use nvsprior_inputs::frame_file;

use super::{CodedRun, Input, Mode, Point, Run};
use crate::bench::forward::timed;
use nvsprior_inputs::ffmpeg::{self, FROM_YUV, QUIET, RGB, TO_YUV, run_program};

/// A coder, by its programs.
pub struct External {
    name: &'static str,
    kind: Kind,
    modes: &'static [Mode],
    /// Quality settings, best first.
    qualities: &'static [f64],
}

/// How its programs are run.
enum Kind {
    /// An encoder of ffmpeg, all pictures in one file.
    Ffmpeg(Ffmpeg),
    /// libjxl's programs, one file per picture.
    JpegXl,
}

/// An encoder of ffmpeg. All encoders are set to aim at PSNR, the measure here.
struct Ffmpeg {
    encoder: &'static str,
    stream: Stream,
    pixels: &'static str,
    /// The options that set its quality.
    quality: &'static [&'static str],
    options: &'static [&'static str],
    intra: &'static [&'static str],
    low_delay: &'static [&'static str],
}

struct Stream {
    /// Its format's name in ffmpeg.
    format: &'static str,
    /// Types of the units that say nothing about a picture, or the same about all pictures: parameter sets, delimiters,
    /// SEI.
    headers: &'static str,
    /// Whether units begin with start codes.
    start_codes: bool,
}

const H264: Stream = Stream { format: "h264", headers: "6-9", start_codes: true };
const HEVC: Stream = Stream { format: "hevc", headers: "32-40", start_codes: true };
const AV1: Stream = Stream { format: "obu", headers: "1|2|5|15", start_codes: false };
const VVC: Stream = Stream { format: "vvc", headers: "12-16|20-24", start_codes: true };

const BOTH: &[Mode] = &[Mode::Intra, Mode::Stream];

pub fn all() -> Vec<External> {
    vec![jpeg_xl("jpeg-xl"), x264(), x265(), libaom(), svt_av1(), vvenc()]
}

/// JPEG XL, under a name.
pub fn jpeg_xl(name: &'static str) -> External {
    let qualities = &[1.0, 2.0, 3.0, 4.0, 8.0, 15.0, 25.0];
    External { name, kind: Kind::JpegXl, modes: &[Mode::Intra], qualities }
}

fn x264() -> External {
    let kind = Ffmpeg {
        encoder: "libx264",
        stream: H264,
        pixels: "yuv444p",
        quality: &["-crf"],
        options: &["-preset", "veryslow", "-bf", "0", "-threads", "1"],
        intra: &["-g", "1", "-tune", "psnr"],
        low_delay: &["-g", "9999", "-tune", "psnr,zerolatency"],
    };
    let qualities = &[18.0, 22.0, 26.0, 29.0, 32.0, 36.0, 43.0];
    External { name: "x264", kind: Kind::Ffmpeg(kind), modes: BOTH, qualities }
}

fn x265() -> External {
    let kind = Ffmpeg {
        encoder: "libx265",
        stream: HEVC,
        pixels: "yuv444p",
        quality: &["-crf"],
        options: &["-preset", "placebo", "-bf", "0", "-tune", "psnr"],
        intra: &["-x265-params", "log-level=error:keyint=1"],
        low_delay: &["-x265-params", "log-level=error:keyint=9999:rc-lookahead=0"],
    };
    let qualities = &[18.0, 22.0, 26.0, 29.0, 32.0, 36.0, 43.0];
    External { name: "x265", kind: Kind::Ffmpeg(kind), modes: BOTH, qualities }
}

/// AV1 as in AVIF, picture by picture, and as a stream.
fn libaom() -> External {
    let kind = Ffmpeg {
        encoder: "libaom-av1",
        stream: AV1,
        pixels: "yuv444p",
        // Without bounds, its streams come out far finer than asked for.
        quality: &["-crf", "-qmin", "-qmax"],
        options: &["-cpu-used", "0", "-b:v", "0"],
        intra: &["-usage", "allintra"],
        low_delay: &["-g", "9999", "-lag-in-frames", "0"],
    };
    let qualities = &[20.0, 27.0, 32.0, 37.0, 42.0, 52.0, 63.0];
    External { name: "libaom", kind: Kind::Ffmpeg(kind), modes: BOTH, qualities }
}

fn svt_av1() -> External {
    let kind = Ffmpeg {
        encoder: "libsvtav1",
        stream: AV1,
        pixels: "yuv420p",
        quality: &["-crf"],
        options: &["-preset", "4"],
        // By `-g 1` alone, newer versions force key frames within a long group.
        intra: &["-g", "1", "-svtav1-params", "keyint=1"],
        low_delay: &["-g", "9999", "-svtav1-params", "pred-struct=1"],
    };
    let qualities = &[20.0, 27.0, 32.0, 37.0, 42.0, 52.0, 63.0];
    External { name: "svt-av1", kind: Kind::Ffmpeg(kind), modes: BOTH, qualities }
}

fn vvenc() -> External {
    let kind = Ffmpeg {
        encoder: "libvvenc",
        stream: VVC,
        pixels: "yuv420p10le",
        quality: &["-qp"],
        options: &["-preset", "slower", "-qpa", "0"],
        intra: &["-g", "1"],
        low_delay: &["-period", "9999", "-vvenc-params", "PicReordering=0"],
    };
    let qualities = &[24.0, 29.0, 34.0, 39.0, 44.0, 49.0, 56.0];
    External { name: "vvenc", kind: Kind::Ffmpeg(kind), modes: BOTH, qualities }
}

impl External {
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// As a coder of single pictures.
    pub fn only_intra(self) -> External {
        External { modes: &[Mode::Intra], ..self }
    }

    /// How many points it gives for a kind of input.
    pub fn settings(&self) -> usize {
        self.modes.len() * self.qualities.len()
    }

    /// Whether its programs can be run.
    pub fn is_installed(&self) -> bool {
        match &self.kind {
            Kind::JpegXl => {
                let is_there = |program| run_program(program, &["--version"]).is_ok();
                is_there("cjxl") && is_there("djxl")
            }
            Kind::Ffmpeg(Ffmpeg { encoder, .. }) => ffmpeg::has_encoder(encoder),
        }
    }

    pub fn needs(&self) -> String {
        match &self.kind {
            Kind::JpegXl => "cjxl and djxl (Debian: libjxl-tools)".into(),
            Kind::Ffmpeg(Ffmpeg { encoder, .. }) => format!("ffmpeg with {encoder}"),
        }
    }

    /// Codes the run at each setting.
    pub fn measure(&self, run: &Run, input: Input, done: impl Fn()) -> anyhow::Result<Vec<Point>> {
        let mut points = Vec::new();
        for &mode in self.modes {
            for &quality in self.qualities {
                let outcome = self.code(run, input, mode, quality)?;
                points.push(run.point(self.name, input, mode, &outcome));
                done();
            }
        }
        Ok(points)
    }

    /// Codes the run at a quality setting.
    pub fn code(
        &self,
        run: &Run,
        input: Input,
        mode: Mode,
        quality: f64,
    ) -> anyhow::Result<CodedRun> {
        let (folder, pictures) = (tempfile::tempdir()?, run.pictures(input));
        let coded = match &self.kind {
            Kind::JpegXl => code_jpeg_xl(pictures, quality, folder.path()),
            Kind::Ffmpeg(coder) => coder.code(pictures, mode, quality, folder.path()),
        };
        let mut outcome = coded.with_context(|| format!("{} at {quality}", self.name))?;
        let decoded = outcome.shown.iter().enumerate();
        outcome.shown = decoded.map(|(index, p)| run.show(input, index, p)).collect();
        Ok(outcome)
    }
}

impl Ffmpeg {
    fn code(
        &self,
        pictures: &[Picture],
        mode: Mode,
        quality: f64,
        folder: &Path,
    ) -> anyhow::Result<CodedRun> {
        let (width, height) = (pictures[0].width, pictures[0].height);
        let file = |name: &str| folder.join(name).to_string_lossy().into_owned();
        let (raw, coded, bare, shown) =
            (file("in.rgb"), file("coded"), file("bare"), file("out.rgb"));
        ffmpeg::write_raw(Path::new(&raw), pictures)?;
        let (size, quality_text) = (format!("{width}x{height}"), quality.to_string());
        let from = [&QUIET[..], &RGB, &["-s", &size, "-r", "15", "-i", &raw]].concat();
        let how = ["-vf", TO_YUV, "-c:v", self.encoder];
        let quality_options: Vec<&str> =
            self.quality.iter().flat_map(|option| [*option, &quality_text]).collect();
        let of_mode = if mode == Mode::Intra { self.intra } else { self.low_delay };
        let format = ["-pix_fmt", self.pixels, "-f", self.stream.format, &coded];
        let arguments =
            [&from[..], &how, &quality_options, self.options, of_mode, &format].concat();
        let mut outcome = CodedRun::new(quality);
        (_, outcome.encode_ms) = timed(|| ffmpeg::run(&arguments))?;
        let to = ["-f", self.stream.format, "-i", &coded, "-vf", FROM_YUV];
        let arguments = [&QUIET[..], &to, &RGB, &[&shown]].concat();
        (_, outcome.decode_ms) = timed(|| ffmpeg::run(&arguments))?;
        outcome.bytes = self.stream.payload(&coded, &bare)?;
        outcome.shown = ffmpeg::read_raw(Path::new(&shown), width, height)?;
        let (expected, found) = (pictures.len(), outcome.shown.len());
        anyhow::ensure!(expected == found, "{found} pictures decoded of {expected}");
        Ok(outcome)
    }
}

impl Stream {
    /// Bytes of a file that are about single pictures: a vehicle and a topside would agree on the rest in advance.
    /// `bare`: a file for these bytes.
    fn payload(&self, coded: &str, bare: &str) -> anyhow::Result<usize> {
        let filter = format!("filter_units=remove_types={}", self.headers);
        let from = ["-f", self.format, "-i", coded, "-c", "copy", "-bsf:v", &filter];
        ffmpeg::run(&[&QUIET[..], &from, &["-f", self.format, bare]].concat())?;
        let bytes = std::fs::read(bare)?;
        let start_codes = ffmpeg::start_codes(&bytes).map(|(_, length)| length);
        Ok(bytes.len() - if self.start_codes { start_codes.sum() } else { 0 })
    }
}

fn code_jpeg_xl(pictures: &[Picture], distance: f64, folder: &Path) -> anyhow::Result<CodedRun> {
    let file = |name: &str| folder.join(name);
    let text = |name: &str| file(name).to_string_lossy().into_owned();
    let (raw, coded, shown) = (text("in.png"), text("coded.jxl"), text("out.png"));
    let mut outcome = CodedRun::new(distance);
    let distance = distance.to_string();
    for picture in pictures {
        nvsprior_runs::write_png(&file("in.png"), picture)?;
        let arguments = [raw.as_str(), &coded, "-d", &distance, "-e", "9", "--quiet"];
        let (_, ms) = timed(|| run_program("cjxl", &arguments))?;
        outcome.encode_ms += ms;
        outcome.bytes += std::fs::metadata(&coded)?.len() as usize;
        let (_, ms) = timed(|| run_program("djxl", &[&coded, &shown, "--quiet"]))?;
        outcome.decode_ms += ms;
        let decoded = frame_file::read_frame(&file("out.png"), picture.width, picture.height)?;
        outcome.shown.push(decoded);
    }
    Ok(outcome)
}
