//! Coders that are programs of their own.

use std::path::Path;
use std::process::Command;

use anyhow::Context as _;
use nvsprior::Picture;
use nvsprior_inputs::frame_file;

use super::{Input, Mode, Outcome, Point, Run, timed};

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
    Ffmpeg {
        encoder: &'static str,
        /// Format of the elementary stream.
        format: &'static str,
        pixels: &'static str,
        options: &'static [&'static str],
        intra: &'static [&'static str],
        stream: &'static [&'static str],
    },
    /// libjxl's programs, one file per picture.
    JpegXl,
}

const BOTH: &[Mode] = &[Mode::Intra, Mode::Stream];

/// All that are known.
pub fn all() -> Vec<External> {
    vec![
        External {
            name: "jpeg-xl",
            kind: Kind::JpegXl,
            modes: &[Mode::Intra],
            qualities: &[1.0, 2.0, 4.0, 8.0, 15.0, 25.0],
        },
        External {
            name: "x264",
            kind: Kind::Ffmpeg {
                encoder: "libx264",
                format: "h264",
                pixels: "yuv444p",
                options: &["-preset", "placebo", "-bf", "0"],
                intra: &["-g", "1"],
                stream: &["-g", "9999", "-tune", "zerolatency"],
            },
            modes: BOTH,
            qualities: &[18.0, 24.0, 30.0, 36.0, 42.0, 48.0],
        },
        External {
            name: "x265",
            kind: Kind::Ffmpeg {
                encoder: "libx265",
                format: "hevc",
                pixels: "yuv444p",
                options: &["-preset", "placebo", "-bf", "0"],
                intra: &["-x265-params", "log-level=error:keyint=1"],
                stream: &["-x265-params", "log-level=error:keyint=9999:rc-lookahead=0"],
            },
            modes: BOTH,
            qualities: &[18.0, 24.0, 30.0, 36.0, 42.0, 48.0],
        },
        External {
            name: "libaom",
            kind: Kind::Ffmpeg {
                encoder: "libaom-av1",
                format: "obu",
                pixels: "yuv444p",
                options: &["-cpu-used", "1", "-b:v", "0"],
                intra: &["-usage", "allintra"],
                stream: &["-g", "9999", "-lag-in-frames", "0"],
            },
            modes: BOTH,
            qualities: &[16.0, 26.0, 36.0, 46.0, 56.0, 63.0],
        },
        External {
            name: "svt-av1",
            kind: Kind::Ffmpeg {
                encoder: "libsvtav1",
                format: "obu",
                pixels: "yuv420p",
                options: &["-preset", "2"],
                intra: &["-g", "1"],
                // Its low delay is not for measuring, it says.
                stream: &[],
            },
            modes: &[Mode::Intra],
            qualities: &[16.0, 26.0, 36.0, 46.0, 56.0, 63.0],
        },
    ]
}

/// Runs a program; an error has what it said.
fn run(program: &str, arguments: &[&str]) -> anyhow::Result<Vec<u8>> {
    let output = Command::new(program).args(arguments).output();
    let output = output.with_context(|| format!("running {program}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "{program} {}: {said}", arguments.join(" "));
    Ok(output.stdout)
}

impl External {
    /// How many points it gives of a kind of input.
    pub fn settings(&self) -> usize {
        self.modes.len() * self.qualities.len()
    }

    /// Whether its programs can be run.
    pub fn is_installed(&self) -> bool {
        match self.kind {
            Kind::JpegXl => {
                run("cjxl", &["--version"]).is_ok() && run("djxl", &["--version"]).is_ok()
            }
            Kind::Ffmpeg { encoder, .. } => run("ffmpeg", &["-v", "error", "-encoders"])
                .is_ok_and(|list| String::from_utf8_lossy(&list).contains(encoder)),
        }
    }

    /// Its name, and what it needs.
    pub fn missing(&self) -> (&'static str, &'static str) {
        match self.kind {
            Kind::JpegXl => (self.name, "cjxl and djxl (Debian: libjxl-tools)"),
            Kind::Ffmpeg { .. } => (self.name, "ffmpeg with this encoder (Debian: ffmpeg)"),
        }
    }

    /// Codes the run at each setting.
    pub fn measure(&self, run: &Run, input: Input, done: impl Fn()) -> anyhow::Result<Vec<Point>> {
        let mut points = Vec::new();
        for &mode in self.modes {
            for &quality in self.qualities {
                let folder = tempfile::tempdir()?;
                let outcome = self
                    .code(run.pictures(input), mode, quality, folder.path())
                    .with_context(|| format!("{} at {quality}", self.name))?;
                points.push(run.point(self.name, input, mode, &outcome));
                done();
            }
        }
        Ok(points)
    }

    fn code(
        &self,
        pictures: &[Picture],
        mode: Mode,
        quality: f64,
        folder: &Path,
    ) -> anyhow::Result<Outcome> {
        match &self.kind {
            Kind::JpegXl => jpeg_xl(pictures, quality, folder),
            Kind::Ffmpeg { encoder, format, pixels, options, intra, stream } => {
                let of_mode = if mode == Mode::Intra { intra } else { stream };
                let options = [*options, *of_mode, &["-pix_fmt", pixels]].concat();
                ffmpeg(pictures, encoder, format, &options, quality, folder)
            }
        }
    }
}

/// The same conversion both ways, full range.
const TO_YUV: &str = "scale=out_color_matrix=bt709:out_range=pc:flags=accurate_rnd+full_chroma_int";
const FROM_YUV: &str = "scale=in_color_matrix=bt709:in_range=pc:flags=accurate_rnd+full_chroma_int";

fn ffmpeg(
    pictures: &[Picture],
    encoder: &str,
    format: &str,
    options: &[&str],
    quality: f64,
    folder: &Path,
) -> anyhow::Result<Outcome> {
    let (width, height) = (pictures[0].width, pictures[0].height);
    let file = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (raw, coded, shown) = (file("in.rgb"), file("coded"), file("out.rgb"));
    std::fs::write(
        &raw,
        pictures.iter().flat_map(|p| p.data.iter().copied()).collect::<Vec<u8>>(),
    )?;
    let (size, crf) = (format!("{width}x{height}"), quality.to_string());
    let rgb = ["-f", "rawvideo", "-pix_fmt", "rgb24"];
    let from = [&["-v", "error", "-y"], &rgb[..], &["-s", &size, "-r", "15", "-i", &raw]].concat();
    let how = ["-vf", TO_YUV, "-c:v", encoder, "-crf", &crf];
    let arguments = [&from[..], &how, options, &["-f", format, &coded]].concat();
    let (_, encode_ms) = timed(|| run("ffmpeg", &arguments))?;
    let from = ["-v", "error", "-y", "-f", format, "-i", &coded, "-vf", FROM_YUV];
    let arguments = [&from[..], &rgb, &[&shown]].concat();
    let (_, decode_ms) = timed(|| run("ffmpeg", &arguments))?;
    let bytes = std::fs::metadata(&coded)?.len() as usize;
    let data = std::fs::read(&shown)?;
    let whole = data.chunks_exact(width as usize * height as usize * 3);
    let decoded: Vec<_> =
        whole.filter_map(|rgb| Picture::from_rgb(width, height, rgb.to_vec())).collect();
    let (expected, found) = (pictures.len(), decoded.len());
    anyhow::ensure!(expected == found, "{found} pictures decoded of {expected}");
    Ok(Outcome { setting: quality, bytes, encode_ms, decode_ms, decoded })
}

fn jpeg_xl(pictures: &[Picture], distance: f64, folder: &Path) -> anyhow::Result<Outcome> {
    let file = |name: &str| folder.join(name);
    let text = |name: &str| file(name).to_string_lossy().into_owned();
    let (raw, coded, shown) = (text("in.png"), text("coded.jxl"), text("out.png"));
    let setting = distance;
    let distance = distance.to_string();
    let mut outcome =
        Outcome { setting, bytes: 0, encode_ms: 0.0, decode_ms: 0.0, decoded: Vec::new() };
    for picture in pictures {
        frame_file::write_png(&file("in.png"), picture)?;
        let arguments = [raw.as_str(), &coded, "-d", &distance, "-e", "9", "--quiet"];
        let (_, ms) = timed(|| run("cjxl", &arguments))?;
        outcome.encode_ms += ms;
        outcome.bytes += std::fs::metadata(&coded)?.len() as usize;
        let (_, ms) = timed(|| run("djxl", &[&coded, &shown, "--quiet"]))?;
        outcome.decode_ms += ms;
        let decoded = frame_file::read_frame(&file("out.png"), picture.width, picture.height)?;
        outcome.decoded.push(decoded);
    }
    Ok(outcome)
}
