//! `nvsprior bench`, `stability` and `device-report`: commands of `nvsprior-lab`, the program beside this one.

use std::io;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

const COMMANDS: [&str; 3] = ["bench", "stability", "device-report"];

#[derive(Debug, thiserror::Error)]
pub enum HandOverError {
    #[error(
        "`{command}` is a command of nvsprior-lab, and there is no {}: packages leave it out; in the source tree \
         `cargo build --release --bins` builds both programs",
        program.display()
    )]
    Missing { command: String, program: PathBuf },
    #[error("{}: {source}", program.display())]
    Start { program: PathBuf, source: io::Error },
}

/// Gives the command to the laboratory, if it is one of its commands. The exit code is the laboratory's.
pub fn to_laboratory() -> Option<anyhow::Result<ExitCode>> {
    let args: Vec<_> = std::env::args_os().skip(1).collect();
    let command = args.first()?.to_str()?;
    if !COMMANDS.contains(&command) {
        return None;
    }
    let name = format!("nvsprior-lab{}", std::env::consts::EXE_SUFFIX);
    let program = match std::env::current_exe() {
        Ok(own) => own.with_file_name(name),
        Err(error) => return Some(Err(error.into())),
    };
    if !program.exists() {
        return Some(Err(HandOverError::Missing { command: command.into(), program }.into()));
    }
    let done = start(Command::new(&program).args(&args));
    Some(done.map_err(|source| HandOverError::Start { program, source }.into()))
}

/// Becomes the program.
#[cfg(unix)]
fn start(command: &mut Command) -> io::Result<ExitCode> {
    use std::os::unix::process::CommandExt;
    Err(command.exec())
}

/// Runs the program to its end.
#[cfg(not(unix))]
fn start(command: &mut Command) -> io::Result<ExitCode> {
    let code = command.status()?.code().and_then(|code| u8::try_from(code).ok());
    Ok(code.map_or(ExitCode::FAILURE, ExitCode::from))
}
