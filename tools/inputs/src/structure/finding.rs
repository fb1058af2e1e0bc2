//! Which program finds poses: COLMAP 4, pycolmap, or an older COLMAP.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::StructureError;
use super::program::Program;
use crate::child;
use crate::progress::{Progress, Watch};

/// Which program finds poses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finder {
    /// COLMAP 4 if it is on the PATH; else pycolmap, which is installed if need be; else an older COLMAP.
    Auto,
    /// The COLMAP that is on the PATH.
    Colmap,
    /// pycolmap, which is installed if need be.
    Pycolmap,
    /// This program: a COLMAP, or a Python that has pycolmap.
    File(PathBuf),
}

/// What is installed: tried with this version's options, and with the models that it writes.
const PACKAGE: &str = "pycolmap~=4.2";
const COLMAP: &str = "colmap";
const PYTHON: &str = "python3";

impl Finder {
    /// Finds the program. `watch` is told before anything is installed.
    pub fn find(&self, watch: Watch) -> Result<Program, StructureError> {
        match self {
            Finder::File(path) => Program::colmap(path).or_else(|_| Program::python(path)),
            Finder::Colmap => Program::colmap(Path::new(COLMAP)),
            Finder::Pycolmap => pycolmap(watch),
            Finder::Auto => {
                let colmap = Program::colmap(Path::new(COLMAP));
                match colmap {
                    Ok(colmap) if colmap.is_global() => Ok(colmap),
                    // An older one is better than none.
                    colmap => pycolmap(watch).or_else(|error| colmap.map_err(|_| error)),
                }
            }
        }
    }
}

/// A Python that has pycolmap: the system's, or one of its own that is made.
fn pycolmap(watch: Watch) -> Result<Program, StructureError> {
    if let Ok(program) = Program::python(Path::new(PYTHON)) {
        return Ok(program);
    }
    let place =
        environment().ok_or_else(|| not_installed("no folder for caches: HOME is not set"))?;
    let python = |folder: &Path| folder.join("bin").join(PYTHON);
    if let Ok(program) = Program::python(&python(&place)) {
        return Ok(program);
    }
    watch(Progress::Says(format!(
        "no COLMAP 4 and no pycolmap: installing {PACKAGE} (about 40 MB, from PyPI) into {}; --poses colmap does not",
        place.display()
    )));
    install(&place)?;
    Program::python(&python(&place))
}

/// Where the environment of pycolmap is.
fn environment() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let cache = set("XDG_CACHE_HOME").map(PathBuf::from);
    let cache = cache.or_else(|| set("HOME").map(|home| PathBuf::from(home).join(".cache")))?;
    Some(cache.join("nvsprior").join("pycolmap"))
}

/// Makes a Python environment with pycolmap. It comes to its place when it is whole.
fn install(place: &Path) -> Result<(), StructureError> {
    let part = place.with_extension(format!("part-{}", std::process::id()));
    let failed = StructureError::file(&part);
    std::fs::create_dir_all(&part).map_err(&failed)?;
    let made = venv(&part);
    // A broken one of before is in the way.
    let _ = made.is_ok().then(|| std::fs::remove_dir_all(place));
    let placed = made.and_then(|()| std::fs::rename(&part, place).map_err(&failed));
    if placed.is_err() {
        // What is left of it is in nobody's way.
        let _ = std::fs::remove_dir_all(&part);
    }
    placed
}

fn venv(folder: &Path) -> Result<(), StructureError> {
    let mut make = Command::new(PYTHON);
    make.args(["-m", "venv"]).arg(folder);
    run(make)?;
    // Only as it is packed: to build it takes COLMAP's sources.
    let pip = ["-m", "pip", "install", "--quiet", "--retries", "1", "--timeout", "20"];
    let mut install = Command::new(folder.join("bin").join(PYTHON));
    install.args(pip).args(["--only-binary", ":all:", PACKAGE]);
    run(install)
}

/// Runs a command; the error has its last words.
fn run(command: Command) -> Result<(), StructureError> {
    let ended =
        child::run(command).map_err(|error| not_installed(&format!("{PYTHON}: {error}")))?;
    ended.map_err(|last| not_installed(&last))
}

fn not_installed(why: &str) -> StructureError {
    StructureError::NotInstalled { why: why.to_owned() }
}
