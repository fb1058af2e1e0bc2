//! The fuzz target of camera files on the corpus that fuzzing left: see `fuzz/README.md`.

#[path = "../../../fuzz/src/camera_file.rs"]
mod camera_file;

use std::path::Path;

#[test]
fn camera_files() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/camera_file");
    let mut count = 0;
    for entry in std::fs::read_dir(corpus).expect("a corpus") {
        let path = entry.expect("an entry").path();
        println!("{}", path.display());
        camera_file::run(&std::fs::read(&path).expect("a file"));
        count += 1;
    }
    assert!(count >= 20, "{count} inputs");
}
