//! `nvsprior key`: makes a key.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior_link::keys::Key;
use zeroize::Zeroizing;

/// Make a key that vehicle and topside then hold
///
/// Writes a file that only its owner may read. Copy it to the other side by a way that you trust, and give it to both
/// with --key. Its id, which is printed, tells nothing of it. What a key is good for, and what not: docs/security.md.
#[derive(clap::Args)]
pub struct Args {
    /// The key file to write; it must not be there yet
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut bytes = Zeroizing::new([0; Key::LEN]);
    getrandom::fill(&mut *bytes).ok().context("the system gives no random bytes")?;
    let id = Key::new(*bytes).id();
    let mut text = Zeroizing::new(String::with_capacity(256));
    // Writing to a String never fails, and there is room: no copy is left behind.
    let _ =
        writeln(&mut text, format_args!("# nvsprior key {id}: whoever has it can send pictures"));
    for byte in bytes.iter() {
        text.push(char::from_digit((byte >> 4).into(), 16).unwrap_or_default());
        text.push(char::from_digit((byte & 15).into(), 16).unwrap_or_default());
    }
    text.push('\n');
    write(&args.out, text.as_bytes()).with_context(|| format!("--out {}", args.out.display()))?;
    say!("key {id} in {}: give both sides a copy", args.out.display());
    Ok(())
}

fn writeln(text: &mut String, line: std::fmt::Arguments) -> std::fmt::Result {
    std::fmt::Write::write_fmt(text, line)?;
    text.push('\n');
    Ok(())
}

/// Makes a file for its owner alone.
fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}
