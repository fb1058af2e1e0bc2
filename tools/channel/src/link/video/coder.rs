//! Video coders, by ffmpeg.

use std::path::Path;

use anyhow::{Context as _, ensure};
use clap::ValueEnum;
use nvsprior::Picture;
use serde::Serialize;

use super::unit::{self, Units};
use nvsprior_inputs::ffmpeg::{self, FROM_YUV, QUIET, RGB, TO_YUV};

/// Seconds within which all of a picture is refreshed.
const REFRESH: f64 = 2.0;

/// Video coders that can be compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Coder {
    /// HEVC, gradual intra refresh
    X265,
    /// AV1, a key frame every two seconds
    SvtAv1,
}

impl Coder {
    pub fn name(self) -> &'static str {
        match self {
            Coder::X265 => "x265",
            Coder::SvtAv1 => "svt-av1",
        }
    }

    /// Its qualities (CRF), best first.
    pub fn qualities(self) -> &'static [u32] {
        match self {
            Coder::X265 => &[22, 26, 30, 34, 38, 42, 46, 51],
            Coder::SvtAv1 => &[27, 34, 40, 46, 52, 58, 63],
        }
    }

    fn encoder(self) -> &'static str {
        match self {
            Coder::X265 => "libx265",
            Coder::SvtAv1 => "libsvtav1",
        }
    }

    /// Name of its elementary stream in ffmpeg.
    fn format(self) -> &'static str {
        match self {
            Coder::X265 => "hevc",
            Coder::SvtAv1 => "obu",
        }
    }

    fn options(self, refresh: usize) -> Vec<String> {
        let text = match self {
            Coder::X265 => format!(
                "-pix_fmt yuv420p -preset slow -bf 0 -tune psnr -x265-params \
                 log-level=error:keyint={refresh}:min-keyint={refresh}:intra-refresh=1:\
                 rc-lookahead=0:slices=1:frame-threads=1:repeat-headers=1:scenecut=0"
            ),
            Coder::SvtAv1 => {
                format!("-pix_fmt yuv420p -preset 5 -g {refresh} -svtav1-params pred-struct=1")
            }
        };
        text.split_whitespace().map(str::to_owned).collect()
    }

    /// Says what is missing, if its programs cannot be run.
    pub fn check(self) -> anyhow::Result<()> {
        let listed = ffmpeg::has_encoder(self.encoder());
        ensure!(listed, "--beside {}: needs ffmpeg with {}", self.name(), self.encoder());
        Ok(())
    }
}

/// Frames that were coded at a quality.
pub struct Coded {
    coder: Coder,
    /// Camera frames for each frame of the video.
    pub divisor: usize,
    pub crf: u32,
    size: (u32, u32),
    header: Vec<u8>,
    /// The bytes of each picture.
    pub units: Vec<Vec<u8>>,
}

impl Coded {
    pub fn new(
        coder: Coder,
        frames: &[&Picture],
        fps: f64,
        divisor: usize,
        crf: u32,
    ) -> anyhow::Result<Coded> {
        let folder = tempfile::tempdir()?;
        let file = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
        let (raw, stream) = (file("in.rgb"), file("stream"));
        let size = (frames[0].width, frames[0].height);
        ffmpeg::write_raw(Path::new(&raw), frames.iter().copied())?;
        let rate = fps / divisor as f64;
        let (pixels, rate_text) = (format!("{}x{}", size.0, size.1), rate.to_string());
        let (crf_text, options) =
            (crf.to_string(), coder.options(((REFRESH * rate) as usize).max(2)));
        let from = ["-s", &pixels, "-r", &rate_text, "-i", &raw, "-vf", TO_YUV];
        let how = ["-c:v", coder.encoder(), "-crf", &crf_text];
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let to = ["-f", coder.format(), &stream];
        ffmpeg::run(&[&QUIET[..], &RGB, &from, &how, &options, &to].concat())?;
        let stream = std::fs::read(&stream).with_context(|| format!("reading {stream}"))?;
        let Units { header, pictures } = match coder {
            Coder::X265 => unit::of_hevc(&stream),
            Coder::SvtAv1 => unit::of_av1(&stream)?,
        };
        let (expected, found) = (frames.len(), pictures.len());
        ensure!(found == expected, "{}: {found} pictures coded of {expected}", coder.name());
        Ok(Coded { coder, divisor, crf, size, header, units: pictures })
    }

    /// What a decoder makes of each picture that arrived, in order. One without its reference looks damaged, or is not
    /// shown at all.
    pub fn decode(&self, arrived: &[bool]) -> anyhow::Result<Vec<Option<Picture>>> {
        let folder = tempfile::tempdir()?;
        let file = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
        let (coded, shown, times) = (file("stream"), file("out.rgb"), file("times"));
        let units = self.units.iter().map(Vec::as_slice).enumerate();
        let units: Vec<_> = units.filter(|(number, _)| arrived[*number]).collect();
        let stream = match self.coder {
            Coder::X265 => {
                let units: Vec<_> = units.iter().map(|(_, unit)| *unit).collect();
                [&self.header, &*units.concat()].concat()
            }
            Coder::SvtAv1 => unit::to_ivf(&self.header, self.size, units.iter().copied()),
        };
        std::fs::write(&coded, stream).with_context(|| format!("writing {coded}"))?;
        // However many of them it cannot decode.
        let from = ["-v", "error", "-y", "-max_error_rate", "1", "-fflags", "+genpts"];
        let damaged = ["-flags", "+output_corrupt+low_delay"];
        let format = if self.coder == Coder::X265 { "hevc" } else { "ivf" };
        let input = ["-flags2", "showall", "-f", format, "-i", &coded];
        let each = ["-map", "0:v", "-fps_mode", "passthrough"];
        let pictures = ["-vf", FROM_YUV, RGB[0], RGB[1], RGB[2], RGB[3], &shown];
        let stamps = ["-c:v", "rawvideo", "-f", "mkvtimestamp_v2", &times];
        ffmpeg::run(&[&from[..], &damaged, &input, &each, &pictures, &each, &stamps].concat())?;
        let pictures = ffmpeg::read_raw(Path::new(&shown), self.size.0, self.size.1)?.into_iter();
        match self.coder {
            Coder::X265 => {
                let pictures: Vec<_> = pictures.map(Some).collect();
                let (expected, found) = (units.len(), pictures.len());
                ensure!(found == expected, "x265: {found} pictures decoded of {expected}");
                Ok(pictures)
            }
            Coder::SvtAv1 => {
                let times = std::fs::read_to_string(&times);
                let times = times.with_context(|| format!("reading {shown}'s times"))?;
                let numbers = times.lines().filter_map(|line| line.parse::<usize>().ok());
                let mut by_number: std::collections::BTreeMap<_, _> =
                    numbers.map(|time| time / unit::APART).zip(pictures).collect();
                Ok(units.iter().map(|(number, _)| by_number.remove(number)).collect())
            }
        }
    }
}
