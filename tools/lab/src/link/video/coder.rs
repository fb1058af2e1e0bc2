//! Video coders, by ffmpeg.

use std::process::Command;

use anyhow::{Context as _, ensure};
use nvsprior::Picture;

use super::Coder;
use super::unit::{self, Units};

/// Seconds within which all of a picture is refreshed.
const REFRESH: f64 = 2.0;
/// The same conversion both ways, full range.
const TO_YUV: &str = "scale=out_color_matrix=bt709:out_range=pc:flags=accurate_rnd+full_chroma_int";
const FROM_YUV: &str = "scale=in_color_matrix=bt709:in_range=pc:flags=accurate_rnd+full_chroma_int";
const RGB: [&str; 4] = ["-f", "rawvideo", "-pix_fmt", "rgb24"];
const QUIET: [&str; 3] = ["-v", "error", "-y"];

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
        let list = run(&["-v", "error", "-encoders"])?;
        let listed = String::from_utf8_lossy(&list).contains(self.encoder());
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
        let bytes: Vec<u8> = frames.iter().flat_map(|frame| &frame.data).copied().collect();
        std::fs::write(&raw, bytes).with_context(|| format!("writing {raw}"))?;
        let rate = fps / divisor as f64;
        let (pixels, rate_text) = (format!("{}x{}", size.0, size.1), rate.to_string());
        let (crf_text, options) =
            (crf.to_string(), coder.options(((REFRESH * rate) as usize).max(2)));
        let from = ["-s", &pixels, "-r", &rate_text, "-i", &raw, "-vf", TO_YUV];
        let how = ["-c:v", coder.encoder(), "-crf", &crf_text];
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let to = ["-f", coder.format(), &stream];
        run(&[&QUIET[..], &RGB, &from, &how, &options, &to].concat())?;
        let stream = std::fs::read(&stream).with_context(|| format!("reading {stream}"))?;
        let Units { header, pictures } = match coder {
            Coder::X265 => unit::of_hevc(&stream),
            Coder::SvtAv1 => unit::of_av1(&stream)?,
        };
        let (expected, found) = (frames.len(), pictures.len());
        ensure!(found == expected, "{}: {found} pictures coded of {expected}", coder.name());
        Ok(Coded { coder, divisor, crf, size, header, units: pictures })
    }

    /// The pictures that a decoder makes of those that arrived, in order. One without what it leans on looks damaged.
    pub fn decode(&self, arrived: &[bool]) -> anyhow::Result<Vec<Picture>> {
        let folder = tempfile::tempdir()?;
        let file = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
        let (coded, shown) = (file("stream"), file("out.rgb"));
        let units = self.units.iter().zip(arrived).filter(|(_, arrived)| **arrived);
        let units = units.map(|(unit, _)| unit.as_slice());
        let stream = match self.coder {
            Coder::X265 => {
                [&[self.header.as_slice()][..], &units.collect::<Vec<_>>()].concat().concat()
            }
            Coder::SvtAv1 => unit::to_av1(&self.header, units),
        };
        std::fs::write(&coded, stream).with_context(|| format!("writing {coded}"))?;
        let from =
            ["-fflags", "+genpts", "-flags", "+output_corrupt+low_delay", "-flags2", "showall"];
        let input =
            ["-f", self.coder.format(), "-i", &coded, "-vsync", "passthrough", "-vf", FROM_YUV];
        run(&[&["-v", "fatal", "-y"][..], &from, &input, &RGB, &[&shown]].concat())?;
        let data = std::fs::read(&shown).with_context(|| format!("reading {shown}"))?;
        let (width, height) = self.size;
        let pictures = data.chunks_exact(width as usize * height as usize * 3);
        let pictures = pictures.filter_map(|rgb| Picture::from_rgb(width, height, rgb.to_vec()));
        let pictures: Vec<_> = pictures.collect();
        let expected = arrived.iter().filter(|arrived| **arrived).count();
        let found = pictures.len();
        ensure!(found == expected, "{}: {found} pictures decoded of {expected}", self.coder.name());
        Ok(pictures)
    }
}

/// Runs ffmpeg; an error has what it said.
fn run(arguments: &[&str]) -> anyhow::Result<Vec<u8>> {
    let output = Command::new("ffmpeg").args(arguments).output().context("running ffmpeg")?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "ffmpeg {}: {said}", arguments.join(" "));
    Ok(output.stdout)
}
