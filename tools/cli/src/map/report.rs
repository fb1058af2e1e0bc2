//! What a training came to: a curve, figures, and pictures.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nvsprior_inputs::plot::{Series, Words, draw};
use nvsprior_inputs::report::{Table, fixed, write_json};
use nvsprior_inputs::statistics::median;
use nvsprior_inputs::structure::Structure;
use nvsprior_train::mapper::Mapper;
use plotters::prelude::SeriesLabelPosition;
use serde_json::{Value, json};
use sysinfo::{ProcessRefreshKind, ProcessesToUpdate, System};

use super::inputs::HeldOut;
use super::sides::Sides;
use super::worth::Worth;
use nvsprior_runs::{SheetRow, write_contact_sheet};

/// Steps whose time counts: the last ones, with all splats in use.
const TIMED: usize = 200;
const ROWS: usize = 8;
/// So far below pictures that are trained on, held-out ones say that something is wrong, dB.
const FAR_BELOW: f64 = 3.0;
/// Held-out pictures that reach it are good enough, however well the others are known, dB.
const GOOD: f64 = 28.0;

struct Point {
    step: u32,
    seconds: f64,
    /// CPU time of the program until then, which other work on the machine changes less.
    cpu_seconds: Option<f64>,
    splats: u32,
    /// PSNR of each held-out picture, dB.
    psnr: Vec<f64>,
}

/// How poses were found.
pub struct Poses {
    registered: usize,
    pictures: usize,
    reprojection_error: Option<f64>,
    minutes: f64,
    doubtful: Vec<String>,
}

impl Poses {
    pub fn of(found: &Structure) -> Poses {
        Poses {
            registered: found.posed.inputs.len(),
            pictures: found.pictures,
            reprojection_error: found.reprojection_error,
            minutes: found.seconds / 60.0,
            doubtful: found.doubtful.iter().map(ToString::to_string).collect(),
        }
    }

    /// What a report says of them; nulls if they were given.
    pub fn json(poses: Option<&Poses>) -> serde_json::Map<String, Value> {
        let value = json!({
            "registered": poses.map(|poses| poses.registered),
            "pictures_given": poses.map(|poses| poses.pictures),
            "reprojection_error": poses.and_then(|poses| poses.reprojection_error),
            "pose_minutes": poses.map(|poses| poses.minutes),
            "poses_doubtful": poses.map(|poses| &poses.doubtful),
        });
        value.as_object().cloned().unwrap_or_default()
    }
}

/// What a mapping run is worth, as far as that was found out.
#[derive(Default)]
pub struct RunWorth {
    pub worth: Option<Worth>,
    pub sides: Option<Sides>,
}

#[derive(Default)]
pub struct Report {
    /// If poses had to be found.
    pub poses: Option<Poses>,
    folder: Option<PathBuf>,
    held_out: Vec<HeldOut>,
    points: Vec<Point>,
    /// Seconds of the last steps.
    times: VecDeque<f64>,
    /// Seconds of the whole training, on the clock and of the CPU.
    seconds: f64,
    cpu_seconds: Option<f64>,
}

/// The mean of some values, if there are any.
pub fn mean(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let count = values.clone().count();
    (count > 0).then(|| values.sum::<f64>() / count as f64)
}

/// CPU time of this program, all threads, if the system tells.
fn cpu_seconds() -> Option<f64> {
    let own = sysinfo::get_current_pid().ok()?;
    let mut system = System::new().ok()?;
    let cpu = ProcessRefreshKind::nothing().with_cpu();
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[own]), false, cpu);
    system.process(own).map(|process| process.accumulated_cpu_time() as f64 / 1e3)
}

impl Report {
    /// Into a folder, if there is one.
    pub fn new(folder: Option<&Path>, held_out: Vec<HeldOut>) -> Report {
        let folder = folder.map(Path::to_path_buf);
        Report { folder, held_out, ..Report::default() }
    }

    pub fn took(&mut self, time: Duration) {
        self.times.push_back(time.as_secs_f64());
        if self.times.len() > TIMED {
            self.times.pop_front();
        }
    }

    /// Notes how long all steps took.
    pub fn ended(&mut self, elapsed: Duration) {
        (self.seconds, self.cpu_seconds) = (elapsed.as_secs_f64(), cpu_seconds());
    }

    /// Steps per second, over the last steps.
    pub fn steps_per_second(&self) -> f64 {
        mean(self.times.iter().copied()).map_or(0.0, |seconds| 1.0 / seconds)
    }

    /// Mean over the held-out pictures, at the last measurement, dB.
    pub fn psnr(&self) -> Option<f64> {
        self.points.last().and_then(|point| mean(point.psnr.iter().copied()))
    }

    /// Measures the held-out pictures, and writes what is known so far.
    pub fn measure(&mut self, mapper: &mut Mapper, elapsed: Duration) -> anyhow::Result<()> {
        let mut psnr = Vec::with_capacity(self.held_out.len());
        for HeldOut { view, .. } in &self.held_out {
            psnr.push(view.psnr(&mapper.picture(&view.camera, &view.pose)?));
        }
        let (step, splats) = (mapper.steps(), mapper.alive());
        let (seconds, cpu_seconds) = (elapsed.as_secs_f64(), cpu_seconds());
        let point = Point { step, seconds, cpu_seconds, splats, psnr };
        let splits = self.by_split(&point);
        let shown: Vec<_> =
            splits.iter().map(|(split, psnr)| format!("{split} {psnr:.2} dB")).collect();
        if !shown.is_empty() {
            tell!("step {step}, {:.0} s, {splats} splats: {}", point.seconds, shown.join(", "));
        }
        self.points.push(point);
        let Some(folder) = self.folder.clone() else { return Ok(()) };
        let written = self
            .write_curve(&folder)
            .and_then(|()| self.write_preview(&folder.join("preview.png"), mapper));
        if let Err(error) = written {
            // Hours of training are not given up for a full disk.
            let place = folder.display();
            tell!("warning: {place}: {error:#}; the report of step {step} is not written");
        }
        Ok(())
    }

    fn by_split(&self, point: &Point) -> Vec<(String, f64)> {
        let mut splits: Vec<_> = self.held_out.iter().map(|held| held.split.clone()).collect();
        splits.sort_unstable();
        splits.dedup();
        let of = |split: String| {
            let own = self.held_out.iter().zip(&point.psnr).filter(|(held, _)| held.split == split);
            mean(own.map(|(_, psnr)| *psnr)).map(|psnr| (split.clone(), psnr))
        };
        splits.into_iter().filter_map(of).collect()
    }

    fn write_curve(&self, folder: &Path) -> anyhow::Result<()> {
        let mut table =
            Table::new(["step", "seconds", "cpu_seconds", "splats", "split", "psnr_db"]);
        let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
        for point in &self.points {
            for (split, psnr) in self.by_split(point) {
                let Point { step, seconds, cpu_seconds, splats, .. } = point;
                let (seconds_text, psnr_text) = (fixed(*seconds, 3), fixed(psnr, 4));
                table.push([
                    &step.to_string(),
                    &seconds_text,
                    &cpu_seconds.map_or(String::new(), |seconds| fixed(seconds, 3)),
                    &splats.to_string(),
                    &split,
                    &psnr_text,
                ]);
                match curves.iter_mut().find(|(name, _)| *name == split) {
                    Some((_, points)) => points.push((*seconds, psnr)),
                    None => curves.push((split, vec![(*seconds, psnr)])),
                }
            }
        }
        table.write_csv(&folder.join("curve.csv"))?;
        plot(&folder.join("curve.svg"), curves)
    }

    /// The worst held-out pictures first: camera, render, difference.
    fn write_preview(&self, path: &Path, mapper: &mut Mapper) -> anyhow::Result<()> {
        let mut order: Vec<usize> = (0..self.held_out.len()).collect();
        if let Some(point) = self.points.last() {
            order.sort_by(|a, b| point.psnr[*a].total_cmp(&point.psnr[*b]));
        }
        let mut rows = Vec::new();
        for i in order.into_iter().take(ROWS) {
            let view = &self.held_out[i].view;
            let render = mapper.picture(&view.camera, &view.pose)?;
            rows.push(SheetRow { frame: view.picture.clone(), render, reconstruction: None });
        }
        if !rows.is_empty() {
            write_contact_sheet(path, &rows)?;
        }
        Ok(())
    }

    /// PSNR of pictures that are trained on, as many as are held out, evenly spread; dB.
    fn trained_psnr(&self, mapper: &mut Mapper) -> anyhow::Result<Option<f64>> {
        let (count, all) = (self.held_out.len(), mapper.pictures());
        let chosen: Vec<_> = (0..count.min(all))
            .map(|i| i * all / count.min(all))
            .map(|i| (mapper.views()[i].clone(), mapper.poses()[i]))
            .collect();
        let mut psnr = Vec::with_capacity(chosen.len());
        for (view, pose) in &chosen {
            psnr.push(view.psnr(&mapper.picture(&view.camera, pose)?));
        }
        Ok(mean(psnr.iter().copied()))
    }

    /// What the two PSNR say of the poses.
    fn doubt(&self, trained: Option<f64>) -> Option<String> {
        let (held_out, trained) = (self.psnr()?, trained?);
        let doubtful = trained - held_out > FAR_BELOW && held_out < GOOD;
        doubtful.then(|| {
            format!(
                "pictures that were held out reach {held_out:.1} dB, those that were trained on {trained:.1} dB: the \
                 poses are wrong, or what a picture shows no other one does; look at preview.png, take more pictures \
                 that overlap, or give poses from elsewhere"
            )
        })
    }

    /// Writes the figures. `forward`: seconds of a forward render of the prior; `found`: what the run is worth.
    pub fn finish(
        &mut self,
        mapper: &mut Mapper,
        splats: usize,
        forward: f64,
        found: &RunWorth,
    ) -> anyhow::Result<()> {
        let trained = self.trained_psnr(mapper)?;
        let doubt = self.doubt(trained);
        if let Some(doubt) = &doubt {
            tell!("warning: {doubt}");
        }
        let Some(folder) = &self.folder else { return Ok(()) };
        let median = (!self.times.is_empty()).then(|| median(self.times.iter().copied()));
        let last = self.points.last();
        let pictures = last.into_iter().flat_map(|point| self.held_out.iter().zip(&point.psnr));
        let pictures: Vec<_> = pictures
            .map(|(held, psnr)| json!({ "name": held.name, "split": held.split, "psnr": psnr }))
            .collect();
        let splits: serde_json::Map<_, _> = last
            .into_iter()
            .flat_map(|point| self.by_split(point))
            .map(|(split, psnr)| (split, json!(psnr)))
            .collect();
        let mut report = Poses::json(self.poses.as_ref());
        let training = json!({
            "held_out_psnr": self.psnr(),
            // The prior as it was after so many steps: later ones are with the pictures that are held out.
            "held_out_step": last.map(|point| point.step),
            "expected_pose_error": found.worth.as_ref().map(Worth::json),
            "parallax": found.sides.as_ref().map(Sides::json),
            "trained_psnr": trained,
            "held_out_doubtful": doubt,
            "held_out_psnr_by_split": splits,
            "iterations": mapper.steps(),
            "seconds": self.seconds,
            "cpu_seconds": self.cpu_seconds,
            "seconds_per_iteration": median,
            "seconds_per_forward_render": forward,
            "iteration_in_forward_renders": median.map(|seconds| seconds / forward),
            "splats": splats,
            "pictures": pictures,
        });
        report.extend(training.as_object().cloned().unwrap_or_default());
        write_json(&folder.join("report.json"), &report)
    }
}

/// PSNR against training time, a curve per split; points as (seconds, dB).
fn plot(path: &Path, curves: Vec<(String, Vec<(f64, f64)>)>) -> anyhow::Result<()> {
    let curve = |(name, points)| Series { name, points, line: true, dots: true };
    let words = Words {
        caption: "PSNR of held-out pictures against training time",
        x: "seconds",
        y: "dB",
        legend: SeriesLabelPosition::LowerRight,
    };
    draw(path, &words, false, &curves.into_iter().map(curve).collect::<Vec<_>>(), &[])
}
