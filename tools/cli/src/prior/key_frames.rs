//! `nvsprior prior key-frames`: makes key frames, the poses at which a lost camera is looked for, from the views of a
//! mapping run and around them.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use glam::DVec3;
use nvsprior::prior::{Extras, KeyFrames};
use nvsprior::{Camera, Pose, Prior};

use crate::prior_file::PriorFile;
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::report::row;
use nvsprior_inputs::values;
use nvsprior_train::coverage::{Covering, covering};
use nvsprior_train::key_frames::{ANGLE, Sample, Thinned};

/// Give a prior key frames: poses at which a lost camera is looked for
///
/// Takes the views of a camera file that show the prior, best those of the mapping run, and thins them out: a view is
/// left out if a kept one is nearer than --spacing and looks in about the same direction. Then adds poses up
/// to --cover, so that a key frame is near wherever a camera is lost in the volume that the views saw. Without a camera
/// file the poses are anywhere in the free volume; give one if you can. The prior's splats and identity stay as they
/// are, so only the side that encodes needs the key frames.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene: .ply, .nvsg, .nvsb, .spz, .glb, .sog or .compressed.ply; the content tells the format
    #[arg(value_name = "PRIOR")]
    prior: PathBuf,
    /// cameras.json, or nerfstudio's transforms.json, with the poses of the mapping run's cameras
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// Only the views of this split of the camera file
    #[arg(long, value_name = "NAME", requires = "cameras")]
    split: Option<String>,
    /// Leave out a view if a kept one is nearer than this, in the prior's unit [default: 5 % of the median distance
    /// from the cameras to the splats that they show], and its direction differs by less than DEGREES, 10 if they are
    /// left out; roll does not count
    #[arg(long, alias = "distance", value_name = "LENGTH[,DEGREES]", requires = "cameras", value_parser = values::pair)]
    spacing: Option<(f64, Option<f64>)>,
    /// Add key frames up to this many in all, with those of the views; 0 adds none
    #[arg(long, value_name = "N", default_value_t = COVER,
        value_parser = clap::value_parser!(u32).range(..=KeyFrames::MAX as i64))]
    cover: u32,
    /// A copy of the prior with the key frames in it: .nvsg, or .nvsb if the prior is one [default: they are put into
    /// PRIOR, or, if that is of a foreign format, into PRIOR.nvsx, which is read with it]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Args {
    /// The distance, if it is stated, and the angle.
    fn spacing(&self) -> (Option<f64>, f64) {
        let (distance, angle) = self.spacing.unzip();
        (distance, angle.flatten().unwrap_or(ANGLE))
    }
}

/// Key frames in all. How much so many cover: docs/decisions.md, 10.
const COVER: u32 = 500;

pub fn run(args: &Args) -> anyhow::Result<()> {
    let file = PriorFile::open(&args.prior, args.out.as_deref())?;
    let prior = &file.prior;
    let views = args.cameras.as_deref().map(|file| Views::of(args, file, prior)).transpose()?;
    let seeds = views.as_ref().map_or(&[][..], |views| views.thinned.key_frames.poses());
    let covering = covering(prior, seeds, args.cover as usize)?;
    let key_frames = &covering.key_frames;
    let name = args.prior.display();
    anyhow::ensure!(!key_frames.is_empty(), "{name}: {}", nothing(args.cover));
    let extras = Extras { key_frames: key_frames.clone(), ..prior.extras().clone() };
    let written = file.save_extras(&extras)?;
    if let Some(views) = &views {
        views.print(args.spacing().1);
    }
    row("covering", describe_covering(&covering));
    row("key frames", describe(key_frames));
    row("written", written);
    row("identity", format!("{}, as it was", prior.id()));
    Ok(())
}

/// Why there are no key frames although no camera file was given.
fn nothing(cover: u32) -> &'static str {
    match cover {
        0 => "--cover 0 and no --cameras: no key frames are asked for",
        _ => "no free volume from which its splats are seen; give --cameras",
    }
}

/// How many key frames were added, and how much of the free volume all of them cover.
fn describe_covering(covering: &Covering) -> String {
    let added = covering.added;
    match covering.share() {
        Some(share) => {
            let (percent, views) = (100.0 * share, covering.views);
            format!(
                "{added} added, {percent:.1} % of {views} views of the free volume have one near"
            )
        }
        None => format!("{added} added, no free volume known"),
    }
}

/// The views of a camera file, and the key frames that they give.
struct Views {
    /// How many have a pose.
    posed: usize,
    thinned: Thinned,
}

impl Views {
    fn of(args: &Args, file: &Path, prior: &Prior) -> anyhow::Result<Views> {
        let views = posed_views(file, args.split.as_deref(), prior.origin())?;
        let sample = Sample::of(prior.splats(), prior.options().near);
        let (distance, angle) = args.spacing();
        let thinned = Thinned::of(&sample, &views, distance, angle)?;
        let thinned = thinned.with_context(|| {
            let (cameras, name) = (file.display(), args.prior.display());
            format!(
                "no view of {cameras} shows a splat of {name}: are its poses in the prior's frame?"
            )
        })?;
        Ok(Views { posed: views.len(), thinned })
    }

    fn print(&self, angle: f64) {
        let Thinned { key_frames, seeing, range, distance } = &self.thinned;
        row("views", format!("{} with poses, {seeing} show the prior", self.posed));
        row("scene", format!("{range:.4} away, median of what the views show"));
        row("thinned", format!("to {}, by {distance:.4} and {angle}°", key_frames.len()));
    }
}

/// The views with poses, as from the prior's origin.
fn posed_views(
    file: &Path,
    split: Option<&str>,
    origin: DVec3,
) -> anyhow::Result<Vec<(Camera, Pose)>> {
    let views = CameraFile::open(file)?.select(split)?;
    let posed = views.iter().filter_map(|view| Some((view.camera, view.pose?.relative_to(origin))));
    let posed: Vec<_> = posed.collect();
    anyhow::ensure!(!posed.is_empty(), "{}: no view has a pose", file.display());
    Ok(posed)
}

/// The number of key frames, and the bounds of their cameras.
pub fn describe(key_frames: &KeyFrames) -> String {
    let Some([min, max]) = key_frames.bounds() else { return "0".into() };
    let axis = |name: &str, i: usize| format!("{name} {:.3} … {:.3}", min[i], max[i]);
    let axes = [axis("x", 0), axis("y", 1), axis("z", 2)].join(", ");
    format!("{}, cameras at {axes}", key_frames.len())
}
