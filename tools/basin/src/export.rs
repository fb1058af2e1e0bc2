//! A run on disk: one PNG per frame and a `cameras.json` beside them.

use std::path::{Path, PathBuf};

use nvsprior::{Camera, Pose};
use serde::Serialize;

use super::{CAMERA, DemoFrame};

/// Why a run was not written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A folder or file could not be written.
    #[error("cannot write {path}")]
    Write {
        /// Which one.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A picture could not be written.
    #[error("cannot write the picture {path}")]
    Picture {
        /// Which one.
        path: PathBuf,
        /// What the coder said.
        source: image::ImageError,
    },
}

#[derive(Serialize)]
struct CameraFile {
    #[serde(flatten)]
    camera: Camera,
    convention: &'static str,
    images: Vec<View>,
}

#[derive(Serialize)]
struct View {
    index: usize,
    file: String,
    split: String,
    /// (w, x, y, z).
    qvec: [f64; 4],
    tvec: [f64; 3],
    /// Seconds since the run began.
    time: f64,
}

const CONVENTION: &str = "OpenCV camera (x right, y down, z forward); world-to-camera: \
    X_cam = R(q) X_world + t; q = w,x,y,z unit; pixel (0,0) covers [0,1)x[0,1)";

/// Writes frames as `folder/split/NAME.png` and their poses as `folder/cameras.json`. Gives each
/// frame to `written` once its file is there.
pub fn write_run(
    folder: &Path,
    split: &str,
    frames: impl Iterator<Item = DemoFrame>,
    mut written: impl FnMut(&DemoFrame),
) -> Result<(), ExportError> {
    let pictures = folder.join(split);
    std::fs::create_dir_all(&pictures)
        .map_err(|source| ExportError::Write { path: pictures.clone(), source })?;
    let mut images = Vec::new();
    for (index, frame) in frames.enumerate() {
        let path = pictures.join(&frame.name);
        let (width, height) = (frame.picture.width, frame.picture.height);
        image::save_buffer(&path, &frame.picture.data, width, height, image::ColorType::Rgb8)
            .map_err(|source| ExportError::Picture { path, source })?;
        images.push(view(index, split, &frame));
        written(&frame);
    }
    let path = folder.join("cameras.json");
    let file = CameraFile { camera: CAMERA, convention: CONVENTION, images };
    serde_json::to_vec_pretty(&file)
        .map_err(std::io::Error::from)
        .and_then(|json| std::fs::write(&path, json))
        .map_err(|source| ExportError::Write { path, source })
}

fn view(index: usize, split: &str, frame: &DemoFrame) -> View {
    let Pose { translation, .. } = frame.pose;
    View {
        index,
        file: format!("{split}/{}", frame.name),
        split: split.to_owned(),
        qvec: frame.pose.wxyz(),
        tvec: translation.to_array(),
        time: frame.time,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Conditions, Run, inspection_run};
    use super::*;

    #[test]
    fn a_run_comes_back_from_disk() {
        let folder = tempfile::tempdir().unwrap();
        let frames: Vec<_> = inspection_run(Run::T1, 2, Conditions::BASIN).collect();
        let mut count = 0;
        write_run(folder.path(), "t1", frames.clone().into_iter(), |_| count += 1).unwrap();
        assert_eq!(count, 2);
        let json = std::fs::read(folder.path().join("cameras.json")).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(json["width"].as_u64(), Some(320));
        assert_eq!(json["fy"].as_f64().map(|fy| fy as f32), Some(CAMERA.fy));
        for (image, frame) in json["images"].as_array().unwrap().iter().zip(&frames) {
            let path = folder.path().join(image["file"].as_str().unwrap());
            let picture = image::open(path).unwrap().into_rgb8().into_raw();
            assert_eq!(picture, frame.picture.data);
            assert_eq!(image["tvec"][2].as_f64(), Some(frame.pose.translation.z));
        }
    }
}
