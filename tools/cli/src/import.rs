//! `nvsprior import`: a foreign prior as one file of our own.

use std::path::PathBuf;

use nvsprior::prior::{compact, replace_file};
use nvsprior_inputs::args::{OverrideArgs, open_prior};
use nvsprior_inputs::values;

use nvsprior_inputs::report::row;

/// Write a foreign prior as .nvsg, with its splats as they are
///
/// Picture and identity stay those of the foreign file. What lies beside that, key frames, display filter and doubt,
/// comes with it. `trim` and `blocks` write smaller files, whose splats are quantised.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene: .ply, .spz, .glb, .sog or .compressed.ply; the content tells the format
    #[arg(value_name = "FOREIGN")]
    foreign: PathBuf,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// The prior, .nvsg
    #[arg(long, value_name = "FILE", value_parser = compact_file)]
    out: PathBuf,
}

fn compact_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("nvsg") => Ok(path),
        _ => Err("the file's name ends in .nvsg".into()),
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    values::check_file("--out", &args.out)?;
    let prior = open_prior(&args.foreign, &args.overrides)?;
    let report = prior.report();
    let name = args.foreign.display();
    anyhow::ensure!(
        !report.format.is_own(),
        "{name}: it is no foreign prior but a {}",
        report.format
    );
    let mut bytes = Vec::new();
    let id = compact::write_exact(prior.splats(), &prior.besides(), &mut bytes)?;
    replace_file(&args.out, &bytes)?;
    row("prior", format!("{}, {} bytes", args.out.display(), bytes.len()));
    row("identity", format!("{id}, as it was"));
    row("splats", prior.len().to_string());
    row("bytes/splat", format!("{:.2}", bytes.len() as f64 / prior.len() as f64));
    row("key frames", prior.key_frames().len().to_string());
    Ok(())
}
