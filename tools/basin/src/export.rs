//! A run on disk: one PNG per frame and a `cameras.json` beside them.

use std::path::Path;

use nvsprior::Camera;
use nvsprior_runs::{RunView, RunWriter, RunWriterError};

use super::DemoFrame;

/// Writes a camera's frames as `folder/split/NAME.png` and their poses as `folder/cameras.json`. Gives each
/// frame to `written` once its file is there.
pub fn write_run(
    folder: &Path,
    split: &str,
    camera: Camera,
    frames: impl Iterator<Item = DemoFrame>,
    mut written: impl FnMut(&DemoFrame),
) -> Result<(), RunWriterError> {
    let writer = RunWriter::new(folder);
    let mut views = Vec::new();
    for frame in frames {
        let file = writer.picture(&format!("{split}/{}", frame.name), &frame.picture)?;
        let (pose, time) = (frame.pose, Some(frame.time));
        views.push(RunView { file, split: split.to_owned(), camera, pose, time });
        written(&frame);
    }
    writer.list(camera, &views)
}

#[cfg(test)]
mod tests {
    use super::super::{CAMERA, Conditions, Run, inspection_run};
    use super::*;

    #[test]
    fn a_run_comes_back_from_disk() {
        let folder = tempfile::tempdir().unwrap();
        let frames: Vec<_> = inspection_run(Run::T1, 2, Conditions::CALM).collect();
        let mut count = 0;
        write_run(folder.path(), "t1", CAMERA, frames.clone().into_iter(), |_| count += 1).unwrap();
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
