//! The state of a training on disk, beside the prior.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::prior::replace_file;
use nvsprior_train::mapper::{Mapper, read_state, write_state};

pub struct Saved {
    path: PathBuf,
    fingerprint: u32,
}

impl Saved {
    /// Beside the prior. `fingerprint` names what is trained, and how.
    pub fn beside(out: &Path, fingerprint: u32) -> Saved {
        Saved { path: beside(out, ".training"), fingerprint }
    }

    /// Goes on from the saved state, if there is one.
    pub fn resume(&self, mapper: &mut Mapper) -> anyhow::Result<()> {
        let named = || format!("{}", self.path.display());
        if !self.path.exists() {
            tell!("{}: not there; training starts anew", named());
            return Ok(());
        }
        let bytes = std::fs::read(&self.path).with_context(named)?;
        let state = read_state(&bytes, self.fingerprint)
            .with_context(named)
            .context("going on from it (without --resume training starts anew)")?;
        mapper.resume(&state)?;
        tell!("{}: goes on from step {}", named(), mapper.steps());
        Ok(())
    }

    /// Saves the state. If it cannot be written, says so and keeps the one saved before: the disk may have room the
    /// next time, and hours of training are not given up for it.
    pub fn save(&self, mapper: &Mapper) -> anyhow::Result<()> {
        let bytes = write_state(&mapper.state()?, self.fingerprint);
        if let Err(error) = replace_file(&self.path, &bytes) {
            tell!("warning: {error}; the state of step {} is not saved", mapper.steps());
        }
        Ok(())
    }
}

/// Removes the state, once the prior is there.
pub fn remove(out: &Path) -> anyhow::Result<()> {
    let path = beside(out, ".training");
    match path.exists() {
        true => std::fs::remove_file(&path).with_context(|| format!("removing {}", path.display())),
        false => Ok(()),
    }
}

/// Finds out before hours of work whether the prior can be written. Removes halves of files that a killed run left
/// behind.
pub fn check_out(out: &Path) -> anyhow::Result<()> {
    let probe = beside(out, ".probe");
    std::fs::write(&probe, b"")
        .and_then(|()| std::fs::remove_file(&probe))
        .with_context(|| format!("writing beside {}", out.display()))?;
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).with_context(|| format!("{}", folder.display()))?;
    for entry in entries.flatten() {
        if is_half(out, &entry.file_name()) {
            // It is in nobody's way if it stays.
            let _ = std::fs::remove_file(entry.path());
        }
    }
    Ok(())
}

/// Whether a name is that of a temporary file of [`replace_file`], of the prior or its state: `.NAME.PROCESS-ATTEMPT`.
fn is_half(out: &Path, name: &OsString) -> bool {
    let (Some(out), Some(name)) = (out.file_name().and_then(|o| o.to_str()), name.to_str()) else {
        return false;
    };
    let rest = name.strip_prefix('.').and_then(|rest| rest.strip_prefix(out));
    let rest = rest.map(|rest| rest.strip_prefix(".training").unwrap_or(rest));
    let numbers = rest.and_then(|rest| rest.strip_prefix('.')).and_then(|n| n.split_once('-'));
    numbers.is_some_and(|(process, attempt)| {
        [process, attempt].iter().all(|n| n.parse::<u32>().is_ok())
    })
}

/// Finds out before hours of work whether the report can be written.
pub fn check_report(folder: &Path) -> anyhow::Result<()> {
    let named = || format!("writing into {}", folder.display());
    std::fs::create_dir_all(folder).with_context(named)?;
    let probe = folder.join(".probe");
    std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)).with_context(named)
}

/// The path of what lies beside the prior: its name and an ending.
pub fn beside(out: &Path, ending: &str) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(ending);
    out.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_told_from_other_files() {
        for (name, half) in [
            (".a.ply.123-0", true),
            (".a.ply.training.123-7", true),
            ("a.ply.training", false),
            (".a.ply.123", false),
            (".a.ply.x-1", false),
            (".b.ply.123-0", false),
            (".a.plyx.123-0", false),
            ("a.ply.123-0", false),
        ] {
            assert_eq!(is_half(Path::new("dir/a.ply"), &name.into()), half, "{name}");
        }
    }
}
