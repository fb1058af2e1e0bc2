//! A dive on disk, and the tool run on it.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use nvsprior::{Camera, Picture, Pose};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::common::engine;
use crate::scene::{CAMERA, frame, pose, wall, write_prior};

/// Frames of split `dive`; one more is of split `survey`.
pub const FRAMES: usize = 3;
/// What `encode` needs to know in every case.
pub const INPUT: &str = "--prior prior.ply --cameras cameras.json --split dive";

/// Of the package that is tested.
const PROGRAM: Option<&str> = match option_env!("CARGO_BIN_EXE_nvsprior") {
    None => option_env!("CARGO_BIN_EXE_nvsprior-lab"),
    own => own,
};

/// A folder with `prior.ply`, `cameras.json` and `images/T.png`.
pub struct Dive {
    folder: TempDir,
}

impl Dive {
    /// With the prior alone: no device is needed.
    pub fn without_frames() -> Dive {
        let dive = Dive { folder: tempfile::tempdir().unwrap() };
        write_prior(&dive.path("prior.ply"), &wall(1));
        dive
    }

    pub fn new() -> Dive {
        let dive = Dive::without_frames();
        std::fs::create_dir(dive.path("images")).unwrap();
        for (t, picture) in pictures().iter().enumerate() {
            save(picture, &dive.path(&name(t)));
        }
        dive.write_json("cameras.json", &cameras());
        dive
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write_json(&self, name: &str, value: &Value) {
        std::fs::write(self.path(name), value.to_string()).unwrap();
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_str(&std::fs::read_to_string(self.path(name)).unwrap()).unwrap()
    }

    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    pub fn picture(&self, name: &str) -> Picture {
        let image = image::open(self.path(name)).unwrap().to_rgb8();
        Picture::from_rgb(image.width(), image.height(), image.into_raw()).unwrap()
    }

    /// Runs the tool in the dive's folder; spaces part the arguments.
    pub fn run(&self, args: &str) -> Run {
        self.run_with(args, &[])
    }

    /// As `run`, with environment variables set.
    pub fn run_with(&self, args: &str, environment: &[(&str, &str)]) -> Run {
        let output = Command::new(PROGRAM.expect("Cargo names the program"))
            .args(args.split_whitespace())
            .envs(environment.iter().copied())
            .current_dir(self.folder.path())
            .output()
            .unwrap();
        Run {
            args: args.to_owned(),
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Runs the tool with files limited to so many bytes: what is longer fails, as on a full disk.
    #[cfg(unix)]
    pub fn run_limited(&self, bytes: u64, args: &str) -> (Option<i32>, String) {
        let blocks = bytes / 512;
        // Without a handler the signal would end the process: a full disk sends none.
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" {args}");
        let output = Command::new("sh")
            .args(["-c", &script, PROGRAM.expect("Cargo names the program")])
            .current_dir(self.path(""))
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    }

    /// Encodes the dive to `packets` with more arguments; the summary.
    pub fn encode(&self, args: &str) -> Value {
        let fixed = "--packets packets --summary summary.json --overwrite";
        self.run(&format!("encode {INPUT} {fixed} {args}")).ends_with(0);
        self.json("summary.json")
    }
}

/// How a run of the tool ended.
pub struct Run {
    args: String,
    code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    /// Fails if the exit code is another.
    pub fn ends_with(self, code: i32) -> Run {
        assert_eq!(self.code, Some(code), "nvsprior {}\n{}", self.args, self.stderr);
        self
    }

    /// Fails if standard error does not have the text.
    pub fn says(self, text: &str) -> Run {
        assert!(
            self.stderr.contains(text),
            "nvsprior {}\nno \"{text}\" in:\n{}",
            self.args,
            self.stderr
        );
        self
    }
}

/// Name of a frame in the camera file.
pub fn name(t: usize) -> String {
    format!("images/{t}.png")
}

/// The frames, the last one of split `survey`.
pub fn pictures() -> &'static [Picture] {
    static PICTURES: OnceLock<Vec<Picture>> = OnceLock::new();
    PICTURES.get_or_init(|| {
        let engine = engine();
        let scene = engine.upload(&wall(1)).unwrap();
        (0..=FRAMES).map(|t| frame(&engine, &scene, &pose(t as f64))).collect()
    })
}

/// Writes a picture. The name tells the format.
pub fn save(picture: &Picture, path: &Path) {
    let Picture { width, height, data } = picture;
    image::save_buffer(path, data, *width, *height, image::ColorType::Rgb8).unwrap();
}

/// The camera file, newest frame first: `index` has the time order.
fn cameras() -> Value {
    let image = |t: usize| {
        let split = if t < FRAMES { "dive" } else { "survey" };
        view(&name(t), t, split, &pose(t as f64))
    };
    camera_file(&CAMERA, (0..=FRAMES).rev().map(image).collect())
}

pub fn camera_file(camera: &Camera, images: Vec<Value>) -> Value {
    let Camera { width, height, fx, fy, cx, cy } = *camera;
    json!({ "width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy,
            "images": images })
}

pub fn view(file: &str, index: usize, split: &str, pose: &Pose) -> Value {
    let (q, t) = (pose.wxyz(), pose.translation.to_array());
    json!({ "file": file, "index": index, "split": split, "qvec": q, "tvec": t })
}
