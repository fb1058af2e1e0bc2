//! `nvsprior inspect`: what is in a prior, and which parts of it pictures do not need.

mod scan;
mod study;

use std::path::PathBuf;

use glam::DVec3;
use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::filter_weights::FilterWeights;
use nvsprior::geometry::{Distortion, Intrinsics, Lens};
use nvsprior::prior::PoseTrials;

use crate::mission::MissionArgs;
use crate::prior::key_frames;
use crate::record;
use nvsprior_inputs::args::{DeviceArgs, OverrideArgs};
use nvsprior_inputs::report::row;
use nvsprior_inputs::values;

/// Print what is in a prior, and which parts are left out because no picture shows them
///
/// With a camera file, also print what a mission's views do not show. `nvsprior prior trim` writes a prior without it.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene, .ply, .nvsg, .nvsb, .spz, .glb, .sog or .compressed.ply; the content tells the format. Of a
    /// folder: a line for each scene in it
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
    if args.prior.is_dir() {
        return scan::print(&args.prior, &args.overrides);
    }
    let prior = nvsprior_formats::open(&args.prior, &args.overrides.overrides())?;
    let mission = args.cameras.as_ref().map(|path| args.mission.read(path, &prior)).transpose()?;
    describe(args, &prior);
    for dive in record::of(&prior)? {
        row(&format!("dive {}", dive.name), dive.to_string());
    }
    study::print(&prior, mission.as_ref(), args.tolerance, &args.device)
}

/// What is known of how far off poses are.
fn poses(trials: &PoseTrials) -> String {
    match trials.trials().len() {
        0 => "how far off they are was not measured when the prior was mapped".into(),
        count => format!(
            "off by {:.2} times what a picture alone tells, by {count} trials of the mapping run{}",
            trials.doubt(),
            if trials.doubt() > PoseTrials::MAX_DOUBT {
                ": no position is known by it"
            } else {
                ""
            }
        ),
    }
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
    for warning in &report.warnings {
        row("warning", warning.to_string());
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
    row("poses", poses(&prior.extras().pose_trials));
    row("background", format!("{:?}", options.background));
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let values = splats.positions.iter().map(|p| p[axis]).collect();
        row(name, spread(values));
    }
    let scales = splats.log_scales.iter().flatten().map(|s| s.exp()).collect();
    row("scales", spread(scales));
    let opacities = splats.opacity_logits.iter().map(|l| 1.0 / (1.0 + (-l).exp())).collect();
    row("opacities", spread(opacities));
    let DVec3 { x, y, z } = prior.origin();
    row("origin", format!("{x}, {y}, {z}"));
    let frame = prior.coordinate_frame();
    row("frame", format!("centre {:?}, spread {}", frame.centre, frame.spread));
    row("key frames", key_frames::describe(prior.key_frames()));
    row("coder tables", whose(prior.coder_tables().is_some(), Tables::encoded_len()));
    row("display filter", whose(prior.filter_weights().is_some(), FilterWeights::encoded_len()));
    row("preprocessing", prior.preprocessing().to_string());
    row("lens", describe_lens(prior.extras().lens.as_ref()));
    row("doubt", if prior.extras().doubt.is_some() { "known" } else { "not known" }.into());
    for comment in &report.comments {
        row("comment", comment.clone());
    }
}

/// Which coder tables or weights are used, and their bytes.
fn whose(own: bool, bytes: usize) -> String {
    match own {
        true => format!("the scene's own, {bytes} bytes"),
        false => "the library's own, for any scene".into(),
    }
}

/// The lens of the mapping run's camera.
pub fn describe_lens(lens: Option<&Lens>) -> String {
    let Some(lens) = lens else { return "not stated".into() };
    let Intrinsics { width, height, fx, fy, cx, cy } = lens.intrinsics();
    let distortion = match lens.distortion() {
        Distortion::None => "without distortion",
        Distortion::Brown(_) => "Brown-Conrady",
        Distortion::Fisheye(_) => "fisheye",
    };
    format!("{width}×{height}, fx {fx:.2}, fy {fy:.2}, cx {cx:.2}, cy {cy:.2}, {distortion}")
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
