//! `nvsprior key-frames`: makes key frames, the poses at which a lost camera is looked for, from the views of a mapping
//! run and around them.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nvsprior::coder_tables::Tables;
use nvsprior::prior::{
    KeyFrames, PriorFormat, compact, filter_file, ply, replace_file, tables_file,
};
use nvsprior::{Camera, Pose, Prior};

use crate::{beside, record, row};
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::values;
use nvsprior_train::coverage::{Covering, covering};
use nvsprior_train::key_frames::{ANGLE, Sample, Thinned};

/// Give a prior key frames: poses at which a lost camera is looked for
///
/// Takes the views of a camera file that show the prior, best those of the mapping run, and thins them out: a view is
/// left out if a kept one is nearer than --distance and looks in a direction less than --angle away. Then adds poses up
/// to --cover, so that a key frame is near wherever a camera is lost in the volume that the views saw. Without a camera
/// file the poses are anywhere in the free volume; give one if you can. The prior's splats and identity stay as they
/// are, so only the side that encodes needs the key frames.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene: .ply, .nvsg, .spz, .glb, .sog or .compressed.ply; the content tells the format
    #[arg(value_name = "PRIOR")]
    prior: PathBuf,
    /// cameras.json, or nerfstudio's transforms.json, with the poses of the mapping run's cameras
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// Only the views of this split of the camera file
    #[arg(long, value_name = "NAME", requires = "cameras")]
    split: Option<String>,
    /// Leave out a view if a kept one is nearer than this, in the prior's unit [default: 5 % of the median distance
    /// from the cameras to the splats that they show]
    #[arg(long, value_name = "LENGTH", requires = "cameras", value_parser = values::not_negative)]
    distance: Option<f64>,
    /// Leave out a view only if its direction differs from the kept one's by less than this, degrees; roll does not
    /// count
    #[arg(long, value_name = "DEGREES", default_value_t = ANGLE, value_parser = values::not_negative)]
    angle: f64,
    /// Add key frames up to this many in all, with those of the views; 0 adds none
    #[arg(long, value_name = "N", default_value_t = COVER,
        value_parser = clap::value_parser!(u32).range(..=KeyFrames::MAX as i64))]
    cover: u32,
    /// What to write: .keys, key frames alone; .ply or .nvsg, a copy of a prior of that format with the
    /// key frames in it, and nothing else that the file had [default: PRIOR.keys, which is read with
    /// the prior]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Key frames in all. How much so many cover: docs/decisions.md, 10.
const COVER: u32 = 500;

/// A kind of file that key frames are written to.
#[derive(Clone, Copy)]
enum Kind {
    Keys,
    Compact,
    Ply,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let name = args.prior.display().to_string();
    let out = args.out.clone().unwrap_or_else(|| KeyFrames::path_beside(&args.prior));
    let kind = Kind::of(&out)?;
    // Reads the bytes, not by path: the user may want to replace a broken file beside the prior.
    let bytes = std::fs::read(&args.prior).with_context(|| name.clone())?;
    let prior = Prior::from_bytes(&bytes, &name, &Default::default())?;
    let tables = tables_file::open_beside(&args.prior)?;
    kind.check(&out, &prior, tables.as_ref()).with_context(|| out.display().to_string())?;
    values::check_file("--out", &out)?;
    let views = args.cameras.as_deref().map(|file| Views::of(args, file, &prior)).transpose()?;
    let seeds = views.as_ref().map_or(&[][..], |views| views.thinned.key_frames.poses());
    let covering = covering(&prior, seeds, args.cover as usize)?;
    let key_frames = &covering.key_frames;
    anyhow::ensure!(!key_frames.is_empty(), "{name}: {}", nothing(args.cover));
    let content = kind.content(&bytes, &prior, key_frames)?;
    replace_file(&out, &content)?;
    if let Kind::Ply | Kind::Compact = kind {
        record::carry((&args.prior, &prior), &out)?;
        if let Some(tables) = &tables {
            tables_file::save(tables, &tables_file::path_beside(&out))?;
        }
        let filter = filter_file::open_beside(&args.prior)?;
        beside::check_filter(filter.as_ref(), &out)?;
        beside::place_filter(filter.as_ref(), &out)?;
    }
    let prior = if tables.is_some() { prior.with_coder_tables(tables) } else { prior };
    if let Some(views) = &views {
        views.print(args.angle);
    }
    row("covering", describe_covering(&covering));
    row("key frames", describe(key_frames));
    row("written", format!("{}, {} bytes", out.display(), content.len()));
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
        let views = posed_views(file, args.split.as_deref())?;
        let sample = Sample::of(prior.splats(), prior.options().near);
        let thinned = Thinned::of(&sample, &views, args.distance, args.angle)?;
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

fn posed_views(file: &Path, split: Option<&str>) -> anyhow::Result<Vec<(Camera, Pose)>> {
    let views = CameraFile::open(file)?.select(split)?;
    let posed = views.iter().filter_map(|view| Some((view.camera, view.pose?)));
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

impl Kind {
    /// The kind that a name's ending stands for.
    fn of(path: &Path) -> anyhow::Result<Kind> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("keys") => Ok(Kind::Keys),
            Some("nvsg") => Ok(Kind::Compact),
            Some("ply") => Ok(Kind::Ply),
            _ => anyhow::bail!("{}: ends in .keys, .nvsg or .ply", path.display()),
        }
    }

    /// Refuses a copy in another format than the prior's. Refuses a copy if a file beside it would replace its key
    /// frames, or give it other coder tables. `tables`: those beside the prior.
    fn check(self, out: &Path, prior: &Prior, tables: Option<&Tables>) -> anyhow::Result<()> {
        let format = prior.report().format;
        let plain = matches!(
            format,
            PriorFormat::PlyAscii | PriorFormat::PlyLittleEndian | PriorFormat::PlyBigEndian
        );
        let fits = match self {
            Kind::Keys => return Ok(()),
            Kind::Compact => format == PriorFormat::Compact,
            Kind::Ply => plain,
        };
        anyhow::ensure!(
            fits,
            "a copy must have the format of the prior, which is {format}; write a .keys file instead"
        );
        let beside = KeyFrames::path_beside(out);
        anyhow::ensure!(
            !beside.exists(),
            "{} takes precedence over key frames in the copy; remove it first",
            beside.display()
        );
        let beside = tables_file::path_beside(out);
        anyhow::ensure!(
            tables.is_some() || !beside.exists(),
            "{} would make the copy another prior; remove it first",
            beside.display()
        );
        Ok(())
    }

    /// The file's content; `bytes` is that of the prior.
    fn content(
        self,
        bytes: &[u8],
        prior: &Prior,
        key_frames: &KeyFrames,
    ) -> anyhow::Result<Vec<u8>> {
        let content = match self {
            Kind::Keys => return Ok(key_frames.to_csv().into_bytes()),
            Kind::Compact => compact::with_key_frames(bytes, key_frames)?,
            Kind::Ply => {
                let file = ply::read_ply(bytes)?;
                let mut content = Vec::new();
                let (options, preprocessing) = (&file.options, &file.preprocessing);
                ply::write_ply(&file.splats, options, key_frames, preprocessing, &mut content)?;
                content
            }
        };
        let copy = Prior::from_bytes(&content, "the copy", &Default::default())?;
        anyhow::ensure!(
            copy.id() == prior.id() && copy.key_frames().len() == key_frames.len(),
            "the copy is not the prior; please report this"
        );
        Ok(content)
    }
}
