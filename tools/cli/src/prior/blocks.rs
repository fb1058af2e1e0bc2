//! `nvsprior prior blocks`: priors as one prior in blocks.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;

use anyhow::{Context, ensure};
use nvsprior::Prior;
use nvsprior::prior::blocked::{BlockedWriter, MAX_BLOCK};
use nvsprior::prior::compact::Quantisation;
use nvsprior::prior::{Besides, Extras, KeyFrames, Splats};

use crate::container::{FINENESS, check_not_over};
use nvsprior_inputs::args::{OverrideArgs, open_prior, progress};
use nvsprior_inputs::report::row;
use nvsprior_inputs::values;

/// Write priors as one prior in blocks, of which `--prior-memory` loads what cameras see
///
/// Several priors are the parts of one site, in one coordinate system: their splats and key frames are put together.
/// They must agree in render options and preprocessing. The result has an identity of its own: both sides of a link
/// must hold it, whole or in blocks.
#[derive(clap::Args)]
pub struct Args {
    /// Trained scenes
    #[arg(value_name = "PRIOR", required = true)]
    priors: Vec<PathBuf>,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// The prior in blocks, .nvsb
    #[arg(long, value_name = "FILE", value_parser = blocked_file)]
    out: PathBuf,
    /// Most splats of a block
    #[arg(long, value_name = "N", default_value_t = 4096,
        value_parser = clap::value_parser!(u32).range(1..=MAX_BLOCK as i64))]
    block: u32,
}

fn blocked_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("nvsb") => Ok(path),
        _ => Err("a prior in blocks has a name that ends in .nvsb".into()),
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    values::check_file("--out", &args.out)?;
    args.priors.iter().try_for_each(|prior| check_not_over(prior, &args.out))?;
    let parts = Parts::read(args)?;
    let quantisation = Quantisation::default().scaled(FINENESS);
    let writer = BlockedWriter { quantisation, block: args.block as usize };
    let Parts { splats, first, extras } = &parts;
    let besides = Besides { extras, ..first.besides() };
    // A file that is half written is never under the name that was asked for.
    let partial = args.out.with_added_extension("partial");
    let file = File::create(&partial).with_context(|| partial.display().to_string())?;
    let bar = progress(splats.len(), "splats");
    let mut done = |count: usize| bar.set_position(count as u64);
    let written = writer.write(splats, &besides, BufWriter::new(file), &mut done);
    let placed = written.map_err(anyhow::Error::from).and_then(|summary| {
        std::fs::rename(&partial, &args.out).with_context(|| args.out.display().to_string())?;
        Ok(summary)
    });
    let summary = placed.inspect_err(|_| {
        // What is left of a failure helps nobody.
        let _ = std::fs::remove_file(&partial);
    })?;
    row("prior", format!("{}, {} bytes", args.out.display(), summary.bytes));
    row("identity", summary.id.to_string());
    row("splats", format!("{}, and {} left out that show nothing", summary.splats, summary.unseen));
    row("blocks", summary.blocks.to_string());
    row("bytes/splat", format!("{:.2}", summary.bytes as f64 / summary.splats as f64));
    row("key frames", extras.key_frames.len().to_string());
    Ok(())
}

/// The parts of a site, put together.
struct Parts {
    splats: Splats,
    /// The first part: its options, preprocessing and coder tables are those of all.
    first: Prior,
    /// Key frames and doubt of all; the display filter, the lens and the record if all have the same.
    extras: Extras,
}

impl Parts {
    fn read(args: &Args) -> anyhow::Result<Parts> {
        let open = |path| open_prior(path, &args.overrides);
        let first = open(&args.priors[0])?;
        let (mut splats, mut extras) = (first.splats().clone(), first.extras().clone());
        let mut poses = first.key_frames().poses().to_vec();
        for path in &args.priors[1..] {
            let part = open(path)?;
            let same = |what: &str, same: bool| {
                let one = args.priors[0].display();
                ensure!(same, "{}: not the same {what} as {one}", path.display());
                Ok(())
            };
            same("render options", part.options() == first.options())?;
            same("preprocessing", part.preprocessing() == first.preprocessing())?;
            same("coder tables", part.coder_tables() == first.coder_tables())?;
            same("degree of spherical harmonics", part.splats().sh_degree == splats.sh_degree)?;
            splats.append(&mut part.splats().clone());
            let shift = first.origin() - part.origin();
            poses.extend(part.key_frames().relative_to(shift).poses());
            let own = part.extras().clone();
            extras.filter_weights =
                extras.filter_weights.filter(|w| own.filter_weights.as_ref() == Some(w));
            extras.lens = extras.lens.filter(|lens| own.lens.as_ref() == Some(lens));
            extras.record = extras.record.filter(|record| own.record.as_ref() == Some(record));
            let doubts = extras.doubt.zip(own.doubt);
            extras.doubt = doubts.map(|(all, own)| [all, own].concat());
        }
        extras.key_frames = KeyFrames::new(poses)?;
        Ok(Parts { splats, first, extras })
    }
}
