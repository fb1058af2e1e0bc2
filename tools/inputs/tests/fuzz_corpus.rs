//! Fuzz targets of inputs on the corpora that fuzzing left: see `fuzz/README.md`.

#[path = "../../../fuzz/src/camera_file.rs"]
mod camera_file;
#[path = "../../../fuzz/src/survey.rs"]
mod survey;

use std::path::Path;

fn run(name: &str, target: fn(&[u8])) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(name);
    let mut count = 0;
    for entry in std::fs::read_dir(corpus).expect("a corpus") {
        let path = entry.expect("an entry").path();
        println!("{}", path.display());
        target(&std::fs::read(&path).expect("a file"));
        count += 1;
    }
    assert!(count >= 20, "{count} inputs of {name}");
}

#[test]
fn camera_files() {
    run("camera_file", camera_file::run);
}

#[test]
fn what_a_mapping_run_brings() {
    run("survey", survey::run);
}
