//! Truth maps as pictures.

use std::path::{Path, PathBuf};

use nvsprior::Picture;
use nvsprior::truth::TruthMap;
use nvsprior_inputs::values;

use anyhow::Context;

/// Where truth maps are written.
#[derive(clap::Args)]
pub struct TruthArgs {
    /// Folder for truth maps, NAME.png: grey, a pixel for a block of 16×16. 0: the picture is as seen; 1: it differs;
    /// 2: it is wrong; 3: nothing is known of it
    #[arg(long, value_name = "DIR")]
    truth: Option<PathBuf>,
    /// Folder for the pictures with the truth map drawn over them, NAME.png. Yellow and dark stripes: it differs;
    /// magenta lattice: it is wrong; grey, with dots: nothing is known of it
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
}

impl TruthArgs {
    /// Makes the folders.
    pub fn check(&self) -> anyhow::Result<()> {
        let folders = [("--truth", &self.truth), ("--overlay", &self.overlay)];
        for (name, folder) in folders {
            if let Some(folder) = folder {
                values::make_folder(name, folder)?;
            }
        }
        Ok(())
    }

    /// Writes what is asked for. `name`: of the pictures.
    pub fn write(&self, name: &Path, picture: &Picture, map: &TruthMap) -> anyhow::Result<()> {
        if let Some(folder) = &self.truth {
            let path = folder.join(name);
            let grey = image::GrayImage::from_raw(map.columns, map.rows, map.levels.clone());
            let grey = grey.context("a truth map without blocks")?;
            grey.save(&path).with_context(|| format!("writing {}", path.display()))?;
        }
        if let Some(folder) = &self.overlay {
            let mut shown = picture.clone();
            map.draw_over(&mut shown);
            nvsprior_runs::write_png(&folder.join(name), &shown)?;
        }
        Ok(())
    }
}
