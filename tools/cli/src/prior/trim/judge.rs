//! What a reduced prior loses: measured on the device, on the prior as its file will hold it.

use std::path::{Path, PathBuf};
use std::time::Instant;

use indicatif::ProgressBar;
use nvsprior::prior::compact::Quantisation;
use nvsprior::prior::{Besides, Extras, Splats};
use nvsprior::{Engine, Prior};
use nvsprior_train::trim::{Judge, Round, TrimStep};

use crate::container::Container;
use crate::mission::{self, Mission};
use crate::picture_renderer::{PictureRenderer, compare_times};
use crate::view_set::{ViewSet, expected_loss};
use nvsprior_inputs::args::progress;
use nvsprior_inputs::report::row;

pub struct Loss {
    /// Against frames, dB.
    pub tolerance: f64,
    /// Least PSNR against the whole prior's pictures if there are no frames, dB.
    pub floor: f64,
    /// Whether pictures should look like the whole prior's, so that a difference within the margin
    /// counts as loss.
    pub distilled: bool,
}

/// Views at which renders are timed.
const TIMED: usize = 12;

/// The whole prior and all views; judges what is left of it.
pub struct Bench<'a> {
    engine: &'a Engine,
    prior: &'a Prior,
    pub whole: PictureRenderer,
    pub container: Container,
    /// Where the best so far is written.
    out: PathBuf,
    limits: Loss,
    /// The views that the fit knows.
    views: ViewSet,
    /// Views within their margin, which the fit does not know.
    near: ViewSet,
    /// The camera file's other splits.
    others: ViewSet,
    bar: ProgressBar,
    since: Instant,
}

impl<'a> Bench<'a> {
    pub fn new(
        engine: &'a Engine,
        prior: &'a Prior,
        mut whole: PictureRenderer,
        mission: &Mission,
        (container, out): (Container, &Path),
        limits: Loss,
    ) -> anyhow::Result<Bench<'a>> {
        let views = ViewSet::of(&mission.views, usize::MAX, &mut whole)?;
        let near = ViewSet::new(mission.near(1), None, &mut whole)?;
        let others = ViewSet::of(&mission.others, usize::MAX, &mut whole)?;
        let (bar, since) = (progress(0, "fitting"), Instant::now());
        let out = out.to_owned();
        Ok(Bench { engine, prior, whole, container, out, limits, views, near, others, bar, since })
    }

    /// The greatest loss that counts as none.
    pub fn tolerance(&self) -> f64 {
        if self.views.frames.is_some() { self.limits.tolerance } else { 0.0 }
    }

    /// Chooses the coarsest steps for a compact prior that by themselves cost at most a quarter of the tolerance, or
    /// stay 3 dB above the floor. Tries the usual steps, their half and so on, down to `finest` of them.
    pub fn coarsen(&mut self, finest: f32) -> anyhow::Result<()> {
        let Container::Compact(_) = self.container else { return Ok(()) };
        let room = if self.views.frames.is_some() { 0.25 * self.limits.tolerance } else { -3.0 };
        let mut factor = 1.0;
        loop {
            self.container = Container::Compact(Quantisation::default().scaled(factor));
            let loss = self.loss(self.prior.splats())?;
            if loss <= room || !(factor > finest) {
                say!("quantised in {factor} of the usual steps");
                return Ok(());
            }
            factor *= 0.5;
        }
    }

    pub fn renderer(&self, prior: &Prior) -> anyhow::Result<PictureRenderer> {
        PictureRenderer::new(self.engine, prior)
    }

    /// The greater of the losses at the views and within their margin. With frames, the loss at the
    /// views is measured against them. Within the margin there are no frames: there it is
    /// estimated, assuming that frames would differ from the whole prior's pictures as much as they
    /// do at the views. Without any frames, the loss is how far the PSNR is below the floor.
    fn loss_of(&mut self, small: &mut PictureRenderer) -> anyhow::Result<f64> {
        let (psnr, loss) = self.views.compare(small)?;
        let near = self.near.compare(small)?.0;
        let none = self.near.places.is_empty();
        Ok(match self.views.fidelity() {
            Some(_) if none || !self.limits.distilled => loss,
            Some(fidelity) => loss.max(expected_loss(fidelity, near)),
            None if none => self.limits.floor - psnr,
            None => self.limits.floor - psnr.min(near),
        })
    }

    /// The file of a reduced prior, with what the whole one holds besides splats. Its doubt is not known.
    fn content(&self, splats: &Splats) -> anyhow::Result<Vec<u8>> {
        let extras = Extras { doubt: None, ..self.prior.extras().clone() };
        self.container.write(splats, &Besides { extras: &extras, ..self.prior.besides() })
    }

    /// Writes a prior to the file asked for, or replaces it; its bytes.
    pub fn save(&self, splats: &Splats) -> anyhow::Result<usize> {
        let bytes = self.content(splats)?;
        self.container.save(&self.out, &bytes)?;
        Ok(bytes.len())
    }

    /// The prior as its file will hold it.
    fn stored(&self, splats: &Splats) -> anyhow::Result<Prior> {
        let bytes = self.content(splats)?;
        Ok(Prior::from_bytes(&bytes, "the reduced prior", &Default::default())?)
    }

    /// What became of the prior.
    pub fn print(&mut self, reduced: &Prior, before: u64, after: u64) -> anyhow::Result<()> {
        let of = |a: f64, b: f64| format!("{:.2} ×", a / b);
        let (all, left) = (self.prior.len(), reduced.len());
        row("identity", format!("{} → {}", self.prior.id(), reduced.id()));
        row("splats", format!("{all} → {left}, {:.1} % left out", percent(all - left, all)));
        let degrees = (self.prior.splats().sh_degree, reduced.splats().sh_degree);
        row("SH degree", format!("{} → {}", degrees.0, degrees.1));
        row("key frames", self.prior.key_frames().len().to_string());
        row("bytes", format!("{before} → {after}, {}", of(before as f64, after as f64)));
        let mut small = self.renderer(reduced)?;
        let timed: Vec<_> = mission::spaced(&self.views.places, TIMED).copied().collect();
        let times = compare_times(&mut self.whole, &mut small, &timed)?;
        let (a, b, ratio) = (times.first, times.second, times.ratio);
        row("render", format!("{a:.2} → {b:.2} ms, {ratio:.2} × (turn by turn, medians)"));
        let sets =
            [("views", &self.views), ("within margin", &self.near), ("other splits", &self.others)];
        for (name, set) in sets.into_iter().filter(|(_, set)| !set.places.is_empty()) {
            let (psnr, loss) = set.compare(&mut small)?;
            let mut text = format!("{} views, {psnr:.2} dB between the renders", set.places.len());
            if let Some(fidelity) = set.fidelity() {
                text += &format!("; against frames {fidelity:.2} dB, {loss:.3} dB lost");
                if !(loss <= self.limits.tolerance) {
                    text += ": more than at the views; more of them would help";
                }
            }
            row(name, text);
        }
        Ok(())
    }
}

fn percent(part: usize, of: usize) -> f64 {
    100.0 * part as f64 / of as f64
}

/// In words, what a round leaves out.
fn words(step: &TrimStep) -> String {
    match step {
        TrimStep::Unseen => "splats that no view shows".into(),
        TrimStep::OutOfRange => "splats out of range".into(),
        TrimStep::Band => "the highest band of spherical harmonics".into(),
        TrimStep::Share(share) => {
            format!("{:.1} % of the splats, those that show least", 100.0 * share)
        }
    }
}

impl Judge for Bench<'_> {
    type Error = anyhow::Error;

    fn loss(&mut self, splats: &Splats) -> anyhow::Result<f64> {
        let reduced = self.stored(splats)?;
        let mut small = self.renderer(&reduced)?;
        self.loss_of(&mut small)
    }

    fn told(&mut self, round: &Round, splats: &Splats) -> anyhow::Result<()> {
        self.bar.reset();
        // A run that is cut short leaves what it had.
        if round.kept {
            self.save(splats)?;
        }
        let Round { step, splats, loss, kept } = round;
        let verdict = if *kept { "left out" } else { "needed" };
        let lost = match self.views.frames {
            Some(_) => format!("{loss:.3} dB lost"),
            None => format!("{:.2} dB", self.limits.floor - loss),
        };
        let seconds = self.since.elapsed().as_secs_f64();
        let line =
            format!("{:8} {}: {splats} splats, {lost} ({seconds:.0} s)", verdict, words(step));
        self.bar.suspend(|| say!("{line}"));
        Ok(())
    }

    fn fitted(&mut self, done: u32, all: u32) {
        self.bar.set_length(all.into());
        self.bar.set_position(done.into());
    }
}
