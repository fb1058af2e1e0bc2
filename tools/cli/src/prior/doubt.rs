//! `nvsprior prior doubt`: how far a prior's picture may be off, splat by splat, by the pictures it was trained on.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nvsprior::image::Preprocessor;
use nvsprior::prior::Extras;
use nvsprior::truth::{BLOCK, THRESHOLDS};
use nvsprior::{Camera, DoubtMap, DoubtView, Engine, Picture, Pose, Prior};
use nvsprior_inputs::args::{DeviceArgs, PriorArgs, SizeArgs, progress};
use nvsprior_inputs::camera_file::{CameraFile, View};
use nvsprior_inputs::frame_file;
use nvsprior_train::PosedPicture;
use nvsprior_train::doubt::doubt_of;

use crate::picture_renderer::PictureRenderer;
use crate::prior_file::PriorFile;
use nvsprior_inputs::report::row;

/// Write how far a prior's picture may be off, from the pictures that it was trained on
///
/// A topside shows with it which parts of a picture that was not sent are to be doubted. `map` writes it, too. It is
/// one byte per splat: the error that the splat's part of a picture is expected to have.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    /// cameras.json, or nerfstudio's transforms.json: the mapping run, with poses
    #[arg(long, value_name = "FILE")]
    cameras: PathBuf,
    /// Only the frames of this split of the camera file
    #[arg(long, value_name = "NAME")]
    split: Option<String>,
    /// A camera file with frames that the prior was not trained on, and their poses: print how often what is doubted
    /// is off, and what is not. SPLIT: only its frames
    #[arg(long, value_names = ["FILE", "SPLIT"], num_args = 1..=2)]
    check: Vec<String>,
    #[command(flatten)]
    size: SizeArgs,
    /// A copy of the prior with its doubt in it: .nvsg, or .nvsb if the prior is one [default: it is put into PRIOR,
    /// or, if that is of a foreign format, into PRIOR.nvsx, which is read with it]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let file = PriorFile::open(&args.prior.prior, args.out.as_deref())?;
    let prior = file.prior.clone().with_overrides(&args.prior.overrides.overrides())?;
    let pictures = args.pictures(&args.cameras, args.split.as_deref(), &prior)?;
    let checked = match &args.check[..] {
        [] => Vec::new(),
        [file, split @ ..] => {
            args.pictures(file.as_ref(), split.first().map(String::as_str), &prior)?
        }
    };
    let engine = args.device.open()?;
    let bar = progress(pictures.len(), "pictures");
    let posed = pictures.iter().map(|picture| (picture, picture.pose));
    let doubt = doubt_of(&engine, &prior, posed, &mut || bar.inc(1))?;
    let sure = |doubt: &&u8| f32::from(**doubt) <= THRESHOLDS[0][0];
    let sure = doubt.iter().filter(sure).count() as f64 / doubt.len() as f64;
    let extras = Extras { doubt: Some(doubt), ..prior.extras().clone() };
    row("written", file.save_extras(&extras)?);
    row("sure", percent(sure));
    if !checked.is_empty() {
        Check::of(&engine, &prior.with_extras(extras)?, &checked)?.print();
    }
    args.device.check(&engine)
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

impl Args {
    /// The pictures of a camera file that have poses, treated as the prior's were.
    fn pictures(
        &self,
        cameras: &Path,
        split: Option<&str>,
        prior: &Prior,
    ) -> anyhow::Result<Vec<PosedPicture>> {
        let mut preprocessor = Preprocessor::new(prior.preprocessing());
        let file = CameraFile::open(cameras)?;
        let views = file.select(split)?;
        let posed = views.iter().filter_map(|view| Some((view, view.pose?)));
        let read = |(view, pose): (&View, Pose)| {
            let camera: Camera = self.size.reduced(&view.camera);
            camera.check().with_context(|| view.name.clone())?;
            let mut frame = frame_file::read_frame(&view.file, camera.width, camera.height)?;
            preprocessor.apply(&mut frame);
            Ok(PosedPicture::new(camera, pose.relative_to(prior.origin()), frame))
        };
        let pictures = posed.map(read).collect::<anyhow::Result<Vec<_>>>()?;
        anyhow::ensure!(!pictures.is_empty(), "{}: no picture has a pose", cameras.display());
        Ok(pictures)
    }
}

/// What is true of blocks of renders: by level of doubt, how many there are and how many are off by more than the truth
/// map's first threshold.
#[derive(Default)]
struct Check {
    blocks: [usize; 3],
    off: [usize; 3],
    /// Expected errors of blocks, and whether they are off.
    expected: Vec<(f32, bool)>,
}

impl Check {
    fn of(engine: &Engine, prior: &Prior, pictures: &[PosedPicture]) -> anyhow::Result<Check> {
        let mut check = Check::default();
        let mut renderer = PictureRenderer::new(engine, prior)?;
        let mut map = DoubtMap::default();
        let mut view = DoubtView::new(engine, prior)?;
        for PosedPicture { camera, pose, picture, .. } in pictures {
            view.draw(camera, &pose.absolute_from(prior.origin()), &mut map)?;
            check.add(&map, picture, renderer.render(camera, pose)?);
        }
        Ok(check)
    }

    fn add(&mut self, map: &DoubtMap, frame: &Picture, render: &Picture) {
        for (block, (level, expected)) in map.levels.iter().zip(&map.expected).enumerate() {
            let at = [block as u32 % map.columns, block as u32 / map.columns];
            let off = rms(frame, render, at) > THRESHOLDS[0][0];
            self.blocks[usize::from(*level)] += 1;
            self.off[usize::from(*level)] += usize::from(off);
            self.expected.push((*expected, off));
        }
    }

    fn print(&self) {
        for (level, name) in ["sure", "doubtful", "never mapped"].into_iter().enumerate() {
            let (blocks, off) = (self.blocks[level], self.off[level]);
            let share = percent(off as f64 / blocks.max(1) as f64);
            row(name, format!("{blocks} blocks of the frames that check, {share} of them off"));
        }
        row("ranked right", percent(self.ranked()));
    }

    /// How often a block that is off is expected to be more so than one that is not (the area under the ROC curve).
    fn ranked(&self) -> f64 {
        let mut sorted = self.expected.clone();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut below, mut right, mut off) = (0_u64, 0.0, 0_u64);
        for equal in sorted.chunk_by(|a, b| a.0 == b.0) {
            let bad = equal.iter().filter(|(_, off)| *off).count() as u64;
            let good = equal.len() as u64 - bad;
            right += bad as f64 * (below as f64 + good as f64 / 2.0);
            below += good;
            off += bad;
        }
        right / (below * off).max(1) as f64
    }
}

/// The error of a block, RMS of 255.
fn rms(frame: &Picture, render: &Picture, [column, row]: [u32; 2]) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for y in row * BLOCK..((row + 1) * BLOCK).min(frame.height) {
        for x in column * BLOCK..((column + 1) * BLOCK).min(frame.width) {
            let at = 3 * (y * frame.width + x) as usize;
            for (seen, shown) in frame.data[at..at + 3].iter().zip(&render.data[at..at + 3]) {
                sum += f32::from(seen.abs_diff(*shown)).powi(2);
                count += 1.0;
            }
        }
    }
    f32::sqrt(sum / f32::max(count, 1.0))
}
