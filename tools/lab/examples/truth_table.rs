//! Trains `src/truth/table.rs`: counts how blocks of pictures differ, and prints the chances.
//!
//! Usage: truth_table FRAMES,PICTURES,RENDERS…: three folders of PNG files of the same names for each run. PICTURES are
//! what `nvsprior encode --pictures` writes at some rate, RENDERS what it writes with `--residual none`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::Picture;
use nvsprior::truth::training::Counts;

fn read(path: &Path) -> anyhow::Result<Picture> {
    let image = image::open(path).with_context(|| format!("reading {}", path.display()))?;
    let image = image.to_rgb8();
    Picture::from_rgb(image.width(), image.height(), image.into_raw()).context("too few bytes")
}

fn main() -> anyhow::Result<()> {
    let mut counts = Counts::default();
    for run in std::env::args().skip(1) {
        let folders: Vec<PathBuf> = run.split(',').map(PathBuf::from).collect();
        let [frames, pictures, renders] =
            <[PathBuf; 3]>::try_from(folders).ok().context("FRAMES,PICTURES,RENDERS")?;
        let listed = std::fs::read_dir(&pictures)
            .with_context(|| format!("listing {}", pictures.display()))?;
        let mut names = listed
            .map(|entry| entry.map(|entry| entry.file_name()))
            .collect::<Result<Vec<_>, _>>()?;
        names.sort();
        let of_frame = |name| -> anyhow::Result<[Picture; 3]> {
            let folders = [&frames, &pictures, &renders];
            let [frame, picture, render] = folders.map(|folder| read(&folder.join(name)));
            Ok([frame?, picture?, render?])
        };
        let run = names.iter().map(of_frame).collect::<anyhow::Result<Vec<_>>>()?;
        counts.add_run(run.into_iter());
    }
    for (name, chances) in ["OFF", "WRONG", "TAKES"].iter().zip(counts.chances()) {
        println!("pub const {name}: [Probability; {}] = {chances:?};", chances.len());
    }
    Ok(())
}
