//! `nvsprior tables`: scene coder tables, trained on the frames of the mapping run.

mod gain;

use std::path::{Path, PathBuf};

use crate::mapping_run::MappingRunArgs;
use crate::{beside, record, row};
use anyhow::Context as _;
use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::prior::{PriorFormat, compact, filter_file, replace_file, tables_file};
use nvsprior_inputs::args::{PriorArgs, progress};
use nvsprior_inputs::values;
use nvsprior_train::coder_tables::{Pair, TableOptions, train_tables};

/// Train coder tables for a prior's scene on the frames of its mapping run
///
/// Finds the pose of each frame, starting from the one in the camera file, and draws the prior there. The tables of the
/// wavelet coder learn from frames and renders. Frames without a certain pose are left out. Every eighth frame is held
/// out, and the program prints what the tables save on these. The tables are part of the prior's identity: both sides
/// of a link need them.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    run: MappingRunArgs,
    /// Rounds of coding all frames and learning from it
    #[arg(long, value_name = "N", default_value_t = ROUNDS,
        value_parser = clap::value_parser!(u32).range(1..=100))]
    rounds: u32,
    /// What to write: .tables, the tables alone; .nvsg, a copy of an .nvsg with the tables in it [default:
    /// PRIOR.tables, which is read with the prior]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

const ROUNDS: u32 = 3;

/// A kind of file that tables are written to.
#[derive(Clone, Copy)]
enum Kind {
    Tables,
    Compact,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let path = &args.prior.prior;
    let name = path.display().to_string();
    let out = args.out.clone().unwrap_or_else(|| tables_file::path_beside(path));
    let kind = Kind::of(&out)?;
    // Not by its path: a broken file beside the prior is what this may be asked to replace.
    let bytes = std::fs::read(path).with_context(|| name.clone())?;
    let prior = Prior::from_bytes(&bytes, &name, &args.prior.overrides.overrides())?;
    kind.check(&out, &prior).with_context(|| out.display().to_string())?;
    values::check_file("--out", &out)?;
    let run = args.run.pairs(&prior)?;
    run.print();
    let tables = train(&run.learned, args.rounds as usize);
    let content = kind.content(&bytes, &tables)?;
    replace_file(&out, &content)?;
    if let Kind::Compact = kind {
        record::carry((path, &prior), &out)?;
        let filter = filter_file::open_beside(path)?;
        beside::check_filter(filter.as_ref(), &out)?;
        beside::place_filter(filter.as_ref(), &out)?;
    }
    gain::print(&run.held_out, &tables);
    row("written", format!("{}, {} bytes", out.display(), content.len()));
    row("identity", format!("{}", prior.with_coder_tables(Some(tables)).id()));
    Ok(())
}

/// Trains tables, beginning with the library's.
fn train(runs: &[Vec<Pair>], rounds: usize) -> Tables {
    let options = TableOptions { rounds, ..TableOptions::default() };
    let bar = progress(rounds, "training");
    bar.tick();
    train_tables(runs, Some(&Tables::generic()), &options, |_| bar.inc(1))
}

impl Kind {
    /// The kind that a name's ending stands for.
    fn of(path: &Path) -> anyhow::Result<Kind> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("tables") => Ok(Kind::Tables),
            Some("nvsg") => Ok(Kind::Compact),
            _ => anyhow::bail!("{}: ends in .tables or .nvsg", path.display()),
        }
    }

    /// Refuses a copy if the prior is no compact one, or if a file beside the copy would replace its tables.
    fn check(self, out: &Path, prior: &Prior) -> anyhow::Result<()> {
        let Kind::Compact = self else { return Ok(()) };
        let format = prior.report().format;
        anyhow::ensure!(
            format == PriorFormat::Compact,
            "the prior is no .nvsg but {format}; write a .tables file instead"
        );
        let beside = tables_file::path_beside(out);
        anyhow::ensure!(
            !beside.exists(),
            "{} takes precedence over tables in the copy; remove it first",
            beside.display()
        );
        Ok(())
    }

    /// The file's content; `bytes` is that of the prior.
    fn content(self, bytes: &[u8], tables: &Tables) -> anyhow::Result<Vec<u8>> {
        match self {
            Kind::Tables => Ok(tables.write()),
            Kind::Compact => Ok(compact::with_coder_tables(bytes, Some(tables))?),
        }
    }
}
