//! A prior's file that a command adds something to: in place, or as a copy.

use std::path::{Path, PathBuf};

use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::prior::{
    Besides, Extras, PriorFormat, compact, extras_file, replace_file, with_coder_tables,
    with_extras,
};
use nvsprior_inputs::args::tell_notes;
use nvsprior_inputs::values;

/// The file, and what is in it.
pub struct PriorFile {
    path: PathBuf,
    bytes: Vec<u8>,
    pub prior: Prior,
    /// Where a copy goes; `None`: the file itself is changed.
    out: Option<PathBuf>,
}

impl PriorFile {
    /// Reads it, and finds out before any work whether what is asked for can be written.
    pub fn open(path: &Path, out: Option<&Path>) -> anyhow::Result<PriorFile> {
        let bytes = nvsprior_formats::read_file(path)?;
        let own =
            nvsprior_formats::from_bytes(&bytes, &path.display().to_string(), &Default::default())?;
        // What lies beside a foreign file may be what this shall replace.
        let prior = match nvsprior_formats::from_file(path, bytes.clone(), &Default::default()) {
            Ok(prior) => prior,
            Err(error) => {
                tell!("{error}; it is written anew");
                own
            }
        };
        tell_notes(path, &prior);
        let file = PriorFile { path: path.to_owned(), bytes, prior, out: out.map(Path::to_owned) };
        if let Some(out) = out {
            file.check_ending(out)?;
        }
        values::check_file("--out", &file.place())?;
        Ok(file)
    }

    fn format(&self) -> PriorFormat {
        self.prior.report().format
    }

    /// Refuses a copy whose name is not that of its format.
    fn check_ending(&self, out: &Path) -> anyhow::Result<()> {
        let ending = if self.format() == PriorFormat::Blocked { "nvsb" } else { "nvsg" };
        let fits = out.extension().is_some_and(|own| own == ending);
        let format = self.format();
        anyhow::ensure!(fits, "{}: a copy of a {format} ends in .{ending}", out.display());
        Ok(())
    }

    /// Which file is written.
    fn place(&self) -> PathBuf {
        match &self.out {
            Some(out) => out.clone(),
            None if self.format().is_own() => self.path.clone(),
            None => extras_file::path_beside(&self.path),
        }
    }

    /// Writes the prior with other extras, whole or not at all. Returns what to tell of the file.
    pub fn save_extras(&self, extras: &Extras) -> anyhow::Result<String> {
        let prior = &self.prior;
        let bytes = match &self.out {
            _ if self.format().is_own() => with_extras(&self.bytes, extras)?,
            Some(_) => self.exactly(&Besides { extras, ..prior.besides() })?,
            None => extras_file::to_bytes(extras, prior.id(), prior.len()),
        };
        self.save(&bytes)
    }

    /// Writes the prior with coder tables, which is another prior. Returns what to tell of the file.
    pub fn save_tables(&self, tables: &Tables) -> anyhow::Result<String> {
        let bytes = match self.format().is_own() {
            true => with_coder_tables(&self.bytes, Some(tables))?,
            false => {
                self.exactly(&Besides { coder_tables: Some(tables), ..self.prior.besides() })?
            }
        };
        self.save(&bytes)
    }

    /// A copy of a foreign prior with its splats as they are.
    fn exactly(&self, besides: &Besides) -> anyhow::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        compact::write_exact(self.prior.splats(), besides, &mut bytes)?;
        Ok(bytes)
    }

    fn save(&self, bytes: &[u8]) -> anyhow::Result<String> {
        let place = self.place();
        replace_file(&place, bytes)?;
        Ok(format!("{}, {} bytes", place.display(), bytes.len()))
    }
}
