//! Searches by each method, each from one start, as if nothing were known before.

use nvsprior::{Encoder, EncoderOptions, Pose};
use nvsprior_paper::Optimizer;

use super::super::context::Context;
use super::super::searcher::Searcher;
use super::matching::Matching;
use super::method::{Attempt, Method};

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
