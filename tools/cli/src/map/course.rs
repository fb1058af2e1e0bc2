//! A training from its first step to its last.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use nvsprior_inputs::estimate::range;
use nvsprior_train::mapper::Mapper;

use super::budget::Budget;
use super::report::Report;

/// How a training goes on.
pub struct Course<'a> {
    pub budget: Budget,
    pub save: &'a dyn Fn(&Mapper) -> anyhow::Result<()>,
    pub save_every: Duration,
}

/// At which shares of the training it is told how long the rest takes, and how many times as long as that it may take
/// at most. The first fifth has reduced pictures, and takes about a third of the time of later steps.
const LEFT_TOLD: [(f64, f64); 2] = [(0.02, 4.0), (0.25, 1.0)];

/// Share of the training after which the pictures that were held out are trained on, too.
const ALL_FROM: f64 = 0.85;

/// Measurements of a training, evenly spread.
const MEASUREMENTS: f64 = 20.0;

/// How many are due by a share of the training.
fn measurements(share: f64) -> u32 {
    (share.min(1.0) * MEASUREMENTS + 1e-6) as u32
}

impl Course<'_> {
    /// Trains until the budget is used up.
    pub fn run(&self, mapper: &mut Mapper, report: &mut Report) -> anyhow::Result<()> {
        let start = Instant::now();
        let bar = bar();
        let (mut saved, mut measured, mut left_told) = (Instant::now(), 0, 0);
        let held_out = mapper.holds_out();
        loop {
            let share = self.share(mapper, start);
            let due = measurements(share);
            // What was taken in tells nothing any more.
            if due > measured && mapper.holds_out() == held_out {
                measured = due;
                report.measure(mapper, start.elapsed())?;
            }
            if share >= 1.0 {
                break;
            }
            if share >= ALL_FROM && mapper.holds_out() {
                (self.save)(mapper)?;
                mapper.hold_out(&[]);
                tell!("step {}: the rest is with all pictures, in no step more", mapper.steps());
            }
            let began = Instant::now();
            mapper.step(share)?;
            report.took(began.elapsed());
            self.tell_left(&mut left_told, mapper, report);
            // What goes on from a state measures what is held out.
            if saved.elapsed() >= self.save_every && mapper.holds_out() == held_out {
                (self.save)(mapper)?;
                saved = Instant::now();
            }
            self.show(&bar, mapper, report, start);
        }
        bar.finish_and_clear();
        report.ended(start.elapsed());
        Ok(())
    }

    /// Says how long the rest takes, by the steps so far.
    fn tell_left(&self, told: &mut usize, mapper: &Mapper, report: &Report) {
        let Budget::Iterations(all) = self.budget else { return };
        let share = f64::from(mapper.steps()) / f64::from(all);
        let due = LEFT_TOLD.iter().filter(|(at, _)| share >= *at).count();
        if due > *told && share < 1.0 {
            let most = LEFT_TOLD[due - 1].1;
            *told = due;
            let left = f64::from(all - mapper.steps()) / report.steps_per_second();
            tell!("training: about {} left", range([left, most * left]));
        }
    }

    /// Share of the budget that is used.
    fn share(&self, mapper: &Mapper, start: Instant) -> f64 {
        match self.budget {
            Budget::Iterations(all) => f64::from(mapper.steps()) / f64::from(all),
            Budget::Seconds(all) => start.elapsed().as_secs_f64() / all,
        }
    }

    fn show(&self, bar: &ProgressBar, mapper: &Mapper, report: &Report, start: Instant) {
        bar.set_position((self.share(mapper, start) * BAR as f64) as u64);
        let psnr = report.psnr().map_or(String::new(), |psnr| format!(", held out {psnr:.2} dB"));
        let rate = report.steps_per_second();
        let splats = mapper.alive();
        bar.set_message(format!("step {}, {splats} splats, {rate:.1}/s{psnr}", mapper.steps()));
    }
}

const BAR: u64 = 10_000;

fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {percent}% {msg}, {eta} left");
    ProgressBar::new(BAR).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
