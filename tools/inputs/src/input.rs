//! The frames of a run: which ones, and what is known of each before it is encoded.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::{Camera, Encoded, Encoder, FrameInfo, Picture, Pose};

use crate::args::SizeArgs;
use crate::camera_file::{CameraFile, View};
use crate::frame_file;
use crate::values::{self, WrongUsage};

/// Which frames, and their start poses.
#[derive(clap::Args)]
pub struct InputArgs {
    /// cameras.json, or nerfstudio's transforms.json
    #[arg(long, value_name = "FILE", required = true)]
    pub cameras: Option<PathBuf>,
    /// Only the frames of this split of the camera file
    #[arg(long, value_name = "NAME")]
    pub split: Option<String>,
    /// Only the first N frames
    #[arg(long, value_name = "N", value_parser = values::count, allow_hyphen_values = true)]
    pub limit: Option<usize>,
    #[command(flatten)]
    pub size: SizeArgs,
    /// Poses from outside: `none`, `first` (the camera file's, first frame only), `camera-file` (the camera file's,
    /// every frame), or a CSV file with the columns file,qw,qx,qy,qz,tx,ty,tz, and, if they are known, `time` (seconds)
    /// of the frame, `age` (seconds) of the pose, and its standard deviations srx,sry,srz (along the camera's axes, the
    /// prior's unit), sax,say,saz (about them, degrees)
    #[arg(long, value_name = "FROM", default_value = "first")]
    pub starts: String,
}

pub struct Input {
    /// Its file, for reading and for messages.
    pub path: PathBuf,
    pub file: String,
    /// Name of what is written about it, without ending.
    pub name: String,
    /// The camera at the size that it is encoded at.
    pub camera: Camera,
    /// Its pose from outside, and when it was taken.
    pub external: FrameInfo,
    /// Its pose in the camera file.
    pub known: Option<Pose>,
}

impl Input {
    /// Reads the frame's file, at the camera's size.
    pub fn read(&self) -> anyhow::Result<Picture> {
        let Camera { width, height, .. } = self.camera;
        let read = frame_file::read_frame(&self.path, width, height);
        read.with_context(|| format!("encoding {}", self.path.display()))
    }

    /// Encodes its picture as its camera's next one. Gives back both; the picture as the prior's preprocessing left it.
    pub fn encode(
        &self,
        encoder: &mut Encoder,
        frame: &Picture,
    ) -> anyhow::Result<(Picture, Encoded)> {
        let encoding = || format!("encoding {}", self.path.display());
        encoder.set_camera(&self.camera).with_context(encoding)?;
        let encoded = encoder.encode(frame, self.external).with_context(encoding)?;
        Ok((encoder.treated_frame().clone(), encoded))
    }
}

impl InputArgs {
    /// The same, at another width; 0: as wide as the frames are.
    pub fn at_width(&self, width: u32) -> InputArgs {
        let (cameras, split, starts) =
            (self.cameras.clone(), self.split.clone(), self.starts.clone());
        InputArgs { cameras, split, starts, size: SizeArgs::of(width), ..*self }
    }

    /// The camera file.
    pub fn cameras(&self) -> Result<&Path, WrongUsage> {
        let missing = || WrongUsage("--cameras: needed for frames that are no video's".into());
        self.cameras.as_deref().ok_or_else(missing)
    }

    /// The frames, in time order; at least one.
    pub fn frames(&self) -> anyhow::Result<Vec<Input>> {
        self.frames_from(&self.starts)
    }

    /// As [`InputArgs::frames`], with other poses from outside than `--starts` says; `starts` is one of its values.
    pub fn frames_from(&self, starts: &str) -> anyhow::Result<Vec<Input>> {
        let cameras = self.cameras()?;
        let file = CameraFile::open(cameras)?;
        let mut views = file.select(self.split.as_deref())?;
        views.truncate(self.limit.unwrap_or(usize::MAX));
        anyhow::ensure!(!views.is_empty(), "{}: no frames to encode", cameras.display());
        let csv = starts_file(starts).map(|path| self.read_starts(path)).transpose()?;
        let mut names = HashSet::new();
        let distinct = views.iter().all(|view| names.insert(stem(&view.file)));
        let input = |(index, view): (usize, &View)| {
            let camera = self.size.reduced(&view.camera);
            camera.check().with_context(|| format!("{}: {}", cameras.display(), view.name))?;
            frame_file::check_picture(&view.file)?;
            Ok(Input {
                path: view.file.clone(),
                file: view.name.clone(),
                name: if distinct { stem(&view.file) } else { flat_name(&view.name) },
                camera,
                external: self.external(starts, index, view, csv.as_ref()),
                known: view.pose,
            })
        };
        views.iter().enumerate().map(input).collect()
    }

    pub(crate) fn read_starts(&self, path: &Path) -> anyhow::Result<HashMap<String, FrameInfo>> {
        if !path.exists() {
            let what = "neither `none`, `first` or `camera-file`, nor a file that is there";
            return Err(WrongUsage(format!("--starts {}: {what}", path.display())).into());
        }
        Ok(frame_file::read_known(path)?)
    }

    fn external(
        &self,
        starts: &str,
        index: usize,
        view: &View,
        csv: Option<&HashMap<String, FrameInfo>>,
    ) -> FrameInfo {
        let known = match (csv, starts) {
            (Some(frames), _) => frames.get(&view.name).copied().unwrap_or_default(),
            (None, "camera-file") => view.pose.into(),
            (None, "first") if index == 0 => view.pose.into(),
            _ => FrameInfo::default(),
        };
        FrameInfo { time: view.time.or(known.time), ..known }
    }
}

/// The file that a value of `--starts` names, if it names one.
pub fn starts_file(starts: &str) -> Option<&Path> {
    match starts {
        "none" | "first" | "camera-file" => None,
        path => Some(Path::new(path)),
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// A file name from a path, if stems alone are not distinct.
fn flat_name(name: &str) -> String {
    stem(Path::new(&name.replace(['/', '\\'], "_")))
}
