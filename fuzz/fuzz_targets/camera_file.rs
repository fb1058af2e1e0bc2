//! Camera files of both kinds: an error or views that can be rendered.
#![no_main]

#[allow(dead_code)] // The tool uses more of it.
#[path = "../../src/bin/nvsprior/camera_file.rs"]
mod camera_file;

use std::path::Path;

use camera_file::CameraFile;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(file) = CameraFile::parse(text, Path::new("input")) else { return };
    for view in &file.views {
        assert!(view.camera.check().is_ok());
        assert!(view.pose.is_none_or(|pose| pose.is_finite()));
    }
    let _ = file.select(None);
});
