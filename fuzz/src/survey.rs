//! What a mapping run brings: JPEGs, points, COLMAP's models as text and binary. The first byte says which.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use nvsprior_inputs::colmap::ColmapModel;
use nvsprior_inputs::jpeg;
use nvsprior_inputs::points::parse_points;

/// A folder in memory, if there is one, of this process.
fn folder() -> &'static PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let memory = Path::new("/dev/shm");
        let place = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = place.join(format!("nvsprior-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        folder
    })
}

/// A model whose first two bytes say how long its cameras and its images are.
fn model(bytes: &[u8], ending: &str) {
    let [first, second, rest @ ..] = bytes else { return };
    let (cameras, rest) = rest.split_at(usize::from(*first).min(rest.len()));
    let (images, points) = rest.split_at(usize::from(*second).min(rest.len()));
    let parts = [cameras, images, points];
    for other in ["txt", "bin"].into_iter().filter(|other| *other != ending) {
        let _ = std::fs::remove_file(folder().join(format!("cameras.{other}")));
    }
    for (name, part) in ["cameras", "images", "points3D"].into_iter().zip(parts) {
        std::fs::write(folder().join(format!("{name}.{ending}")), part).expect("a file");
    }
    let Ok(model) = ColmapModel::open(folder()) else { return };
    for view in &model.views {
        assert!(view.pose.is_finite());
    }
}

pub fn run(bytes: &[u8]) {
    let Some((kind, rest)) = bytes.split_first() else { return };
    match kind % 4 {
        0 => drop(jpeg::check(rest)),
        1 => {
            let points = parse_points(rest, Path::new("input")).unwrap_or_default();
            assert!(points.iter().all(|point| point.position.is_finite()));
        }
        2 => model(rest, "txt"),
        _ => model(rest, "bin"),
    }
}
