//! Files that priors are written to.

use std::path::Path;

use anyhow::Context as _;
use nvsprior::prior::blocked::BlockedWriter;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{Besides, Extras, Splats, extras_file, ply, replace_file};

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

    /// The file's content. A `.ply` holds splats, options, key frames and preprocessing alone.
    pub fn write(self, splats: &Splats, besides: &Besides) -> anyhow::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        match self {
            Container::Compact(quantisation) => {
                compact::write(splats, besides, &quantisation, &mut bytes)?;
            }
            Container::Blocked(quantisation) => {
                let writer = BlockedWriter { quantisation, ..BlockedWriter::default() };
                writer.write(splats, besides, &mut bytes, &mut |_| ())?;
            }
            Container::Ply => {
                self.check_tables(besides.coder_tables.is_some())?;
                let Extras { key_frames, preprocessing, .. } = besides.extras;
                ply::write_ply(splats, besides.options, key_frames, preprocessing, &mut bytes)?
            }
        }
        Ok(bytes)
    }

    /// Refuses a `.ply` for a prior with coder tables.
    pub fn check_tables(self, tables: bool) -> anyhow::Result<()> {
        let lost = tables && matches!(self, Container::Ply);
        anyhow::ensure!(!lost, "a .ply holds no coder tables; write a .nvsg");
        Ok(())
    }

    /// Writes the content to a file, or replaces it. What lies beside an earlier `.ply` is about that one.
    pub fn save(self, path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
        replace_file(path, bytes)?;
        let beside = extras_file::path_beside(path);
        if matches!(self, Container::Ply) && beside.is_file() {
            std::fs::remove_file(&beside).with_context(|| beside.display().to_string())?;
        }
        Ok(())
    }
}

/// Refuses to write a prior over the one that it is made of.
pub fn check_not_over(input: &Path, out: &Path) -> anyhow::Result<()> {
    let same = matches!((input.canonicalize(), out.canonicalize()), (Ok(a), Ok(b)) if a == b);
    anyhow::ensure!(
        !same,
        "{}: what is written is another prior; give it another name",
        out.display()
    );
    Ok(())
}
