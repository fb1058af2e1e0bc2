//! What is known of pictures that are memory, as pictures.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::{Decoder, DoubtMap, DoubtView, Engine, Pose};
use nvsprior_inputs::args::PriorArgs;
use nvsprior_inputs::values;

/// Draws doubt, and writes it to a folder.
pub struct DoubtFolder {
    folder: PathBuf,
    view: DoubtView,
    map: DoubtMap,
}

impl DoubtFolder {
    /// Reads the prior's doubt, and makes the folder.
    pub fn new(folder: &Path, engine: &Engine, prior: &PriorArgs) -> anyhow::Result<DoubtFolder> {
        values::make_folder("--doubt", folder)?;
        let path = prior.prior.display();
        let prior = prior.open()?;
        if prior.extras().doubt.is_none() {
            tell!("{path}: without doubt: all that is mapped is doubtful (`nvsprior prior doubt`)");
        }
        let view = DoubtView::new(engine, &prior)?;
        Ok(DoubtFolder { folder: folder.to_owned(), view, map: DoubtMap::default() })
    }

    /// Writes the doubt of the picture that was decoded last. `name`: of the picture.
    pub fn write(&mut self, name: &Path, decoder: &Decoder, pose: &Pose) -> anyhow::Result<()> {
        let camera = decoder.camera().context("no camera to draw the doubt with")?;
        self.view.draw(camera, pose, &mut self.map)?;
        let path = self.folder.join(name);
        let DoubtMap { columns, rows, ref levels, .. } = self.map;
        let grey = image::GrayImage::from_raw(columns, rows, levels.clone());
        let grey = grey.context("a map without blocks")?;
        grey.save(&path).with_context(|| format!("writing {}", path.display()))
    }
}
