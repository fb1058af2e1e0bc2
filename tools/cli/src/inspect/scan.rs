//! What is in the priors of a folder: a line for each.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::Prior;
use nvsprior::prior::PriorError;
use nvsprior_inputs::args::OverrideArgs;

/// How the names of scenes end; of some it is only said that they are not read.
const ENDINGS: [&str; 8] = ["ply", "nvsg", "nvsb", "spz", "glb", "sog", "splat", "ksplat"];

/// Prints a line for each scene in a folder and in those within it, by name.
///
/// # Errors
/// If there is none, or one cannot be used.
pub fn print(folder: &Path, overrides: &OverrideArgs) -> anyhow::Result<()> {
    let mut files = Vec::new();
    list(folder, &mut files)?;
    files.sort();
    anyhow::ensure!(
        !files.is_empty(),
        "{}: no scene (*.{})",
        folder.display(),
        ENDINGS.join(", *.")
    );
    say!(
        "{:<9} {:>9} {:>2} {:>12} {:>9}  file, format",
        "identity",
        "splats",
        "SH",
        "anti-aliased",
        "near"
    );
    let mut refused = 0;
    for file in &files {
        let name = file.strip_prefix(folder).unwrap_or(file).display().to_string();
        match nvsprior_formats::open(file, &overrides.overrides()) {
            Ok(prior) => line(&name, &prior),
            Err(error) => {
                refused += 1;
                say!("{:<45} {name}: {}", "refused", cause(error));
            }
        }
    }
    anyhow::ensure!(refused == 0, "{refused} of {} scenes cannot be used", files.len());
    Ok(())
}

/// An error without the file's name, which stands beside it.
fn cause(error: PriorError) -> PriorError {
    match error {
        PriorError::InFile { error, .. } => *error,
        other => other,
    }
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let reading = || format!("reading {}", folder.display());
    for entry in std::fs::read_dir(folder).with_context(reading)? {
        let entry = entry.with_context(reading)?;
        // Links are not followed: one may lead to a folder above it.
        let (path, kind) = (entry.path(), entry.file_type().with_context(reading)?);
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        if kind.is_dir() {
            list(&path, files)?;
        } else if ENDINGS.iter().any(|own| own.eq_ignore_ascii_case(ending)) {
            files.push(path);
        }
    }
    Ok(())
}

fn line(name: &str, prior: &Prior) {
    let (report, options) = (prior.report(), prior.options());
    say!(
        "{:<9} {:>9} {:>2} {:>12} {:>9}  {name}, {}",
        prior.id().to_string(),
        report.kept,
        prior.splats().sh_degree,
        if options.antialiased { "yes" } else { "no" },
        options.near,
        report.format
    );
    for dropped in &report.dropped {
        say!("{:<45} dropped: {dropped}", "");
    }
    for warning in &report.warnings {
        say!("{:<45} warning: {warning}", "");
    }
}
