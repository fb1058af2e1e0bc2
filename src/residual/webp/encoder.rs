//! WebP at a rate: by quality, by a budget, or by the picture wanted.

use crate::Picture;
use crate::packet::{Residual, residual_part_len};

use super::super::difference::{add, difference_into};
use super::super::rate::{Content, Rate, RateResult};
use super::super::{ResidualError, max_payload_len};
use super::Webp;

/// Steps of the bisection. Libwebp has 128 quantisers, so seven steps tell them all apart.
const STEPS: u32 = 7;

/// Codes difference pictures of one size by WebP, in memory of its own.
pub struct WebpEncoder {
    webp: Webp,
    difference: Picture,
    /// What libwebp made of it.
    decoded: Picture,
    /// The coding to keep, and the one just tried.
    best: Probe,
    trial: Probe,
    probes: u32,
}

#[derive(Clone, Copy)]
struct Source<'a> {
    frame: &'a Picture,
    render: &'a Picture,
}

/// What was coded, and whether the rate was kept.
type Kept = (Content, bool);

/// One coding of the difference picture.
struct Probe {
    quality: f32,
    whole: bool,
    payload: Vec<u8>,
    reconstruction: Picture,
    psnr: f64,
}

impl Probe {
    fn new(width: u32, height: u32) -> Probe {
        Probe {
            quality: 0.0,
            whole: false,
            payload: Vec::with_capacity(max_payload_len(width, height)),
            reconstruction: Picture::new(width, height),
            psnr: f64::NEG_INFINITY,
        }
    }

    /// Length of the residual part.
    fn part_len(&self) -> usize {
        residual_part_len(self.payload.len())
    }
}

impl WebpEncoder {
    /// Makes one for pictures of a size.
    pub fn new(width: u32, height: u32) -> WebpEncoder {
        WebpEncoder {
            webp: Webp::new(width, height),
            difference: Picture::new(width, height),
            decoded: Picture::new(width, height),
            best: Probe::new(width, height),
            trial: Probe::new(width, height),
            probes: 0,
        }
    }

    /// Codes a difference picture; the outcome is in [`WebpEncoder::coded`].
    pub fn encode(
        &mut self,
        frame: &Picture,
        render: &Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<RateResult, ResidualError> {
        self.probes = 0;
        difference_into(frame, render, &mut self.difference);
        let source = Source { frame, render };
        let (content, reached) = match rate {
            Rate::Quality(quality) => {
                self.probe(&source, quality)?;
                self.keep();
                (Content::Payload, true)
            }
            Rate::Bytes(budget) => self.within(&source, budget, overhead)?,
            Rate::Psnr(target) => self.reaching(&source, target)?,
        };
        Ok(RateResult { content, reached, probes: self.probes })
    }

    /// What was coded, the picture that it makes, and its PSNR, dB.
    pub fn coded(&self) -> (Residual<'_>, &Picture, f64) {
        let Probe { whole, ref payload, ref reconstruction, psnr, .. } = self.best;
        (Residual::Webp { whole, payload }, reconstruction, psnr)
    }

    /// Codes at a quality; the outcome is in `trial`.
    fn probe(&mut self, source: &Source, quality: f32) -> Result<(), ResidualError> {
        let Source { frame, render } = *source;
        self.probes += 1;
        let trial = &mut self.trial;
        trial.quality = quality;
        trial.whole = self.webp.encode(&self.difference, quality, &mut trial.payload)?;
        let (width, height) = (frame.width, frame.height);
        if trial.payload.len() > max_payload_len(width, height) {
            return Err(ResidualError::Encode(format!("{} bytes", trial.payload.len())));
        }
        self.webp.decode(trial.whole, &trial.payload, &mut self.decoded)?;
        trial.reconstruction.data.copy_from_slice(&render.data);
        add(&self.decoded.data, &mut trial.reconstruction.data);
        trial.psnr = frame.psnr(&trial.reconstruction);
        Ok(())
    }

    /// Keeps the coding just tried.
    fn keep(&mut self) {
        std::mem::swap(&mut self.best, &mut self.trial);
    }

    /// The best picture within the budget.
    fn within(
        &mut self,
        source: &Source,
        budget: usize,
        overhead: usize,
    ) -> Result<Kept, ResidualError> {
        let room = budget.saturating_sub(overhead);
        if room <= residual_part_len(0) {
            return Ok((Content::NoRoom, false));
        }
        let fits = |probe: &Probe| probe.part_len() <= room;
        let preferred =
            |new: &Probe, old: &Probe| fits(new) && !(fits(old) && old.psnr >= new.psnr);
        self.bisect(source, fits, preferred)?;
        Ok(if fits(&self.best) { (self.if_better(source), true) } else { (Content::NoRoom, false) })
    }

    /// The fewest bytes that reach the target, or the best picture there is.
    fn reaching(&mut self, source: &Source, target: f64) -> Result<Kept, ResidualError> {
        if source.frame.psnr(source.render) >= target {
            return Ok((Content::NotNeeded, true));
        }
        let reaches = |probe: &Probe| probe.psnr >= target;
        let preferred = |new: &Probe, old: &Probe| match (reaches(new), reaches(old)) {
            (true, true) => new.part_len() < old.part_len(),
            (false, false) => new.psnr > old.psnr,
            (new, _) => new,
        };
        self.bisect(source, |probe| !reaches(probe), preferred)?;
        Ok((self.if_better(source), reaches(&self.best)))
    }

    /// Codes at qualities that close in on the one at which `finer` turns from true to false. If
    /// there is no such turn, also codes at the end of the range. `best` receives the one that is
    /// `preferred` over all others.
    fn bisect(
        &mut self,
        source: &Source,
        finer: impl Fn(&Probe) -> bool,
        preferred: impl Fn(&Probe, &Probe) -> bool,
    ) -> Result<(), ResidualError> {
        let (mut low, mut high) = (0.0, 1.0);
        for step in 0..=STEPS {
            let level = if step < STEPS {
                0.5 * (low + high)
            } else if low == 0.0 {
                low
            } else if high == 1.0 {
                high
            } else {
                break;
            };
            self.probe(source, quality_of(level))?;
            if finer(&self.trial) {
                low = level
            } else {
                high = level
            }
            if step == 0 || preferred(&self.trial, &self.best) {
                self.keep();
            }
        }
        Ok(())
    }

    fn if_better(&self, source: &Source) -> Content {
        Content::payload_if(self.best.psnr > source.frame.psnr(source.render))
    }
}

/// The quality at which libwebp's quantiser, 127 to 0, is at `1 − level` of its range. Inverts
/// `QualityToCompression` of its `quant_enc.c`. Evenly spaced qualities would be no good: the
/// lowest hundredth of them spans a fifth of the quantisers, those that small packets need.
fn quality_of(level: f64) -> f32 {
    let linear = level.powi(3);
    let quality = if linear < 0.5 { 1.5 * linear } else { 0.5 * (linear + 1.0) };
    (100.0 * quality) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_span_libwebps_quantisers_evenly() {
        // QualityToCompression of libwebp's quant_enc.c.
        let compression = |quality: f32| {
            let c = f64::from(quality) / 100.0;
            let linear = if c < 0.75 { c * (2.0 / 3.0) } else { 2.0 * c - 1.0 };
            linear.cbrt()
        };
        for step in 0..=16 {
            let level = f64::from(step) / 16.0;
            assert!((compression(quality_of(level)) - level).abs() < 1e-6);
        }
    }
}
