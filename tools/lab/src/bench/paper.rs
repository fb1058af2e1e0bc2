//! `nvsprior-lab paper bench`: the paper's tables, row by row, on any frames.

mod between;
mod coders;
mod equal;
mod estimator;
pub(super) mod exchange;
pub(super) mod learned;
mod methods;
mod ours;
mod picture;
mod published;
mod report;
mod row;
mod runs;
mod starts;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nvsprior_inputs::input::starts_file;

use super::RunArgs;
use super::context::Context;
use estimator::{Estimates, estimates};
use learned::Learned;
use methods::Methods;
use report::Rows;
use runs::Runs;

/// Measure the methods of the paper's tables, and the program's own
///
/// WebP, JPEG XL, affine warps and BFGS with both, the program's own coder picture by picture and as a stream, and pose
/// estimators. JPEG XL needs `cjxl` and `djxl`. Coders of others, and the learned ones of `tools/paper`, come with
/// --learned. Methods that cannot be measured are named. Writes paper.json, paper-equal.json (all at one PSNR),
/// paper.md with what the paper reports beside each row, paper.svg, paper.png, and exchange/ for `tools/paper`. A CSV
/// file given with --starts holds the starts of a pose regressor (name,qw,qx,qy,qz,tx,ty,tz), which get a row of their
/// own.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// Folder of what other coders made of exchange/, a folder each: docs/paper.md
    #[arg(long, value_name = "DIR")]
    learned: Option<PathBuf>,
    /// Only N frames, spread evenly over the run
    #[arg(long, value_name = "N")]
    frames: Option<NonZeroUsize>,
}

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    // A file of starts is for a row of its own, and not for the encoder.
    let starts = &args.run.input.starts;
    let told = if starts_file(starts).is_some() { "first" } else { starts };
    args.run.measured_from(told, |context, folder| measure(args, context, folder))
}

fn measure(args: &Args, context: &mut Context, folder: &Path) -> anyhow::Result<()> {
    context.one_size("this command")?;
    let input = &args.run.input;
    if let Some(count) = args.frames {
        spread(context, count.get());
    }
    let learned = args.learned.as_deref().map(|dir| learned::read(dir, &context.shots));
    let learned = learned.transpose()?;
    let starts = starts_file(&input.starts).map(|file| starts::read(file, &context.shots));
    // How long the regressor takes is not known here.
    let starts = starts.transpose()?.map(|poses| Estimates { poses, ms: 0.0 });
    let set = input.split.as_deref().unwrap_or("all");
    let estimates = estimates(context)?;
    first_start(context, estimates.as_ref())?;
    row::announce("poses");
    let runs = Runs::new(context, estimates.as_ref(), starts.as_ref())?;
    exchange::write(&folder.join("exchange"), input, context, &runs.invs)?;
    let rows = rows(set, context, &runs, learned.as_ref(), starts.as_ref())?;
    report::print(&rows);
    report::write(folder, set, &runs.frames, &rows)
}

/// Keeps `count` frames, from the first to the last.
fn spread(context: &mut Context, count: usize) {
    let (all, count) = (context.shots.len(), count.min(context.shots.len()));
    let kept: Vec<usize> = (0..count).map(|i| i * (all - 1) / (count - 1).max(1)).collect();
    let mut index = 0;
    context.shots.retain(|_| {
        index += 1;
        kept.contains(&(index - 1))
    });
}

/// Takes an estimate as the first frame's start, if nothing else gives one: the paper does so.
fn first_start(context: &mut Context, estimates: Option<&Estimates>) -> anyhow::Result<()> {
    let first = &mut context.shots[0];
    if first.external.is_none() {
        let estimate = estimates.map(|estimates| estimates.poses[0]);
        first.external = Some(estimate.with_context(|| {
            format!(
                "{}: no start. Write its pose into the camera file, or give the prior key frames with `nvsprior \
                 key-frames`",
                first.file
            )
        })?);
    }
    Ok(())
}

fn rows(
    set: &str,
    context: &Context,
    runs: &Runs,
    learned: Option<&Learned>,
    starts: Option<&Estimates>,
) -> anyhow::Result<Rows> {
    let methods = Methods::new(context, runs, set)?;
    let anchor = methods.anchor()?;
    let mut equal = methods.equal(&anchor)?;
    let working = methods.working(&equal, learned, starts)?;
    let outside = learned.iter().flat_map(|learned| learned.methods());
    equal.extend(outside.filter_map(|method| between::at(method, &working, anchor.psnr)));
    Ok(Rows { working, target: anchor.psnr, equal })
}
