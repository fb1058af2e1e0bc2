//! `nvsprior-lab poses`: how far poses are off, beside what the encoder says of them.
//!
//! A run is encoded in order, with no pose from outside but the first frame's, under each of some conditions. The poses
//! of the camera file are the truth. A frame's *ratios* are its errors along and about the camera's axes, each as a
//! multiple of the stated standard deviation.

mod summary;

use std::path::Path;

use nvsprior::packet::{Residual, residual_part_len};
use nvsprior::residual::{ResidualEncoder, ResidualSetup};
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, FrameStats, Picture, Pose, Rate};
use nvsprior_inputs::args::progress;
use nvsprior_train::pose_trials::moved;

use super::RunArgs;
use super::context::Context;
use super::plot;
use super::recovery::Condition;
use nvsprior_inputs::report::{Table, fixed, write_json};
use nvsprior_inputs::statistics::median;
use summary::{Axis, Summary};

/// Measure how far poses are off, beside what the encoder says of them
///
/// Every frame must have its pose in the camera file. Writes poses.json, poses.csv and poses.svg.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// Of the frames as they are, or changed
    #[arg(long, value_name = "WHAT", value_enum, value_delimiter = ',', default_value = "plain")]
    conditions: Vec<Condition>,
    /// Also search for each frame by itself, from the true pose and from moved ones: how far below the best of all
    /// starts each ends
    #[arg(long)]
    restarts: bool,
}

/// The axes: translations along the camera's, and turns about them.
pub const AXES: [&str; 6] = ["x", "y", "z", "about x", "about y", "about z"];
/// Bytes are measured at these, dB.
const TARGETS: [f64; 3] = [29.0, 31.0, 33.0];

/// No error of a known position may be more deviations than this.
const MOST: f64 = 4.0;
/// Starts may end so far below the best of them, dB.
const BELOW: f64 = 0.3;
/// Smaller ratios are drawn here.
const LEAST: f64 = 0.01;

/// What was found for a frame.
struct FoundPose {
    file: String,
    /// From the camera file's pose to the one found, along and about the camera's axes: the prior's unit, radians.
    error: [f64; 6],
    stats: FrameStats,
    /// Bytes at each of [`TARGETS`].
    bytes: [usize; 3],
    /// How far below the best of all starts each start's render ends, dB; empty if they are not compared.
    below: Vec<f64>,
}

impl FoundPose {
    fn ratios(&self) -> [f64; 6] {
        let deviation = self.stats.pose_deviation();
        std::array::from_fn(|i| self.error[i].abs() / deviation[i])
    }
}

/// The frames of a run under a condition.
struct Run {
    condition: Condition,
    frames: Vec<FoundPose>,
}

/// Measures, prints and writes it all to a folder.
///
/// `conditions`: none is the frames as they are. `compares`: each frame is also searched for by itself.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| compare(&args.conditions, args.restarts, context, folder))
}

fn compare(
    conditions: &[Condition],
    compares: bool,
    context: &Context,
    folder: &Path,
) -> anyhow::Result<()> {
    for shot in &context.shots {
        let file = &shot.file;
        anyhow::ensure!(shot.known.is_some(), "{file}: its pose is not in the camera file");
    }
    context.one_size("this command")?;
    let count = conditions.len() * context.shots.len();
    let bar = progress(count, "poses");
    let measure = |condition: &Condition| {
        let frames = frames(context, *condition, compares, || bar.inc(1))?;
        Ok(Run { condition: *condition, frames })
    };
    let runs = conditions.iter().map(measure).collect::<anyhow::Result<Vec<Run>>>()?;
    bar.finish_and_clear();
    let summaries: Vec<Summary> = runs.iter().map(summary).collect();
    summary::print(&summaries);
    write_json(&folder.join("poses.json"), &summaries)?;
    table(&runs).write_csv(&folder.join("poses.csv"))?;
    plot::pose_ratios(&folder.join("poses.svg"), curves(&runs))
}

/// Finds the poses of the run under a condition.
fn frames(
    context: &Context,
    condition: Condition,
    compares: bool,
    done: impl Fn(),
) -> anyhow::Result<Vec<FoundPose>> {
    let options = EncoderOptions { rate: None, ..context.options() };
    let mut alone = compares.then(|| context.encoder(options.clone())).transpose()?;
    let mut encoder = context.encoder(options)?;
    while encoder.prepare(usize::MAX)? > 0 {}
    let mut coder = ResidualEncoder::new(&coder_setup(context));
    let shots = &context.shots;
    let mut frames = Vec::new();
    for (number, shot) in shots.iter().enumerate() {
        let other = &shots[(number + shots.len() / 2) % shots.len()].picture;
        let given = condition.apply(&shot.picture, other, number as u64);
        // Without key frames a run has to begin somewhere.
        let start = if number == 0 { shot.external } else { None };
        let Encoded { render, pose, stats, .. } = encoder.encode(&given, shot.told(start))?;
        let mut bytes = [0; TARGETS.len()];
        for (bytes, target) in bytes.iter_mut().zip(TARGETS) {
            let coded = coder.encode(&given, &render, Rate::Psnr(target), 0)?;
            let payload = match coded.residual {
                Residual::Coded { payload, .. } => residual_part_len(payload.len()),
                _ => 0,
            };
            *bytes = stats.latent_bytes + payload;
        }
        let truth = shot.known.unwrap_or(pose);
        let error = pose.after(&truth.inverse()).log();
        let alone = alone.as_mut();
        let below = alone.map(|encoder| below(encoder, &given, &truth, &stats)).transpose()?;
        let below = below.unwrap_or_default();
        frames.push(FoundPose { file: shot.file.clone(), error, stats, bytes, below });
        done();
    }
    Ok(frames)
}

/// How far below the best of all starts each ends, dB: that of the run, the true pose, and moved ones.
fn below(
    encoder: &mut Encoder,
    frame: &Picture,
    truth: &Pose,
    found: &FrameStats,
) -> anyhow::Result<Vec<f64>> {
    let moved = moved(truth, found.observability.length);
    let mut reached = vec![found.render_psnr];
    for start in [*truth].into_iter().chain(moved) {
        encoder.reset();
        reached.push(encoder.encode(frame, Some(start))?.stats.render_psnr);
    }
    let best = reached.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Ok(reached.into_iter().map(|psnr| best - psnr).collect())
}

fn coder_setup(context: &Context) -> ResidualSetup {
    let Camera { width, height, .. } = context.shots[0].camera;
    let tables = context.scene.coder_tables().clone();
    let portable = context.engine.device().portable;
    let setup = ResidualSetup::new(width, height);
    ResidualSetup { tables, portable, ..setup }
}

fn summary(run: &Run) -> Summary {
    let frames = &run.frames;
    let certain: Vec<&FoundPose> = frames.iter().filter(|found| found.stats.certain).collect();
    let known = || frames.iter().filter(|found| found.stats.known.is_some());
    let wrong = |found: &&FoundPose| !found.ratios().iter().all(|ratio| *ratio <= MOST);
    let of = |figure: &dyn Fn(&FoundPose) -> f64| median(certain.iter().map(|found| figure(found)));
    let length = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mean = |figure: &dyn Fn(&FoundPose) -> f64| {
        frames.iter().map(figure).sum::<f64>() / frames.len() as f64
    };
    Summary {
        condition: run.condition.name(),
        frames: frames.len(),
        certain: certain.len(),
        known: known().count(),
        known_and_wrong: known().filter(wrong).count(),
        axes: (0..6).map(|i| axis(i, &certain)).collect(),
        position_error: of(&|found| length(&found.error[..3])),
        rotation_error_degrees: of(&|found| length(&found.error[3..]).to_degrees()),
        render_psnr: mean(&|found| found.stats.render_psnr),
        bytes: std::array::from_fn(|i| mean(&|found| found.bytes[i] as f64)),
        starts_apart: (!frames[0].below.is_empty()).then(|| {
            mean(&|found| f64::from(u8::from(found.below.iter().any(|below| *below > BELOW))))
        }),
    }
}

fn axis(i: usize, certain: &[&FoundPose]) -> Axis {
    let share = |holds: &dyn Fn(&FoundPose) -> bool| {
        certain.iter().filter(|found| holds(found)).count() as f64 / certain.len() as f64
    };
    let deviation = |found: &FoundPose| found.stats.pose_deviation()[i];
    Axis {
        name: AXES[i],
        error: median(certain.iter().map(|found| found.error[i].abs())),
        deviation: median(certain.iter().map(|found| deviation(found))),
        within_2: share(&|found| found.ratios()[i] <= 2.0),
        within_4: share(&|found| found.ratios()[i] <= MOST),
        open: share(&|found| deviation(found).is_infinite()),
    }
}

/// A row for each frame.
fn table(runs: &[Run]) -> Table {
    let what = ["condition", "file", "certain", "known", "render_psnr"];
    let both = ["error", "deviation"].map(|what| AXES.map(|axis| format!("{what} {axis}")));
    let header = what.map(str::to_owned).into_iter().chain(both.concat());
    let header = header.chain(TARGETS.map(|target| format!("bytes_{target}_db")));
    let mut table = Table::new(header.chain(["starts_below_db".to_owned()]));
    for Run { condition, frames } in runs {
        for found in frames {
            let FoundPose { file, error, stats, bytes, below } = found;
            let told = [
                condition.name().to_owned(),
                file.clone(),
                stats.certain.to_string(),
                stats.known.map_or(String::new(), |known| known.position.to_string()),
                fixed(stats.render_psnr, 3),
            ];
            let numbers = error.iter().copied().chain(stats.pose_deviation());
            let bytes = bytes.map(|bytes| bytes.to_string());
            let below: Vec<String> = below.iter().map(|below| fixed(*below, 3)).collect();
            let row = told.into_iter().chain(numbers.map(|v| v.to_string())).chain(bytes);
            table.push(row.chain([below.join(" ")]));
        }
    }
    table
}

/// How large a share of the certain frames is off by at most so many stated deviations, by axis.
fn curves(runs: &[Run]) -> Vec<plot::Curve> {
    let certain = || runs.iter().flat_map(|run| &run.frames).filter(|found| found.stats.certain);
    let curve = |(i, name): (usize, &str)| {
        let mut ratios: Vec<f64> = certain().map(|found| found.ratios()[i]).collect();
        ratios.sort_by(f64::total_cmp);
        let share = |k: usize| (k + 1) as f64 / ratios.len() as f64;
        let points = ratios.iter().enumerate().map(|(k, ratio)| (ratio.max(LEAST), share(k)));
        (name.to_owned(), points.collect())
    };
    AXES.into_iter().enumerate().map(curve).collect()
}
