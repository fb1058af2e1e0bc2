//! The methods that are compared. Each is a search from one start, as if nothing were known before.

use nvsprior::{Encoder, EncoderOptions, Pose};
use nvsprior_paper::Optimizer;

use super::super::context::{Context, Sample};
use super::super::searcher::Searcher;
use super::matching::Matching;

/// A loss with an optimiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The mean squared error, by an optimiser.
    Mse(Optimizer),
    /// The matching loss: see [`Matching`].
    Matching,
}

impl Method {
    pub const BFGS: Method = Method::Mse(Optimizer::Bfgs);
    pub const ADAM: Method = Method::Mse(Optimizer::Adam);
    pub const ADAM_BFGS: Method = Method::Mse(Optimizer::AdamBfgs);
    pub const GAUSS_NEWTON: Method = Method::Mse(Optimizer::GaussNewton);

    /// Adam comes before Adam→BFGS, which goes on from it.
    pub const ALL: [Method; 5] =
        [Method::BFGS, Method::GAUSS_NEWTON, Method::Matching, Method::ADAM, Method::ADAM_BFGS];

    pub fn name(self) -> &'static str {
        match self {
            Method::Mse(optimizer) => optimizer.name(),
            Method::Matching => "matching",
        }
    }

    pub fn loss(self) -> &'static str {
        match self {
            Method::Mse(_) => "mse",
            Method::Matching => "matching",
        }
    }

    /// Whether a search takes hundreds of renders.
    pub fn slow(self) -> bool {
        matches!(self, Method::ADAM | Method::ADAM_BFGS)
    }
}

/// What a search came to and what it took.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// As a packet holds it.
    pub pose: Pose,
    /// Evaluations of the loss, at any level.
    pub iterations: usize,
    /// Renders at full resolution, the final picture included.
    pub full_renders: u32,
    /// From the frame to pose and final picture.
    pub milliseconds: f64,
    /// Of a forward render just before.
    pub forward_ms: f64,
    pub stop: String,
}

impl Attempt {
    pub fn of(sample: &Sample) -> Attempt {
        Attempt {
            pose: sample.pose,
            iterations: sample.trace.len(),
            full_renders: sample.stats.full_renders,
            milliseconds: sample.frame_ms(),
            forward_ms: sample.forward_ms,
            stop: format!("{:?}", sample.stats.stop).to_lowercase(),
        }
    }

    pub fn in_forward_renders(&self) -> f64 {
        self.milliseconds / self.forward_ms
    }

    /// Adds up this search and `first`, which it went on from. The picture of `first` was not needed.
    fn after(self, first: &Attempt) -> Attempt {
        Attempt {
            iterations: first.iterations + self.iterations,
            full_renders: first.full_renders.saturating_sub(1) + self.full_renders,
            milliseconds: first.milliseconds + self.milliseconds,
            ..self
        }
    }
}

/// One of each kind of search.
pub struct Searches {
    bfgs: nvsprior_paper::Encoder,
    gauss_newton: Encoder,
    adam: nvsprior_paper::Encoder,
    matching: Matching,
}

impl Searches {
    pub fn new(context: &Context) -> anyhow::Result<Searches> {
        let options = EncoderOptions { rate: None, ..context.options() };
        Ok(Searches {
            bfgs: context.papers(Optimizer::Bfgs)?,
            gauss_newton: context.encoder(options)?,
            adam: context.papers(Optimizer::Adam)?,
            matching: Matching::new(),
        })
    }

    /// The encoder for a method; that of BFGS if the method has none of its own.
    pub fn encoder(&mut self, method: Method) -> &mut dyn Searcher {
        match method {
            Method::GAUSS_NEWTON => &mut self.gauss_newton,
            Method::ADAM => &mut self.adam,
            _ => &mut self.bfgs,
        }
    }

    /// Searches from a start. `adam`: Adam's outcome from the same start, if it is known. Adam→BFGS
    /// then goes on from it.
    pub fn search(
        &mut self,
        context: &mut Context,
        method: Method,
        shot: usize,
        start: &Pose,
        adam: Option<&Attempt>,
    ) -> anyhow::Result<Attempt> {
        match (method, adam) {
            (Method::Matching, _) => return self.matching.minimise(context, shot, start),
            (Method::ADAM_BFGS, Some(adam)) => {
                let second = self.search(context, Method::BFGS, shot, &adam.pose, None)?;
                return Ok(second.after(adam));
            }
            (Method::ADAM_BFGS, None) => {
                let adam = self.search(context, Method::ADAM, shot, start, None)?;
                return self.search(context, method, shot, start, Some(&adam));
            }
            _ => {}
        }
        let encoder = self.encoder(method);
        encoder.reset();
        Ok(Attempt::of(&context.sample(encoder, shot, Some(*start))?))
    }
}
