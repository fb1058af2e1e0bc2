//! The frames of a run: which ones, and what is known of each before it is encoded.

use std::collections::HashMap;
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
        let names = names(&views.iter().collect::<Vec<_>>())
            .with_context(|| cameras.display().to_string())?;
        let input = |(index, view): (usize, &View)| {
            let camera = self.size.reduced(&view.camera);
            camera.check().with_context(|| format!("{}: {}", cameras.display(), view.name))?;
            frame_file::check_picture(&view.file)?;
            Ok(Input {
                path: view.file.clone(),
                file: view.name.clone(),
                name: names[index].clone(),
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

/// What the views' files are called: by the file, else with its folders, else with its ending, too; no two alike.
fn names(views: &[&View]) -> anyhow::Result<Vec<String>> {
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let flat = |view: &View| view.name.replace(['/', '\\'], "_");
    let ways: [&dyn Fn(&View) -> String; 3] =
        [&|view| stem(&view.file), &|view| stem(Path::new(&flat(view))), &flat];
    let mut doubles = Vec::new();
    for way in ways {
        let names: Vec<String> = views.iter().map(|view| way(view)).collect();
        let mut seen = HashMap::new();
        // Not every file system tells capitals.
        let taken = |(name, view): (&String, &&View)| {
            seen.insert(name.to_lowercase(), view.name.clone())
                .map(|other| (other, view.name.clone()))
        };
        doubles = names.iter().zip(views).filter_map(taken).collect();
        if doubles.is_empty() {
            return Ok(names);
        }
    }
    let (one, other) = &doubles[0];
    anyhow::bail!("{one} and {other} would be written to one file: give one of them another name")
}

#[cfg(test)]
mod tests {
    use nvsprior::Pose;

    use super::*;

    fn named(files: &[&str]) -> anyhow::Result<Vec<String>> {
        let camera = Camera { width: 8, height: 4, fx: 7.0, fy: 7.0, cx: 4.0, cy: 2.0 };
        let view = |name: &&str| View {
            file: Path::new("dive").join(name),
            name: (*name).to_owned(),
            split: None,
            camera,
            pose: Some(Pose::IDENTITY),
            time: None,
        };
        let views: Vec<View> = files.iter().map(view).collect();
        names(&views.iter().collect::<Vec<_>>())
    }

    #[test]
    fn each_frame_has_a_name_of_its_own_or_is_refused() {
        assert_eq!(named(&["a/1.png", "b/2.png"]).unwrap(), ["1", "2"]);
        assert_eq!(named(&["a/1.png", "b/1.png"]).unwrap(), ["a_1", "b_1"]);
        assert_eq!(named(&["1.png", "1.webp"]).unwrap(), ["1.png", "1.webp"]);
        assert_eq!(named(&["a/1.png", "a/1.webp"]).unwrap(), ["a_1.png", "a_1.webp"]);
        assert_eq!(named(&["a/1.png", "A/1.PNG", "b"]).map_err(drop), Err(()));
        let refused = named(&["a/1.png", "a_1.png", "b/1.png"]).unwrap_err().to_string();
        assert!(refused.contains("a/1.png and a_1.png"), "{refused}");
    }
}
