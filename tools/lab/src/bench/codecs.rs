//! `nvsprior-lab codecs`: the wavelet coder beside other coders, on the same frames and difference pictures.

pub mod affine;
mod alike;
pub mod external;
mod frames;
pub mod own;
pub mod point;
mod rates;
mod report;
pub mod run;
mod times;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nvsprior::render::filter::FilterPlan;
use nvsprior::residual::Tune;
use nvsprior::{EncoderOptions, Picture, Pose};
use nvsprior_inputs::args::{progress, with_progress};

use super::RunArgs;
use super::context::{Context, Shot};
use super::paper::{exchange, learned};
use super::perturbed::{NEAR, steps};
use super::searcher::Searcher;
use external::External;
use own::Own;
use point::{Input, Mode, Point};
use report::Missing;
use run::{Beside, CodedRun, Run};

/// Measure the wavelet coder and others, on the frames and on the difference pictures
///
/// The wavelet coder and WebP are built in. JPEG XL needs `cjxl` and `djxl`. The video coders (x264, x265, libaom,
/// SVT-AV1, VVenC) need `ffmpeg` with them. Coders that are not installed are named. Bytes are payloads without
/// containers. The bytes of a difference picture include what a steady packet adds: a latent part of 19 bytes, the
/// payload's length, and a check of 2. Also measures the wavelet coder's time beside that of a forward render, and
/// holds it against WebP frame by frame, at equal bytes. Writes codecs.json, codecs.csv, codecs-rates.csv,
/// codecs-similarity.csv, codecs-times.csv, codecs-frames.csv, codecs.svg, and exchange/ for coders outside.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// Only difference pictures, each coded by itself
    ///
    /// Leaves out whole frames, streams and warps, on which the slowest coders take hours.
    #[arg(long)]
    differences: bool,
    /// Folder of what other coders made of exchange/, a folder each: docs/paper.md
    #[arg(long, value_name = "DIR")]
    learned: Option<PathBuf>,
}

/// Seed of the poses that an estimator would give.
const SEED: u64 = 1;

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| measure(args, context, folder))
}

fn measure(args: &Args, context: &mut Context, folder: &Path) -> anyhow::Result<()> {
    context.one_size("this command")?;
    let learned = args.learned.as_deref().map(|folder| learned::read(folder, &context.shots));
    let learned = learned.transpose()?;
    let found = found(context)?;
    let (poses, beside) = (found.poses, Beside::default());
    let frames = context.shots.iter().map(|shot| shot.picture.clone()).collect();
    let run = Run::new(frames, found.renders, beside);
    exchange::write(&folder.join("exchange"), &args.run.input, context, &run)?;
    let portable = context.engine.device().portable;
    let wavelets = [Tune::Psnr, Tune::Ssim, Tune::Detection];
    let [wavelet, tuned @ ..] = wavelets.map(|tune| Own::wavelet(&context.scene, portable, tune));
    let filter = FilterPlan::new(context.engine.vulkan(), &context.scene)?;
    let filtered = Own::filtered(&context.scene, portable, filter);
    let times = with_progress(times::RATES.len(), "the wavelet coder's time", |done| {
        times::measure(context, &run, &poses, done)
    })?;
    let names = context.shots.iter().map(|shot| shot.file.as_str());
    let tables = context.scene.coder_tables();
    let frames = with_progress(run.frames.len(), "frame by frame", |done| {
        frames::measure(&run, names, tables, portable, done)
    })?;
    let variants: Vec<_> = tuned.iter().chain([&filtered]).collect();
    let mut report = Measured::default();
    if args.differences {
        report.differences(&run, &wavelet)?;
        report.variants(&run, &variants)?;
    } else {
        report.plain(&run, &wavelet)?;
        report.variants(&run, &variants)?;
        report.warps(context, &run)?;
    }
    let outside = learned.iter().flat_map(|learned| learned.coders.iter().enumerate());
    report.points.extend(outside.map(|(place, coder)| coder.point(&run, place)));
    report::print(&run, &report.points, &report.missing);
    frames::print(&frames);
    frames::write(&folder.join("codecs-frames.csv"), &frames)?;
    times::print(&times);
    times::write(&folder.join("codecs-times.csv"), &times)?;
    report::write(folder, &report.points, &report.missing)
}

/// What came of the coders.
#[derive(Default)]
struct Measured {
    points: Vec<Point>,
    missing: Vec<Missing>,
}

impl Measured {
    /// All coders on frames and on difference pictures.
    fn plain(&mut self, run: &Run, wavelet: &Own) -> anyhow::Result<()> {
        let inputs = [Input::Frame, Input::Difference];
        self.built_in(run, wavelet, &inputs)?;
        for coder in &external::all() {
            self.external(coder, run, &inputs);
        }
        Ok(())
    }

    /// All coders on difference pictures, each coded by itself.
    fn differences(&mut self, run: &Run, wavelet: &Own) -> anyhow::Result<()> {
        let inputs = [Input::Difference];
        self.built_in(run, wavelet, &inputs)?;
        for coder in external::all() {
            self.external(&coder.only_intra(), run, &inputs);
        }
        Ok(())
    }

    fn built_in(&mut self, run: &Run, wavelet: &Own, inputs: &[Input]) -> anyhow::Result<()> {
        for own in [wavelet, &Own::webp("webp")] {
            let bar = progress(inputs.len() * own.settings(), own.name());
            for input in inputs {
                self.points.extend(own.measure(run, *input, || bar.inc(1))?);
            }
        }
        Ok(())
    }

    /// Coders on the differences from warped renders.
    fn warps(&mut self, context: &mut Context, run: &Run) -> anyhow::Result<()> {
        self.webp(&affine::warped(run), affine::FOUND)?;
        match estimated(context, run)? {
            Some(estimated) => self.affine(&affine::warped(&estimated))?,
            None => self.missing.extend(affine::ESTIMATED.map(|name| Missing {
                coder: name,
                why: "not measured; needs poses of all frames in the camera file".into(),
            })),
        }
        Ok(())
    }

    /// The wavelet coder on difference pictures, tuned to other things than PSNR, or filtered.
    fn variants(&mut self, run: &Run, variants: &[&Own]) -> anyhow::Result<()> {
        for own in variants {
            let bar = progress(own.settings(), own.name());
            self.points.extend(own.measure(run, Input::Difference, || bar.inc(1))?);
        }
        Ok(())
    }

    /// The paper's affine baseline: WebP and JPEG XL on the difference from a warped render.
    fn affine(&mut self, warped: &Run) -> anyhow::Result<()> {
        let [webp, jpeg_xl] = affine::ESTIMATED;
        self.webp(warped, webp)?;
        self.external(&external::jpeg_xl(jpeg_xl), warped, &[Input::Difference]);
        Ok(())
    }

    /// WebP on the difference pictures, under a name.
    fn webp(&mut self, run: &Run, name: &'static str) -> anyhow::Result<()> {
        self.points.extend(Own::webp(name).measure(run, Input::Difference, || ())?);
        Ok(())
    }

    /// Measures a coder that may not be installed, or may not work as expected. The others are measured in any case.
    fn external(&mut self, coder: &External, run: &Run, inputs: &[Input]) {
        let missing = |why| Missing { coder: coder.name(), why };
        if !coder.is_installed() {
            self.missing.push(missing(format!("not installed; needs {}", coder.needs())));
            return;
        }
        let bar = progress(inputs.len() * coder.settings(), coder.name());
        for input in inputs {
            match coder.measure(run, *input, || bar.inc(1)) {
                Ok(points) => self.points.extend(points),
                Err(error) => self.missing.push(missing(format!("failed: {error:#}"))),
            }
        }
    }
}

/// The poses that an encoder finds, one frame after the other.
pub struct FoundPoses {
    pub poses: Vec<Pose>,
    /// The renders there.
    pub renders: Vec<Picture>,
    /// PSNR of each render, dB.
    pub psnr: Vec<f64>,
    /// Time of a search, mean, milliseconds.
    pub ms: f64,
}

/// Has the engine look for all frames.
pub fn found(context: &Context) -> anyhow::Result<FoundPoses> {
    let options = EncoderOptions { rate: None, ..context.options() };
    found_by(context, &mut context.encoder(options)?)
}

/// Has an encoder look for all frames, which codes no difference pictures.
pub fn found_by(context: &Context, encoder: &mut dyn Searcher) -> anyhow::Result<FoundPoses> {
    let mut found =
        FoundPoses { poses: Vec::new(), renders: Vec::new(), psnr: Vec::new(), ms: 0.0 };
    let bar = progress(context.shots.len(), "renders");
    for shot in &context.shots {
        let Shot { file, picture, external, camera, .. } = shot;
        let encoding = || format!("encoding {file}");
        encoder.set_camera(camera).with_context(encoding)?;
        let encoded = encoder.encode(picture, shot.told(*external)).with_context(encoding)?;
        found.renders.push(encoded.render);
        found.poses.push(encoded.pose);
        found.psnr.push(encoded.stats.render_psnr);
        found.ms += encoded.stats.refine_milliseconds / context.shots.len() as f64;
        bar.inc(1);
    }
    Ok(found)
}

/// The run with renders at an estimator's poses: the camera file's, moved off by as much as the paper says of
/// estimators. `None` if the file does not have all poses.
fn estimated(context: &mut Context, run: &Run) -> anyhow::Result<Option<Run>> {
    let known: Option<Vec<_>> =
        context.shots.iter().map(|shot| Some((shot.camera, shot.known?))).collect();
    let Some(known) = known else { return Ok(None) };
    let mut renders = Vec::new();
    for ((camera, pose), step) in known.into_iter().zip(steps(NEAR, SEED)) {
        renders.push(context.forward.picture(&camera, &pose.stepped(&step))?.clone());
    }
    Ok(Some(Run::new(run.frames.clone(), renders, Beside::default())))
}
