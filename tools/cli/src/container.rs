//! Files that priors are written to.

use std::path::Path;

use nvsprior::RenderOptions;
use nvsprior::coder_tables::Tables;
use nvsprior::image::Preprocessing;
use nvsprior::prior::blocked::{BlockedWriter, Extras};
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{KeyFrames, PriorError, Splats, ply};

/// Steps of a compact prior's quantisation, as multiples of the usual ones, which cost bytes of every packet
/// (docs/decisions.md, 14).
pub const FINENESS: f32 = 0.25;

/// A kind of file, by the ending of its name.
#[derive(Clone, Copy)]
pub enum Container {
    /// `.nvsg`: the compact prior, in these steps.
    Compact(Quantisation),
    /// `.nvsb`: a prior in blocks, in these steps.
    Blocked(Quantisation),
    /// `.ply`: as trainers write it.
    Ply,
}

impl Container {
    /// The kind that a name's ending stands for.
    pub fn of(path: &Path, quantisation: Quantisation) -> anyhow::Result<Container> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("nvsg") => Ok(Container::Compact(quantisation)),
            Some("nvsb") => Ok(Container::Blocked(quantisation)),
            Some("ply") => Ok(Container::Ply),
            _ => anyhow::bail!("{}: a prior's name ends in .nvsg, .nvsb or .ply", path.display()),
        }
    }

    /// The file's content. Coder tables are left out of a `.ply`: they are in a file beside it.
    pub fn write(
        self,
        splats: &Splats,
        options: &RenderOptions,
        key_frames: &KeyFrames,
        coder_tables: Option<&Tables>,
        preprocessing: &Preprocessing,
    ) -> Result<Vec<u8>, PriorError> {
        let mut bytes = Vec::new();
        match self {
            Container::Compact(quantisation) => {
                compact::write(splats, options, key_frames, &quantisation, &mut bytes)?;
                if coder_tables.is_some() {
                    bytes = compact::with_coder_tables(&bytes, coder_tables)?;
                }
                if !preprocessing.is_none() {
                    bytes = compact::with_preprocessing(&bytes, preprocessing)?;
                }
            }
            Container::Blocked(quantisation) => {
                let writer = BlockedWriter { quantisation, ..BlockedWriter::default() };
                let extras = Extras { key_frames, coder_tables, preprocessing };
                writer.write(splats, options, &extras, &mut bytes, &mut |_| ())?;
            }
            Container::Ply => {
                ply::write_ply(splats, options, key_frames, preprocessing, &mut bytes)?
            }
        }
        Ok(bytes)
    }
}
