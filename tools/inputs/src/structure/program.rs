//! A program that finds poses, by COLMAP's command line: what it can do, and a run of one of its commands.

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use super::error::{Ended, StructureError};
use super::record::Record;
use crate::child::{LastWords, Running};
use crate::locked_folder::LockedFolder;

/// pycolmap by COLMAP's command line.
const BY_PYTHON: &str = include_str!("colmap_by_python.py");
/// COLMAP's mapper that solves for all pictures at once: COLMAP 4 has it.
pub const GLOBAL: &str = "global_mapper";

/// COLMAP, or a Python with pycolmap.
#[derive(Debug)]
pub struct Program {
    path: PathBuf,
    /// A Python's: what it runs.
    script: Option<&'static str>,
    /// All that it says of itself.
    help: String,
}

/// A path that holds from every folder; a bare name is looked for on the PATH.
fn whole(path: &Path) -> PathBuf {
    match path.components().count() {
        0 | 1 => path.to_path_buf(),
        _ => std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()),
    }
}

impl Program {
    /// A COLMAP, by its path or its name on the PATH.
    pub fn colmap(path: &Path) -> Result<Program, StructureError> {
        Program { path: whole(path), script: None, help: String::new() }.asked()
    }

    /// A Python that has pycolmap.
    pub fn python(path: &Path) -> Result<Program, StructureError> {
        Program { path: whole(path), script: Some(BY_PYTHON), help: String::new() }.asked()
    }

    /// Asks it what it is. Another program than these is refused.
    fn asked(self) -> Result<Program, StructureError> {
        let help = self.text(&["help"])?;
        let program = Program { help, ..self };
        match program.version().to_lowercase().contains("colmap") {
            true => Ok(program),
            false => Err(StructureError::NoColmap { path: program.path }),
        }
    }

    /// What it is, for messages.
    pub fn name(&self) -> &'static str {
        if self.script.is_some() { "pycolmap" } else { "COLMAP" }
    }

    /// The first line of its help.
    pub fn version(&self) -> &str {
        self.help.lines().next().unwrap_or_default().trim()
    }

    /// Whether it solves for all pictures at once, as COLMAP 4 does.
    pub fn is_global(&self) -> bool {
        self.help.split_whitespace().any(|word| word == GLOBAL)
    }

    pub fn options(&self, command: &str) -> Result<Options, StructureError> {
        Ok(Options { help: self.text(&[command, "-h"])? })
    }

    /// Runs a command to its end. `line` is told each line of its output.
    pub fn run(
        &self,
        arguments: &[String],
        place: &LockedFolder<Record>,
        mut line: impl FnMut(&str),
    ) -> Result<(), StructureError> {
        let path = place.log();
        let failed = StructureError::file(&path);
        let mut log = File::options().create(true).append(true).open(&path).map_err(&failed)?;
        writeln!(log, "\n$ colmap {}    # {}", arguments.join(" "), self.version())
            .map_err(&failed)?;
        let (output, writer) = std::io::pipe().map_err(&failed)?;
        let mut command = self.command(arguments);
        command.current_dir(&place.path);
        // So the lock holds until the command has ended, also if this program ends before.
        command.stdin(place.lock.try_clone().map_err(&failed)?);
        command.stdout(writer.try_clone().map_err(&failed)?).stderr(writer);
        let mut running = Running::start(command).map_err(StructureError::file(&self.path))?;
        let mut last = LastWords::default();
        let mut lines = BufReader::new(output);
        let mut bytes = Vec::new();
        while lines.read_until(b'\n', &mut bytes).map_err(&failed)? > 0 {
            log.write_all(&bytes).map_err(&failed)?;
            let said = String::from_utf8_lossy(&bytes);
            line(&said);
            last.add(&said);
            bytes.clear();
        }
        let (status, _) = running.end(Duration::MAX).map_err(&failed)?;
        if status.success() {
            return Ok(());
        }
        let (program, command, log) = (self.name(), arguments[0].clone(), place.log());
        Err(StructureError::Step { program, command, ended: Ended(status), last: last.text(), log })
    }

    /// A command without a window.
    fn command<S: AsRef<std::ffi::OsStr>>(&self, arguments: &[S]) -> Command {
        let mut command = Command::new(&self.path);
        if let Some(script) = self.script {
            command.args(["-c", script]);
        }
        command.args(arguments).env("QT_QPA_PLATFORM", "offscreen");
        command
    }

    /// All that a short command says.
    fn text(&self, arguments: &[&str]) -> Result<String, StructureError> {
        let output = self.command(arguments).stdin(Stdio::null()).output();
        let output = output.map_err(|error| match error.kind() {
            ErrorKind::NotFound => {
                StructureError::NotInstalled { why: format!("{}: not found", self.path.display()) }
            }
            _ => StructureError::File { path: self.path.clone(), error },
        })?;
        let all = [output.stdout, output.stderr].concat();
        Ok(String::from_utf8_lossy(&all).into_owned())
    }
}

/// The options that a command knows.
pub struct Options {
    help: String,
}

impl Options {
    /// The option's present name, of those that it had.
    pub fn known(&self, names: &[&'static str]) -> Option<&'static str> {
        let words = || self.help.split_whitespace();
        names.iter().copied().find(|name| words().any(|word| word == *name))
    }
}

/// The share that a line of output says is done: `Processed file [3/84]`, `Matching block [1/2, 2/2]`.
pub fn share(line: &str) -> Option<f64> {
    let (_, rest) = line.split_once('[')?;
    let (inner, _) = rest.split_once(']')?;
    let (mut done, mut all) = (0.0, 1.0);
    for part in inner.split(',') {
        let (at, of) = part.split_once('/')?;
        let (at, of): (u32, u32) = (at.trim().parse().ok()?, of.trim().parse().ok()?);
        if at == 0 || at > of {
            return None;
        }
        done = done * f64::from(of) + f64::from(at - 1);
        all *= f64::from(of);
    }
    Some((done + 1.0) / all)
}

/// The number of pictures that have a pose, of a line as `Registering image #12 (13)`, or `(num_reg_frames=13)`.
pub fn registered(line: &str) -> Option<usize> {
    let (_, rest) = line.split_once("Registering image #")?;
    let (_, count) = rest.split_once('(')?;
    count.split_once(')')?.0.rsplit('=').next()?.trim().parse().ok()
}

/// The share of the global mapper that is done when it says a line.
pub fn mapped(line: &str) -> Option<f64> {
    const STAGES: [(&str, f64); 8] = [
        ("Running rotation averaging", 0.01),
        ("Running track establishment", 0.02),
        ("Running global positioning", 0.04),
        ("Running iterative bundle adjustment", 0.08),
        ("Global bundle adjustment iteration 1 / 3 finished", 0.25),
        ("Global bundle adjustment iteration 2 / 3 finished", 0.32),
        ("Running iterative retriangulation", 0.38),
        ("retriangulation and refinement done", 0.98),
    ];
    STAGES.iter().find(|(says, _)| line.contains(says)).map(|(_, share)| *share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_say_how_much_is_done() {
        for (line, expected) in [
            ("Processed file [21/84]\n", Some(0.25)),
            ("I20260101 11:22:33.4 7 feature_extraction.cc:254] Processed file [1/4]", Some(0.25)),
            ("Matching block [1/2, 1/2] in 75.564s", Some(0.25)),
            ("Matching block [2/2, 2/2]", Some(1.0)),
            ("Processing image [3/4]", Some(0.75)),
            ("Matching block [0/0]", None),
            ("Matching [", None),
            ("=> Registered [x/3]", None),
        ] {
            assert_eq!(share(line), expected, "{line}");
        }
        assert_eq!(registered("Registering image #24 (13)\n"), Some(13));
        assert_eq!(registered("] Registering image #24 (num_reg_frames=13)\n"), Some(13));
        assert_eq!(registered("Registering image #24\n"), None);
    }

    #[test]
    fn options_go_by_their_whole_names() {
        let options = Options { help: "  --SiftExtraction.use_gpu arg (=1)\n".into() };
        let names = ["--FeatureExtraction.use_gpu", "--SiftExtraction.use_gpu"];
        assert_eq!(options.known(&names), Some("--SiftExtraction.use_gpu"));
        assert_eq!(options.known(&["--SiftExtraction.use"]), None);
    }
}
