//! Truth maps as pictures.

use std::path::PathBuf;

use nvsprior::Picture;
use nvsprior::truth::TruthMap;
use nvsprior_inputs::args::OverwriteArgs;
use nvsprior_runs::{FrameFolder, FrameKind};

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

/// The folders of truth maps that are asked for.
pub struct TruthFolders {
    truth: Option<FrameFolder>,
    overlay: Option<FrameFolder>,
}

impl TruthArgs {
    /// Makes the folders.
    pub fn open(&self, overwrite: &OverwriteArgs) -> anyhow::Result<TruthFolders> {
        Ok(TruthFolders {
            truth: overwrite.open_given("--truth", &self.truth, FrameKind::TRUTH)?,
            overlay: overwrite.open_given("--overlay", &self.overlay, FrameKind::OVERLAY)?,
        })
    }
}

impl TruthFolders {
    /// Writes what is asked for. `name`: of the picture.
    pub fn write(&mut self, name: &str, picture: &Picture, map: &TruthMap) -> anyhow::Result<()> {
        if let Some(folder) = &mut self.truth {
            folder.write_grey(name, (map.columns, map.rows), &map.levels)?;
        }
        if let Some(folder) = &mut self.overlay {
            let mut shown = picture.clone();
            map.draw_over(&mut shown);
            folder.write_picture(name, &shown)?;
        }
        Ok(())
    }

    pub fn finish(&mut self) -> anyhow::Result<()> {
        let folders = [&mut self.truth, &mut self.overlay];
        Ok(folders.into_iter().flatten().try_for_each(FrameFolder::finish)?)
    }
}
