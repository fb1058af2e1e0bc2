//! Writes posed pictures as `cameras.json` with PNGs beside it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use nvsprior::{Camera, Picture, Pose};
use serde::Serialize;

use crate::png_file::{PngFileError, write_png};

#[derive(Debug, thiserror::Error)]
pub enum RunWriterError {
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Picture(#[from] PngFileError),
    #[error("two pictures would be written to {}: rename one of them", path.display())]
    Twice { path: PathBuf },
}

/// A picture's entry in `cameras.json`.
#[derive(Clone, Debug)]
pub struct RunView {
    /// The picture's file, relative to the folder: from [`RunWriter::picture`].
    pub file: String,
    pub split: String,
    /// Its camera, of the run's size.
    pub camera: Camera,
    /// World to camera.
    pub pose: Pose,
    /// When it was taken, seconds, if that is known.
    pub time: Option<f64>,
}

#[derive(Serialize)]
struct CameraFile<'a> {
    #[serde(flatten)]
    camera: Camera,
    convention: &'static str,
    images: Vec<Image<'a>>,
}

#[derive(Serialize)]
struct Image<'a> {
    index: usize,
    file: &'a str,
    split: &'a str,
    /// (w, x, y, z).
    qvec: [f64; 4],
    tvec: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<f64>,
    /// If they differ from the run's.
    #[serde(flatten)]
    intrinsics: Option<Intrinsics>,
}

#[derive(Serialize)]
struct Intrinsics {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
}

const CONVENTION: &str = "OpenCV camera (x right, y down, z forward); world-to-camera: \
    X_cam = R(q) X_world + t; q = w,x,y,z unit; pixel (0,0) covers [0,1)x[0,1)";

#[derive(Debug)]
pub struct RunWriter {
    folder: PathBuf,
    /// The files that were written; a file system may not tell capitals.
    written: Mutex<BTreeSet<String>>,
}

impl RunWriter {
    /// Into a folder, which is made when there is something to write.
    pub fn new(folder: &Path) -> RunWriter {
        RunWriter { folder: folder.to_path_buf(), written: Mutex::default() }
    }

    /// Writes a picture as a PNG, and gives its file relative to the folder: the name without what leads out of the
    /// folder, ending in `.png`.
    pub fn picture(&self, name: &str, picture: &Picture) -> Result<String, RunWriterError> {
        let file = file_of(name);
        let path = self.folder.join(&file);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if !written.insert(file.to_lowercase()) {
            return Err(RunWriterError::Twice { path });
        }
        drop(written);
        let parent = path.parent().unwrap_or(&self.folder);
        std::fs::create_dir_all(parent)
            .map_err(|source| RunWriterError::Write { path: parent.to_path_buf(), source })?;
        write_png(&path, picture)?;
        Ok(file)
    }

    /// Writes `cameras.json`. `camera`: gives the size, and the intrinsics of most.
    pub fn list(&self, camera: Camera, views: &[RunView]) -> Result<(), RunWriterError> {
        let image = |(index, view): (usize, &'_ RunView)| {
            let Camera { fx, fy, cx, cy, .. } = view.camera;
            Image {
                index,
                file: &views[index].file,
                split: &views[index].split,
                qvec: view.pose.wxyz(),
                tvec: view.pose.translation.to_array(),
                time: view.time,
                intrinsics: (view.camera != camera).then_some(Intrinsics { fx, fy, cx, cy }),
            }
        };
        let images = views.iter().enumerate().map(image).collect();
        let path = self.folder.join("cameras.json");
        serde_json::to_vec_pretty(&CameraFile { camera, convention: CONVENTION, images })
            .map_err(std::io::Error::from)
            .and_then(|json| std::fs::write(&path, json))
            .map_err(|source| RunWriterError::Write { path, source })
    }
}

/// A name without what leads out of a folder, ending in `.png`.
fn file_of(name: &str) -> String {
    let parts = name.split(['/', '\\']).filter(|part| !["", ".", ".."].contains(part));
    let kept = parts.map(|part| part.replace(':', "-")).collect::<Vec<_>>().join("/");
    let path = Path::new(&kept).with_extension("png");
    path.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_within_the_folder() {
        assert_eq!(file_of("train/0001.png"), "train/0001.png");
        assert_eq!(file_of("../../a/./b.JPG"), "a/b.png");
        assert_eq!(file_of("/c:\\d.webp"), "c-/d.png");
    }
}
