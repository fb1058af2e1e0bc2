//! `nvsprior demo`: the whole job on the embedded scene.

mod drawing;
mod table;
mod video;

use std::io::ErrorKind;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::Context;
use nvsprior::prior::ply::write_ply;
use nvsprior::prior::{Doubt, replace_file};
use nvsprior::render::Scene;
use nvsprior::residual::{ResidualCoder, Webp};
use nvsprior::tracking::Optimizer;
use nvsprior::{Camera, Encoder, EncoderOptions, Engine, Picture, Prior, Rate, RenderOptions};

use crate::sheet::{self, SheetRow};
use drawing::{SceneArgs, draw_dive, draw_mapping_run};
use nvsprior_basin::{CAMERA, Conditions, DemoFrame, Dive, Site};
use nvsprior_inputs::args::{DeviceArgs, progress};
use nvsprior_inputs::{frame_file, values};
use table::{Table, TableRow};
use video::VideoArgs;

/// Run the whole job on a scene that the program draws itself
///
/// Draws a basin with a yellow structure, seen through water. Its prior was trained from the mapping
/// run M1 by `nvsprior map`, and comes with the program. Encodes two inspection runs (T1: the scene as mapped; T2: with
/// a new object and a safety line), or the run that `--run` names. Decodes their packets in another process, compares,
/// and prints a table like the paper's.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for runs, prior, packets, pictures and the table
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    /// Frames of each inspection run
    #[arg(long, value_name = "N", default_value = "5")]
    frames: NonZeroUsize,
    /// Quality of the difference pictures, 0 to 100
    #[arg(long, value_name = "Q", default_value_t = 20.0)]
    quality: f32,
    /// Also draws this many views from random places of the basin, to test the search for lost
    /// cameras (`nvsprior bench --lost`)
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = values::count)]
    views: usize,
    #[command(flatten)]
    scene: SceneArgs,
    /// Only draws the site's mapping run, M1, M2 or M3, that a prior is trained from
    #[arg(long, conflicts_with_all = ["run", "draw_only"])]
    mapping_run: bool,
    /// Only draws: writes each run's frames and camera file, and opens no device
    #[arg(long)]
    draw_only: bool,
    #[command(flatten)]
    video: VideoArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// A frame starts from the one before if the mean squared error there is below this.
const THRESHOLD: f64 = 1e-2;
/// The error of a simulated estimator at the first frame: a step (metres, radians).
const FIRST_OFFSET: [f64; 6] = [0.08, -0.06, 0.10, 0.035, -0.044, 0.026];

pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(file) = args.video.file() {
        return args.video.draw(file);
    }
    values::make_folder("--out", &args.out)?;
    let site = args.scene.site()?;
    if args.mapping_run {
        return draw_mapping_run(&args.out, args.scene.camera(), site);
    }
    let dives = args.scene.dives()?;
    if site == Site::Basin && !args.draw_only {
        return encode_basin(args, &dives);
    }
    for dive in &dives {
        draw_dive(&args.out, args.scene.camera(), dive, args.frames.get(), |_| ())?;
        println!("the inspection run is in {}", args.out.join(dive.run.name()).display());
    }
    draw_views(args)
}

/// The whole job, on the site whose prior comes with the program.
fn encode_basin(args: &Args, dives: &[Dive]) -> anyhow::Result<()> {
    let engine = args.device.open()?;
    let prior_file = args.out.join("prior.ply");
    let prior = write_prior(&prior_file, &args.scene.camera())?;
    let scene = engine.upload(&prior)?;
    let mut tables = Vec::new();
    for dive in dives {
        let mut frames = Vec::new();
        draw_dive(&args.out, args.scene.camera(), dive, args.frames.get(), |frame| {
            frames.push(frame.clone())
        })?;
        let name = dive.run.name();
        let job = Job { args, name, engine: &engine, scene: &scene, prior: &prior_file };
        let table = job.table(&frames)?;
        println!("\n{table}");
        tables.push(table);
    }
    draw_views(args)?;
    table::write(&args.out, &tables)?;
    println!("\nprior, runs, packets, pictures and contact sheets are in {}", args.out.display());
    args.device.check(&engine)
}

/// Draws the views from random places, if any are asked for.
fn draw_views(args: &Args) -> anyhow::Result<()> {
    if args.views == 0 {
        return Ok(());
    }
    let camera = args.scene.camera();
    let bar = progress(args.views, "drawing random views");
    let views = nvsprior_basin::random_views(camera, args.views, Conditions::CALM);
    nvsprior_basin::write_run(&args.out.join("views"), "views", camera, views, |_| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(())
}

/// The prior that comes with the program.
pub fn prior() -> anyhow::Result<Prior> {
    Ok(Prior::from_bytes(nvsprior_basin::PRIOR, "the demo's prior", &Default::default())?)
}

/// Writes the prior as a file that viewers read, too. For pictures of another size than it was trained at, it states
/// its own. That makes it another prior: what comes with the program of its doubt is not about that one.
fn write_prior(path: &Path, camera: &Camera) -> anyhow::Result<Prior> {
    let shipped = prior()?;
    let is_usual = *camera == CAMERA;
    let trained_focal = (!is_usual).then_some(CAMERA.fx);
    let options = RenderOptions { trained_focal, ..*shipped.options() };
    let mut bytes = Vec::new();
    write_ply(
        shipped.splats(),
        &options,
        shipped.key_frames(),
        shipped.preprocessing(),
        &mut bytes,
    )?;
    replace_file(path, &bytes)?;
    let doubt = Doubt::path_beside(path);
    if is_usual {
        replace_file(&doubt, nvsprior_basin::DOUBT)?;
    } else if let Err(error) = std::fs::remove_file(&doubt)
        && error.kind() != ErrorKind::NotFound
    {
        return Err(error).with_context(|| format!("removing {}", doubt.display()));
    }
    let prior = Prior::open(path, &Default::default())?;
    println!("prior: {} splats and {} key frames", prior.len(), prior.key_frames().len());
    Ok(prior)
}

/// One inspection run against the prior.
struct Job<'a> {
    args: &'a Args,
    name: &'static str,
    engine: &'a Engine,
    scene: &'a std::sync::Arc<Scene>,
    prior: &'a Path,
}

impl Job<'_> {
    fn table(&self, frames: &[DemoFrame]) -> anyhow::Result<Table> {
        let quality = Rate::Quality(self.args.quality);
        let (default, pictures) =
            self.encode(frames, Optimizer::default(), ResidualCoder::Wavelet, quality)?;
        let same = Rate::Psnr(default.psnr);
        let (paper, _) = self.encode(frames, Optimizer::Bfgs, ResidualCoder::Webp, same)?;
        let webp = self.webp(frames, default.psnr)?;
        sheet::write(&self.args.out.join(format!("{}.png", self.name)), &pictures)?;
        let camera = self.args.scene.camera();
        let (run, frames) = (self.name, frames.len());
        Ok(Table { camera, run, frames, rows: vec![webp, paper, default] })
    }

    /// Plain WebP of the frames, each at the least quality that reaches a PSNR.
    fn webp(&self, frames: &[DemoFrame], psnr: f64) -> anyhow::Result<TableRow> {
        let mut row = TableRow::new("WebP, at the PSNR of the last row");
        for frame in frames {
            let since = Instant::now();
            let (bytes, reached) = webp_at_psnr(&frame.picture, psnr)?;
            row.add(bytes, reached, since.elapsed().as_secs_f64() * 1e3, 0);
        }
        Ok(row.mean(frames.len()))
    }

    /// Encodes the run, decodes its packets in another process and compares.
    fn encode(
        &self,
        frames: &[DemoFrame],
        optimizer: Optimizer,
        residual: ResidualCoder,
        rate: Rate,
    ) -> anyhow::Result<(TableRow, Vec<SheetRow>)> {
        let rate = Some(rate);
        let mut options =
            EncoderOptions { threshold: THRESHOLD, rate, residual, ..Default::default() };
        options.refine.optimizer = optimizer;
        let camera = self.args.scene.camera();
        let mut encoder = Encoder::new(self.engine, self.scene, &camera, options)?;
        let folder = self.args.out.join(self.name);
        let packets = folder.join(format!("packets-{}", optimizer.name()));
        std::fs::create_dir_all(&packets)
            .with_context(|| format!("making {}", packets.display()))?;
        let bar = progress(frames.len(), "encoding");
        let coder = match residual {
            ResidualCoder::Wavelet => "wavelet",
            ResidualCoder::Webp => "WebP",
        };
        let mut row = TableRow::new(format!("NVSPrior+iNVS+{coder}, {}", optimizer.name()));
        let mut pictures = Vec::new();
        for (index, frame) in frames.iter().enumerate() {
            let start = (index == 0).then(|| frame.pose.stepped(&FIRST_OFFSET));
            let encoded = encoder.encode(&frame.picture, start)?;
            let path = packets.join(&frame.name).with_extension("nvsp");
            std::fs::write(&path, &encoded.packet)
                .with_context(|| format!("writing {}", path.display()))?;
            let stats = &encoded.stats;
            row.add(stats.bytes, stats.psnr, stats.milliseconds, stats.full_renders);
            let (render, reconstruction) = (encoded.render, encoded.picture);
            pictures.push(SheetRow {
                frame: frame.picture.clone(),
                render,
                reconstruction: Some(reconstruction),
            });
            bar.inc(1);
        }
        bar.finish_and_clear();
        let decoded = folder.join(format!("decoded-{}", optimizer.name()));
        self.decode(&packets, &decoded)?;
        for (frame, pictures) in frames.iter().zip(&pictures) {
            let path = decoded.join(&frame.name);
            let topside = frame_file::read_frame(&path, camera.width, camera.height)?;
            anyhow::ensure!(
                Some(&topside) == pictures.reconstruction.as_ref(),
                "{}: the topside shows another picture than the encoder predicted",
                path.display()
            );
        }
        Ok((row.mean(frames.len()), pictures))
    }

    /// Runs `nvsprior decode` on the packets. It gets only the prior and the packets.
    fn decode(&self, packets: &Path, frames: &Path) -> anyhow::Result<()> {
        let program = std::env::current_exe().context("finding this program")?;
        let mut command = Command::new(program);
        command.arg("decode").arg("--prior").arg(self.prior);
        command.arg("--packets").arg(packets).arg("--frames").arg(frames);
        let output = command.output().context("starting the decoder")?;
        anyhow::ensure!(
            output.status.success(),
            "the decoder failed: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        Ok(())
    }
}

/// The smallest WebP of a picture that reaches a PSNR, by bisection of the quality; the best one if
/// none does. Returns bytes and PSNR.
fn webp_at_psnr(picture: &Picture, psnr: f64) -> anyhow::Result<(usize, f64)> {
    /// Libwebp's default.
    const SEGMENTS: u8 = 4;
    let mut webp = Webp::new(picture.width, picture.height);
    let mut shown = Picture::new(picture.width, picture.height);
    let mut code = |quality: f32| -> anyhow::Result<(usize, f64)> {
        let file = webp.encode_file(picture, quality, SEGMENTS)?.to_vec();
        webp.decode_file(&file, &mut shown)?;
        Ok((file.len(), shown.psnr(picture)))
    };
    let (mut low, mut high) = (0.0, 100.0);
    let mut best = code(high)?;
    for _ in 0..7 {
        let middle = 0.5 * (low + high);
        let (bytes, reached) = code(middle)?;
        if reached >= psnr {
            (high, best) = (middle, (bytes, reached));
        } else {
            low = middle;
        }
    }
    Ok(best)
}
