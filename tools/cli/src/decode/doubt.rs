//! What is known of pictures that are memory, as pictures.

use anyhow::Context;
use nvsprior::{Decoder, DoubtMap, DoubtView, Engine, Pose};
use nvsprior_inputs::args::PriorArgs;
use nvsprior_runs::FrameFolder;

/// Draws doubt, and writes it to a folder.
pub struct DoubtFolder {
    folder: FrameFolder,
    view: DoubtView,
    map: DoubtMap,
}

impl DoubtFolder {
    /// Reads the prior's doubt.
    pub fn new(
        folder: FrameFolder,
        engine: &Engine,
        prior: &PriorArgs,
    ) -> anyhow::Result<DoubtFolder> {
        let path = prior.prior.display();
        let prior = prior.open()?;
        if prior.extras().doubt.is_none() {
            tell!("{path}: without doubt: all that is mapped is doubtful (`nvsprior prior doubt`)");
        }
        let view = DoubtView::new(engine, &prior)?;
        Ok(DoubtFolder { folder, view, map: DoubtMap::default() })
    }

    /// Writes the doubt of the picture that was decoded last. `name`: of the picture.
    pub fn write(&mut self, name: &str, decoder: &Decoder, pose: &Pose) -> anyhow::Result<()> {
        let camera = decoder.camera().context("no camera to draw the doubt with")?;
        self.view.draw(camera, pose, &mut self.map)?;
        let DoubtMap { columns, rows, ref levels, .. } = self.map;
        Ok(self.folder.write_grey(name, (columns, rows), levels)?)
    }

    pub fn finish(&mut self) -> anyhow::Result<()> {
        Ok(self.folder.finish()?)
    }
}
