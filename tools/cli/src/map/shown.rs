//! Work on standard error: a line for each step, and a bar while one runs.

use std::time::Instant;

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use nvsprior_inputs::progress::Progress;

#[derive(Default)]
pub struct Shown {
    running: Option<(Instant, String, ProgressBar)>,
    worked: bool,
}

impl Shown {
    /// Whether any step ran.
    pub fn worked(&self) -> bool {
        self.worked
    }

    pub fn show(&mut self, progress: Progress) {
        match progress {
            Progress::Says(text) => tell!("{text}"),
            Progress::Warns(text) => tell!("warning: {text}"),
            Progress::WasDone(step) => tell!("{step}: done before"),
            Progress::Begins(step) => {
                tell!("{step} …");
                self.worked = true;
                let bar = bar(step.clone());
                self.running = Some((Instant::now(), step, bar));
            }
            Progress::At(share) => {
                if let Some((.., bar)) = &self.running {
                    at(bar, share);
                }
            }
            Progress::Ends => {
                if let Some((start, step, bar)) = self.running.take() {
                    bar.finish_and_clear();
                    tell!("{step}: done in {:.0} s", start.elapsed().as_secs_f64());
                }
            }
        }
    }
}

const BAR: f64 = 1000.0;

fn bar(step: String) -> ProgressBar {
    let bar = ProgressBar::new(BAR as u64).with_message(step).with_finish(ProgressFinish::AndClear);
    styled(bar, "{msg} {bar:40} {percent} % {eta} left")
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

fn at(bar: &ProgressBar, share: Option<f64>) {
    if let Some(share) = share {
        bar.set_position((share * BAR) as u64);
        return;
    }
    if bar.length().is_some() {
        bar.unset_length();
        styled(bar.clone(), "{msg} {pos} in {elapsed}");
    }
    bar.inc(1);
}
