//! Camera files of both kinds: an error or views that can be rendered.
use std::path::Path;

use nvsprior::Camera;
use nvsprior_inputs::camera_file::CameraFile;

pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(file) = CameraFile::parse(text, Path::new("input")) else { return };
    for view in &file.views {
        // Larger ones than can be rendered are valid: frames are reduced.
        let reduced = Camera { width: 1, height: 1, ..view.camera };
        assert!(reduced.check().is_ok() && view.camera.width > 0 && view.camera.height > 0);
        assert!(view.pose.is_none_or(|pose| pose.is_finite()));
    }
    let _ = file.select(None);
}
