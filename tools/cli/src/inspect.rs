//! `nvsprior inspect`: what is in a prior, and which parts of it pictures do not need; what is in updates.

mod chain;
mod study;
mod update;

use std::path::PathBuf;

use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::filter_weights::FilterWeights;
use nvsprior::prior::PartSource;
use nvsprior::prior::update::{CHAIN_MAGIC, MAGIC};

use crate::key_frames;
use crate::mission::MissionArgs;
use crate::record::{self, Row};
use crate::row;
use nvsprior_inputs::args::{DeviceArgs, OverrideArgs};
use nvsprior_inputs::values;

/// Print what is in a prior, and which parts are left out because no picture shows them
///
/// With a camera file, also print what a mission's views do not show. `nvsprior trim` writes a prior without it. Of
/// updates, print what they add and where.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene, .ply, .nvsg, .spz, .glb, .sog or .compressed.ply, or updates, .nvsu; the content tells
    /// the format
    #[arg(value_name = "PRIOR")]
    prior: PathBuf,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// cameras.json, or nerfstudio's transforms.json, with the poses of the mission's cameras
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    mission: MissionArgs,
    /// Also look for the largest share of splats that can go, without any fitting, at no more than this loss against
    /// the camera's frames; if there are no frames, frames at 27 dB from the prior's pictures are assumed
    #[arg(long, value_name = "DB", requires = "cameras", value_parser = values::not_negative)]
    tolerance: Option<f64>,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let bytes = Prior::read_file(&args.prior)?;
    let [update, chain] = [MAGIC, CHAIN_MAGIC].map(|magic| bytes.starts_with(magic));
    if update || chain {
        anyhow::ensure!(args.cameras.is_none(), "--cameras goes with a prior, not with an update");
        return if chain { chain::print(&args.prior) } else { update::print(&args.prior) };
    }
    let prior = Prior::from_file(&args.prior, bytes, &args.overrides.overrides())?;
    let mission = args.cameras.as_ref().map(|path| args.mission.read(path, &prior)).transpose()?;
    describe(args, &prior);
    print_learnt(&record::open_beside(&args.prior, &prior)?);
    study::print(&prior, mission.as_ref(), args.tolerance, &args.device)
}

fn describe(args: &Args, prior: &Prior) {
    let (splats, report, options) = (prior.splats(), prior.report(), prior.options());
    row("file", args.prior.display().to_string());
    row("format", report.format.to_string());
    row("identity", prior.id().to_string());
    row("splats", format!("{} of {} read", report.kept, report.read));
    for dropped in &report.dropped {
        row("dropped", dropped.to_string());
    }
    if report.clamped_logits > 0 {
        row("full opacity", format!("{} splats had an infinite logit", report.clamped_logits));
    }
    let coefficients = splats.sh_stride() / 3;
    row("SH degree", format!("{} ({coefficients} coefficients per channel)", splats.sh_degree));
    row("near plane", options.near.to_string());
    row("alpha clamp", options.alpha_max.to_string());
    row("anti-aliased", if options.antialiased { "yes" } else { "no" }.into());
    if let Some(focal) = options.trained_focal {
        row("trained at", format!("a focal length of {focal} pixels"));
    }
    row("background", format!("{:?}", options.background));
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let values = splats.positions.iter().map(|p| p[axis]).collect();
        row(name, spread(values));
    }
    let scales = splats.log_scales.iter().flatten().map(|s| s.exp()).collect();
    row("scales", spread(scales));
    let opacities = splats.opacity_logits.iter().map(|l| 1.0 / (1.0 + (-l).exp())).collect();
    row("opacities", spread(opacities));
    let frame = prior.coordinate_frame();
    row("frame", format!("centre {:?}, spread {}", frame.centre, frame.spread));
    row("key frames", key_frames(prior));
    row("coder tables", coder_tables(prior));
    row("display filter", display_filter(prior));
    row("preprocessing", prior.preprocessing().to_string());
    for comment in &report.comments {
        row("comment", comment.clone());
    }
}

/// What the prior has learnt since it was mapped.
fn print_learnt(rows: &[Row]) {
    let updates = rows.iter().filter(|row| row.update.is_some());
    let (updates, bytes) = (updates.clone().count(), updates.map(|row| row.bytes).sum::<usize>());
    if !rows.is_empty() {
        row("learnt", format!("in {updates} updates of {bytes} bytes:"));
    }
    for learnt in rows {
        row(&format!("dive {}", learnt.dive), format!("{}: {learnt}", learnt.name()));
    }
}

/// The number of key frames, their source, and the bounds of their cameras.
fn key_frames(prior: &Prior) -> String {
    let source = prior.report().key_frames;
    match source {
        PartSource::None => source.to_string(),
        _ => format!("{source}: {}", key_frames::describe(prior.key_frames())),
    }
}

/// Which coder tables are used, their source, and their bytes.
fn coder_tables(prior: &Prior) -> String {
    match prior.report().coder_tables {
        PartSource::None => "the library's own, for any scene".into(),
        source => format!("the scene's own, {source}: {} bytes", Tables::encoded_len()),
    }
}

/// Which weights the display filter uses.
fn display_filter(prior: &Prior) -> String {
    match prior.filter_weights() {
        None => "the library's own, for any scene".into(),
        Some(_) => {
            format!(
                "the scene's own, in the file beside it: {} bytes",
                FilterWeights::encoded_len()
            )
        }
    }
}

/// Least, percentiles and greatest of values.
fn spread(mut values: Vec<f32>) -> String {
    values.sort_by(f32::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
    format!(
        "{:.4} … {:.4}, 1 % {:.4}, median {:.4}, 99 % {:.4}",
        at(0.0),
        at(1.0),
        at(0.01),
        at(0.5),
        at(0.99)
    )
}
