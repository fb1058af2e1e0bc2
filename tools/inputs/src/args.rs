//! Arguments that several subcommands share.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use nvsprior::geometry::Lens;
use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::render::{BlockReader, Scene};
use nvsprior::vulkan::DeviceOptions;
use nvsprior::{Camera, Engine, Picture, Pose, Prior, RenderOverrides};
use nvsprior_runs::{FrameFolder, FrameFolderError, FrameKind};

use crate::values;

/// The prior and how to render it.
#[derive(clap::Args)]
pub struct PriorArgs {
    /// The trained scene: .ply, .nvsg, .nvsb, .spz, .glb, .sog or .compressed.ply; the content tells
    /// the format
    #[arg(long, value_name = "FILE")]
    pub prior: PathBuf,
    /// Most memory for the splats of a prior in blocks (.nvsb): only those that cameras see are loaded. Pictures stay
    /// the same [default: it is loaded whole]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..))]
    pub prior_memory: Option<u32>,
    #[command(flatten)]
    pub overrides: OverrideArgs,
}

/// Whether files of an earlier run may go.
#[derive(clap::Args)]
pub struct OverwriteArgs {
    /// Replace the files that such a command wrote to the same folders. They go once the new ones are whole; nothing
    /// else is removed
    #[arg(long)]
    pub overwrite: bool,
}

impl OverwriteArgs {
    /// Opens a folder that gets a file for each frame.
    pub fn open(
        &self,
        option: &'static str,
        folder: &Path,
        kind: FrameKind,
    ) -> Result<FrameFolder, FrameFolderError> {
        FrameFolder::open(option, folder, kind, self.overwrite)
    }

    /// The same, if one is given.
    pub fn open_given(
        &self,
        option: &'static str,
        folder: &Option<PathBuf>,
        kind: FrameKind,
    ) -> Result<Option<FrameFolder>, FrameFolderError> {
        folder.as_deref().map(|folder| self.open(option, folder, kind)).transpose()
    }
}

/// Render options that stand in for the file's own.
#[derive(clap::Args)]
pub struct OverrideArgs {
    /// Near plane, in the prior's unit [default: the file's, else that of its trainer]
    #[arg(long, value_name = "Z", value_parser = values::near, allow_hyphen_values = true)]
    near: Option<f32>,
    /// Clamp of alpha [default: as the file says, else 0.99]
    #[arg(long, value_name = "A", value_parser = values::alpha_max, allow_hyphen_values = true)]
    alpha_max: Option<f32>,
    /// The prior was trained with anti-aliased opacity (gsplat's mode)
    #[arg(long)]
    antialiased: bool,
    /// Focal length, pixels, of the pictures that the prior was trained on: the low-pass is that of their pixels, so
    /// that other sizes can be drawn [default: as the file says, else the low-pass is that of the pixels drawn]
    #[arg(long, value_name = "PIXELS", value_parser = values::focal, allow_hyphen_values = true)]
    trained_focal: Option<f32>,
}

impl OverrideArgs {
    pub fn overrides(&self) -> RenderOverrides {
        RenderOverrides {
            near: self.near,
            alpha_max: self.alpha_max,
            antialiased: self.antialiased.then_some(true),
            trained_focal: self.trained_focal,
            ..RenderOverrides::default()
        }
    }
}

/// The device to run on.
#[derive(clap::Args)]
pub struct DeviceArgs {
    /// The Vulkan device's number, or a part of its name or its driver's name [default: the best
    /// device]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Run under the Vulkan validation layer and fail if it complains
    #[arg(long)]
    validate: bool,
}

impl DeviceArgs {
    /// Opens the engine and names the device in one line.
    pub fn open(&self) -> anyhow::Result<Engine> {
        self.open_watched(None)
    }

    /// As [`DeviceArgs::open`], with a bound on each submission's time.
    pub fn open_watched(&self, watchdog: Option<Duration>) -> anyhow::Result<Engine> {
        let (device, validation) = (self.device.clone(), self.validate);
        let options = DeviceOptions { device, validation, watchdog, ..DeviceOptions::default() };
        let engine = Engine::new(&options)?;
        tell!("device: {}", engine.device());
        Ok(engine)
    }

    /// Fails if the validation layer complained.
    pub fn check(&self, engine: &Engine) -> anyhow::Result<()> {
        let messages = engine.validation_messages();
        match messages.first() {
            Some(first) => anyhow::bail!("{} validation messages, first: {first}", messages.len()),
            None => Ok(()),
        }
    }
}

/// Reads a prior, saying what was left out of it.
pub fn open_prior(path: &Path, overrides: &OverrideArgs) -> anyhow::Result<Prior> {
    let prior = nvsprior_formats::open(path, &overrides.overrides())?;
    tell_notes(path, &prior);
    Ok(prior)
}

/// Says what was left out of a prior that was read.
pub fn tell_notes(path: &Path, prior: &Prior) {
    for note in prior.report().notes() {
        tell!("{}: {note}", path.display());
    }
}

impl PriorArgs {
    /// Reads the prior, saying what was left out of it.
    pub fn open(&self) -> anyhow::Result<Prior> {
        open_prior(&self.prior, &self.overrides)
    }

    /// The lens of its mapping run's camera, if it states one.
    pub fn lens(&self) -> anyhow::Result<Option<Lens>> {
        Ok(match BlockedPrior::is_at(&self.prior) {
            true => BlockedPrior::open(&self.prior)?.extras().lens,
            false => self.open()?.extras().lens,
        })
    }

    /// Uploads the prior, or opens it in blocks.
    pub fn upload(&self, engine: &Engine) -> anyhow::Result<Arc<Scene>> {
        let scene = match self.prior_memory {
            Some(mebibytes) => {
                let given = self.overrides.overrides() != RenderOverrides::default();
                anyhow::ensure!(!given, "--prior-memory takes the render options of the file");
                let blocked = Arc::new(BlockedPrior::open(&self.prior)?);
                engine.open_blocked(&blocked, u64::from(mebibytes) << 20, BlockReader::threaded())
            }
            None => engine.upload(&self.open()?),
        };
        scene.with_context(|| format!("uploading {}", self.prior.display()))
    }

    /// Says so if a render is empty because all that it looks at is nearer than the near plane.
    pub fn tell_if_cut(
        &self,
        render: &Picture,
        camera: &Camera,
        pose: &Pose,
    ) -> anyhow::Result<()> {
        let is_empty = render.data.chunks_exact(3).all(|pixel| pixel == &render.data[..3]);
        if !is_empty || self.prior_memory.is_some() {
            return Ok(());
        }
        // What was left out of it was told when it was uploaded.
        let prior = nvsprior_formats::open(&self.prior, &self.overrides.overrides())?;
        if prior.is_cut_by_near_plane(camera, pose) {
            let (path, near) = (self.prior.display(), prior.options().near);
            tell!(
                "{path}: all that the view looks at is nearer than the near plane, {near}, and is not drawn; --near \
                 sets another one"
            );
        }
        Ok(())
    }

    /// Fails if a prior that is needed whole is to be opened in blocks.
    pub fn check_whole(&self, what_for: &str) -> anyhow::Result<()> {
        let whole = self.prior_memory.is_none();
        anyhow::ensure!(whole, "--prior-memory: {what_for} the prior must be loaded whole");
        Ok(())
    }
}

/// The size that frames are encoded at.
#[derive(Clone, clap::Args)]
pub struct SizeArgs {
    /// Frames wider than this are reduced to it, as in the paper; 0 keeps every size
    #[arg(long, value_name = "PIXELS", default_value_t = WIDTH,
        value_parser = clap::value_parser!(u32).range(0..=i64::from(Camera::MAX_SIDE)))]
    width: u32,
}

impl Default for SizeArgs {
    fn default() -> SizeArgs {
        SizeArgs { width: WIDTH }
    }
}

/// The width of the paper's frames, pixels.
pub const WIDTH: u32 = 320;

impl SizeArgs {
    /// Frames of at most this width.
    pub fn of(width: u32) -> SizeArgs {
        SizeArgs { width }
    }

    /// The width that frames are reduced to; `None`: they stay as they are.
    pub fn most(&self) -> Option<u32> {
        (self.width > 0).then_some(self.width)
    }

    /// The camera at the size that its frames are encoded at.
    pub fn reduced(&self, camera: &Camera) -> Camera {
        camera.at_most_wide(self.width)
    }
}

/// Exactly `N` finite numbers with commas between.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    let values = values.map_err(|e| format!("{e}"))?;
    match <[f64; N]>::try_from(values) {
        Ok(values) if values.iter().all(|v| v.is_finite()) => Ok(values),
        Ok(_) => Err("all numbers must be finite".into()),
        Err(values) => Err(format!("{N} numbers are due, but {} were given", values.len())),
    }
}

/// A progress bar on standard error; silent if that is no terminal. It goes when it is dropped.
pub fn progress(length: usize, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {bar:40} {pos}/{len} {eta}");
    let bar = ProgressBar::new(length as u64).with_message(what);
    let bar = bar.with_finish(ProgressFinish::AndClear);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Does work that says when each of `length` parts is done, behind a progress bar.
pub fn with_progress<T>(length: usize, what: &'static str, work: impl FnOnce(&dyn Fn()) -> T) -> T {
    let bar = progress(length, what);
    work(&|| bar.inc(1))
}
