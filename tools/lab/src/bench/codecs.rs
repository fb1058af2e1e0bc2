//! `nvsprior bench --codecs`: what other coders make of the same frames and difference pictures.

mod external;
mod point;
mod report;
mod webp;

use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;
use nvsprior::Picture;
use nvsprior::residual::difference;
use nvsprior_inputs::args::progress;

use super::context::{Context, Shot};
use external::External;
use point::{Input, Mode, Point};

/// `bench --codecs` and what it takes.
#[derive(clap::Args)]
pub struct CodecsArgs {
    /// Measure other coders on the frames and on the difference pictures, in place of all else
    ///
    /// WebP is built in. JPEG XL needs `cjxl` and `djxl`, the video coders (x264, x265, libaom, SVT-AV1) `ffmpeg`; those
    /// that are not installed are named. Writes codecs.json, codecs.csv and codecs.svg.
    #[arg(long, conflicts_with_all = ["ablation", "recovery"])]
    pub codecs: bool,
}

/// The pictures that are coded: all of one size.
struct Run {
    frames: Vec<Picture>,
    renders: Vec<Picture>,
    differences: Vec<Picture>,
    /// Bytes of a packet's latent part, which goes with every difference picture.
    latent: f64,
}

/// Measures, prints and writes it all to a folder.
pub fn run(context: &mut Context, folder: &Path) -> anyhow::Result<()> {
    let camera = context.shots[0].camera;
    for Shot { file, camera: other, .. } in &context.shots {
        anyhow::ensure!(
            (other.width, other.height) == (camera.width, camera.height),
            "{file}: of another size than the first frame; --codecs needs frames of one size"
        );
    }
    std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    let run = pictures(context)?;
    let (found, missing): (Vec<_>, Vec<_>) =
        external::all().into_iter().partition(External::is_installed);
    let steps: usize = found.iter().map(External::settings).sum();
    let bar = progress(2 * (webp::QUALITIES.len() + steps), "coders");
    let mut points = Vec::new();
    for input in [Input::Frame, Input::Difference] {
        points.extend(webp::measure(&run, input, || bar.inc(1))?);
        for coder in &found {
            points.extend(coder.measure(&run, input, || bar.inc(1))?);
        }
    }
    bar.finish_and_clear();
    let missing: Vec<_> = missing.iter().map(External::missing).collect();
    report::print(&points, &missing);
    report::write(folder, &points, &missing)
}

/// Encodes the run without difference pictures, and takes those from the renders.
fn pictures(context: &mut Context) -> anyhow::Result<Run> {
    let mut encoder = context.encoder(context.options())?;
    let (mut frames, mut renders, mut differences) = (Vec::new(), Vec::new(), Vec::new());
    let mut latent = 0.0;
    let bar = progress(context.shots.len(), "renders");
    for Shot { file, picture, external, .. } in &context.shots {
        let encoded =
            encoder.encode(picture, *external).with_context(|| format!("encoding {file}"))?;
        latent += encoded.stats.latent_bytes as f64 / context.shots.len() as f64;
        differences.push(difference(picture, &encoded.render));
        frames.push(picture.clone());
        renders.push(encoded.render);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(Run { frames, renders, differences, latent })
}

impl Run {
    fn len(&self) -> f64 {
        self.frames.len() as f64
    }

    /// What is coded.
    fn pictures(&self, input: Input) -> &[Picture] {
        match input {
            Input::Frame => &self.frames,
            Input::Difference => &self.differences,
        }
    }

    /// Bytes of a frame that a payload comes with.
    fn overhead(&self, input: Input) -> f64 {
        match input {
            Input::Frame => 0.0,
            Input::Difference => self.latent,
        }
    }

    /// Mean PSNR over the frames of what was decoded, dB.
    fn psnr(&self, input: Input, decoded: &[Picture]) -> f64 {
        let shown = |(index, picture): (usize, &Picture)| match input {
            Input::Frame => picture.psnr(&self.frames[index]),
            Input::Difference => {
                let mut shown = self.renders[index].clone();
                nvsprior::residual::add(&picture.data, &mut shown.data);
                shown.psnr(&self.frames[index])
            }
        };
        decoded.iter().enumerate().map(shown).sum::<f64>() / self.len()
    }

    /// A point of a coder, from its payloads' bytes and what they decode to.
    fn point(&self, coder: &'static str, input: Input, mode: Mode, outcome: &Outcome) -> Point {
        Point {
            coder,
            input,
            mode,
            setting: outcome.setting,
            bytes: outcome.bytes as f64 / self.len() + self.overhead(input),
            psnr: self.psnr(input, &outcome.decoded),
            encode_ms: outcome.encode_ms / self.len(),
            decode_ms: outcome.decode_ms / self.len(),
        }
    }
}

/// What a coder made of all pictures.
struct Outcome {
    /// Its quality setting.
    setting: f64,
    /// Of all payloads together, without containers.
    bytes: usize,
    encode_ms: f64,
    decode_ms: f64,
    decoded: Vec<Picture>,
}

/// Milliseconds that something takes, and what it gives.
fn timed<T>(work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<(T, f64)> {
    let since = Instant::now();
    let value = work()?;
    Ok((value, since.elapsed().as_secs_f64() * 1e3))
}
