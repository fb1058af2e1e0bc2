//! `nvsprior prior trim`: a prior reduced to what a mission's views need.

mod judge;

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use nvsprior::prior::compact::Quantisation;
use nvsprior::{Camera, Pose, Prior};
use nvsprior_train::PosedPicture;
use nvsprior_train::trim::{TrimOptions, trim};

use crate::container::{Container, check_not_over};
use crate::mission::{self, Mission, MissionArgs};
use crate::picture_renderer::PictureRenderer;
use judge::{Bench, Loss};
use nvsprior_inputs::args::{DeviceArgs, OverrideArgs, open_prior};
use nvsprior_inputs::values;
use nvsprior_runs::{SheetRow, write_contact_sheet};

/// Write a prior reduced to what a mission's views need
///
/// Works in rounds: leaves out the splats whose absence shows least, and fits those that remain. The loss is measured
/// at the views, at others within the margin, and at the camera file's other splits. After every round the file holds
/// the best prior so far. The reduced prior has another identity: both sides of a link must hold it.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene
    #[arg(value_name = "PRIOR")]
    prior: PathBuf,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// cameras.json, or nerfstudio's transforms.json, with the poses of the mission's cameras
    #[arg(long, value_name = "FILE")]
    cameras: PathBuf,
    #[command(flatten)]
    mission: MissionArgs,
    /// Greatest loss of PSNR against the camera's frames, mean over the views, dB
    #[arg(long, value_name = "DB", default_value_t = 0.1, value_parser = values::not_negative)]
    tolerance: f64,
    /// If there are no frames: least PSNR of pictures against the whole prior's, mean over the
    /// views, dB
    #[arg(long, value_name = "DB", default_value_t = 42.0, value_parser = values::not_negative)]
    floor: f64,
    /// Leave out splats farther than this from every camera, in the prior's unit
    #[arg(long, value_name = "LENGTH", value_parser = values::not_negative)]
    range: Option<f64>,
    /// What the remaining splats are fitted to: the whole prior's renders, or the frames, if there
    /// are any. Fitted to frames, fewer splats reach the same PSNR, but less detail remains, and
    /// packets become larger
    #[arg(long, value_enum, default_value = "renders")]
    fit: FitArg,
    /// Gradient steps per round, each towards one view
    #[arg(long, value_name = "N", default_value_t = 330)]
    steps: u32,
    /// The reduced prior: .nvsg (compact, quantised; the cost of that counts as loss) or .ply
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Contact sheet to write (PNG): whole | reduced | difference | reduced, one row per view
    #[arg(long, value_name = "FILE", value_parser = values::png)]
    sheet: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum FitArg {
    Frames,
    Renders,
}
use FitArg::{Frames, Renders};

/// The finest steps that are tried, as multiples of the usual ones.
const FINEST: f32 = 0.125;
const SHEET_ROWS: usize = 8;

pub fn run(args: &Args) -> anyhow::Result<()> {
    let finest = Quantisation::default().scaled(FINEST);
    let container = Container::of(&args.out, finest)?;
    values::check_file("--out", &args.out)?;
    if let Some(sheet) = &args.sheet {
        values::check_file("--sheet", sheet)?;
    }
    check_not_over(&args.prior, &args.out)?;
    let prior = open_prior(&args.prior, &args.overrides)?;
    container.check_tables(prior.coder_tables().is_some())?;
    let mission = args.mission.read(&args.cameras, &prior)?;
    let engine = args.device.open()?;
    let mut whole = PictureRenderer::new(&engine, &prior)?;
    let fit = args.fit;
    let views = fit_views(&mission, fit, &mut whole)?;
    let limits = Loss { tolerance: args.tolerance, floor: args.floor, distilled: fit == Renders };
    let mut bench = Bench::new(&engine, &prior, whole, &mission, (container, &args.out), limits)?;
    bench.coarsen(FINEST)?;
    let options = TrimOptions {
        range: args.range,
        steps: args.steps,
        ..TrimOptions::new(*prior.options(), bench.tolerance())
    };
    let splats = trim(&engine, prior.splats(), &views, &options, &mut bench)?;
    let bytes = bench.save(&splats)?;
    let reduced = nvsprior_formats::open(&args.out, &Default::default())?;
    let size = std::fs::metadata(&args.prior)?.len();
    bench.print(&reduced, size, bytes as u64)?;
    if let Some(path) = &args.sheet {
        write_sheet(path, &mut bench, &reduced, &mission.places())?;
    }
    args.device.check(&engine)
}

/// The views to fit to, with their frames if `fit` asks for frames, and some views within the margin. All other
/// pictures are the whole prior's.
fn fit_views(
    mission: &Mission,
    fit: FitArg,
    whole: &mut PictureRenderer,
) -> anyhow::Result<Vec<PosedPicture>> {
    let mut views = Vec::new();
    for posed in &mission.views {
        let (camera, pose) = (posed.camera, posed.pose);
        let picture = match &posed.frame {
            Some(frame) if fit == Frames => frame.clone(),
            _ => whole.render(&camera, &pose)?.clone(),
        };
        views.push(PosedPicture::new(camera, pose, picture));
    }
    for (camera, pose) in mission.near(0) {
        views.push(PosedPicture::new(camera, pose, whole.render(&camera, &pose)?.clone()));
    }
    Ok(views)
}

fn write_sheet(
    path: &Path,
    bench: &mut Bench,
    reduced: &Prior,
    places: &[(Camera, Pose)],
) -> anyhow::Result<()> {
    let mut small = bench.renderer(reduced)?;
    let row = |(camera, pose): &(Camera, Pose)| {
        let render = small.render(camera, pose)?.clone();
        let frame = bench.whole.render(camera, pose)?.clone();
        Ok(SheetRow { frame, reconstruction: Some(render.clone()), render })
    };
    let rows: anyhow::Result<Vec<SheetRow>> =
        mission::spaced(places, SHEET_ROWS).map(row).collect();
    Ok(write_contact_sheet(path, &rows?)?)
}
