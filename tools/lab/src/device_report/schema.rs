//! `report.json`: what is known of a device. Other programs rely on its names.

use std::path::Path;

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::host::Host;
use crate::bench::report::Figures;
use crate::ceilings::{Ceilings, Clock};
use nvsprior_inputs::statistics::Spread;
use nvsprior_reference::device_check::Verdict;

/// Rises if a name changes its meaning, or goes.
pub const VERSION: u32 = 1;
/// Digits of the report's numbers: more would be noise.
const DIGITS: usize = 4;

/// A device, measured. What could not be measured is `None`, and named in `not_measured` or `failures`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    pub version: u32,
    /// Version of the program.
    pub nvsprior: String,
    /// Check sum (CRC-32) of all shaders: figures of others are not compared with these.
    pub shaders: String,
    pub device: Option<DeviceFacts>,
    pub host: Host,
    /// The most that each part may do.
    pub bounds: Bounds,
    pub verify: Option<Verdict>,
    pub ceilings: Option<Best>,
    pub model: Model,
    pub sizes: Vec<Size>,
    pub not_measured: Vec<Missing>,
    /// Parts that should have worked.
    pub failures: Vec<Missing>,
    /// What all of it took.
    pub seconds: f64,
}

/// The most that each part of a report does. A part also ends when its share of the seconds is over.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, clap::Args)]
pub struct Bounds {
    /// Built-in scenes that are compared with the host's pictures
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub scenes: u64,
    /// Runs of each job whose stage times are averaged
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub runs: u32,
    /// Frames of each size that are searched for and coded, after a first one
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub frames: u32,
    /// Starts moved off by up to 3°, for each size
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub trials: u32,
    /// About how long all of it may take, once the program is built
    #[arg(long, value_name = "SECONDS", default_value_t = 360.0, value_parser = nvsprior_inputs::values::positive)]
    pub seconds: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceFacts {
    pub name: String,
    pub kind: String,
    pub driver: String,
    pub vulkan: String,
    /// Invocations of a subgroup.
    pub subgroup: u32,
    /// Form of the stages: lockstep, waves of a size, or plain.
    pub form: String,
    pub timestamps: bool,
    /// Whether the self-test found its arithmetic portable.
    pub portable: bool,
    /// Its largest heap.
    pub memory_bytes: u64,
}

/// A device's ceilings, and whose clock told them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    pub clock: Clock,
    #[serde(flatten)]
    pub rates: Ceilings,
    /// Of a dispatch that does nothing, with its barrier.
    pub dispatch_seconds: f64,
}

/// What stages are predicted by.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// `None`: there is no prediction.
    pub name: Option<String>,
    /// What the model takes for the ceilings.
    pub flops: Option<f64>,
    pub copy_bytes: Option<f64>,
    pub dispatch_seconds: Option<f64>,
}

/// What is measured at a size of pictures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Size {
    pub width: u32,
    pub height: u32,
    pub splats: usize,
    /// Frames drawn; the first one does not count.
    pub frames: usize,
    pub forward_render_ms: Option<f64>,
    pub stages: Vec<StageRow>,
    /// The search for each frame, which follows the one before, and the time of its forward renders.
    pub steady: Option<Figures>,
    /// The search from starts moved off, as if nothing were known before.
    pub perturbed_3deg: Option<Figures>,
    pub coding: Vec<Coding>,
    pub device_memory_bytes: Option<u64>,
    pub device_memory_used_bytes: Option<u64>,
    /// Most that the process has had so far.
    pub host_memory_bytes: Option<u64>,
}

/// A stage of a job, all its dispatches together: its fastest run. The job `search` is one of at most two evaluations
/// at full size, from a good start, with its pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageRow {
    pub job: String,
    pub name: String,
    pub ms: Option<f64>,
    pub bytes: f64,
    pub flops: f64,
    /// The longest of its bytes at the copy's rate and its operations at that of multiply-adds.
    pub ceiling_ms: Option<f64>,
    pub predicted_ms: Option<f64>,
}

/// Frames coded for a number of bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coding {
    /// Bytes of a packet, at most.
    pub budget_bytes: usize,
    /// Frames that count.
    pub frames: usize,
    pub bytes: Spread,
    pub psnr: Spread,
    /// The difference picture alone.
    pub residual_encode_ms: Spread,
    pub residual_decode_ms: Spread,
    /// From the frame to the packet: the search, frame after frame, and the difference picture. `None`: no search was
    /// measured.
    pub encode_ms: Option<Spread>,
    /// From the packet to the picture.
    pub decode_ms: Spread,
}

/// What is not known, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Missing {
    pub what: String,
    pub why: String,
}

impl Report {
    /// Whether all worked, and the device is portable.
    pub fn passed(&self) -> bool {
        let portable = self.verify.as_ref().is_some_and(|verdict| verdict.portable);
        portable && self.failures.is_empty()
    }

    /// Writes it, numbers rounded.
    pub fn write(&self, path: &Path) -> anyhow::Result<()> {
        let text = rounded(&serde_json::to_string_pretty(self)?);
        std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))
    }

    /// Reads one of this version.
    pub fn read(path: &Path) -> anyhow::Result<Report> {
        let reading = || format!("reading {}", path.display());
        let value: Value = serde_json::from_slice(&std::fs::read(path).with_context(reading)?)
            .with_context(reading)?;
        anyhow::ensure!(
            value["version"] == VERSION,
            "{}: a report of version {}, not {VERSION}",
            path.display(),
            value["version"]
        );
        serde_json::from_value(value).with_context(reading)
    }
}

impl Size {
    /// Milliseconds of all stages of a job: measured and predicted. `None` if that of a stage with a prediction is
    /// not known. Stages without one take next to nothing and do not count.
    pub fn of_job(&self, job: &str) -> [Option<f64>; 2] {
        let own = || self.stages.iter().filter(|row| row.job == job && row.predicted_ms.is_some());
        if own().next().is_none() {
            return [None; 2];
        }
        [own().map(|row| row.ms).sum(), own().map(|row| row.predicted_ms).sum()]
    }
}

/// Gives numbers that are not whole [`DIGITS`] digits, in JSON with a value a line.
fn rounded(json: &str) -> String {
    let line = |line: &str| {
        let (before, value) = line.rsplit_once(' ').unwrap_or(("", line));
        let (value, comma) = value.strip_suffix(',').map_or((value, ""), |value| (value, ","));
        let number = value.parse::<f64>().ok().filter(|_| value.contains(['.', 'e']));
        let rounded = number.and_then(|v| format!("{v:.*e}", DIGITS - 1).parse::<f64>().ok());
        rounded.map_or(line.to_owned(), |v| format!("{before} {v:?}{comma}"))
    };
    json.lines().map(|text| line(text) + "\n").collect()
}

#[cfg(test)]
pub mod tests {
    use super::*;

    fn spread(median: f64) -> Spread {
        Spread { median, p95: 2.0 * median, max: 3.0 * median }
    }

    /// A device with a stage that is measured and predicted, one that is only predicted, and one that is neither.
    pub fn report() -> Report {
        let stage = |name: &str, ms, predicted_ms| StageRow {
            job: "picture".into(),
            name: name.into(),
            ms,
            bytes: 1e6,
            flops: 2e9,
            ceiling_ms: Some(1.0),
            predicted_ms,
        };
        let coding = Coding {
            budget_bytes: 300,
            frames: 4,
            bytes: spread(298.0),
            psnr: spread(30.5),
            residual_encode_ms: spread(3.0),
            residual_decode_ms: spread(1.0),
            encode_ms: None,
            decode_ms: spread(7.0),
        };
        let size = Size {
            width: 320,
            height: 180,
            splats: 61_947,
            frames: 5,
            forward_render_ms: Some(12.5),
            stages: vec![
                stage("project", Some(3.0), Some(1.5)),
                stage("copy", Some(0.5), None),
                stage("splat", Some(6.0), Some(3.0)),
            ],
            steady: None,
            perturbed_3deg: None,
            coding: vec![coding],
            device_memory_bytes: Some(67_108_864),
            device_memory_used_bytes: Some(26_000_000),
            host_memory_bytes: None,
        };
        let missing = |what: &str, why: &str| Missing { what: what.into(), why: why.into() };
        Report {
            version: VERSION,
            nvsprior: "0.1.0".into(),
            shaders: "0123abcd".into(),
            device: Some(DeviceFacts {
                name: "A device".into(),
                kind: "integrated GPU".into(),
                driver: "driver 1.2".into(),
                vulkan: "1.3".into(),
                subgroup: 32,
                form: "waves of 32".into(),
                timestamps: true,
                portable: true,
                memory_bytes: 8 << 30,
            }),
            host: Host { board: Some("A board".into()), threads: 8, ..Host::default() },
            bounds: Bounds { scenes: 6, runs: 1, frames: 4, trials: 1, seconds: 60.0 },
            verify: Some(Verdict {
                portable: true,
                scenes: 6,
                pictures: 12,
                difference: None,
                check_sums: vec!["d7768a41".into()],
            }),
            ceilings: Some(Best {
                clock: Clock::Device,
                rates: Ceilings { flops: 1.5e12, bytes: 6e10 },
                dispatch_seconds: 4e-6,
            }),
            model: Model::default(),
            sizes: vec![size],
            not_measured: vec![missing("host memory", "the system does not tell")],
            failures: Vec::new(),
            seconds: 41.0,
        }
    }

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        let report = report();
        report.write(&path).unwrap();
        assert_eq!(Report::read(&path).unwrap(), report);
        let mut other: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        other["version"] = 2.into();
        std::fs::write(&path, other.to_string()).unwrap();
        let error = Report::read(&path).unwrap_err().to_string();
        assert!(error.contains("a report of version 2, not 1"), "{error}");
    }

    #[test]
    fn numbers_are_rounded_and_nothing_else() {
        let json = |a: &str, d: &str| {
            format!(
                "{{\n  \"a\": {a},\n  \"b\": 123456789,\n  \"c\": \"1.23456\",\n  \"d\": [\n    {d}\n  ]\n}}\n"
            )
        };
        assert_eq!(rounded(&json("12.34567", "2.00004e-7")), json("12.35", "2e-7"));
    }

    #[test]
    fn a_device_passes_if_it_is_portable_and_nothing_failed() {
        let good = report();
        assert!(good.passed());
        let failed = Missing { what: "ceilings".into(), why: "lost".into() };
        assert!(!Report { failures: vec![failed], ..good.clone() }.passed());
        assert!(!Report { verify: None, ..good.clone() }.passed());
        let verify = good.verify.clone().map(|verdict| Verdict { portable: false, ..verdict });
        assert!(!Report { verify, ..good }.passed());
    }

    #[test]
    fn a_jobs_sum_has_the_stages_that_are_predicted() {
        let mut size = report().sizes.remove(0);
        assert_eq!(size.of_job("picture"), [Some(9.0), Some(4.5)]);
        assert_eq!(size.of_job("search"), [None; 2]);
        size.stages[2].ms = None;
        assert_eq!(size.of_job("picture"), [None, Some(4.5)]);
    }
}
