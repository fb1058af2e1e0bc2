//! WebP at a rate: by quality, by a budget, or by the picture wanted.

use nvsprior::residual::{add, difference, max_payload_len};
use nvsprior::{Picture, Rate};

use super::Webp;
use super::payload::Payload;
use crate::error::WebpError;

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
}

/// A coded difference picture, and what the decoder will make of it.
#[derive(Clone, Copy, Debug)]
pub struct Coded<'a> {
    /// `None`: none would improve the render, the render is good enough, or the budget holds none.
    pub payload: Option<Payload<'a>>,
    /// The picture that the decoder will show.
    pub reconstruction: &'a Picture,
    /// Its PSNR against the camera's picture, dB.
    pub psnr: f64,
    /// Whether the rate was kept.
    pub reached: bool,
}

#[derive(Clone, Copy)]
struct Source<'a> {
    frame: &'a Picture,
    render: &'a Picture,
}

/// Whether a difference picture was coded, and whether the rate was kept.
type Fitted = (bool, bool);

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
        }
    }

    /// Codes what the camera saw and the render did not. `overhead`: what else counts against [`Rate::Bytes`].
    ///
    /// With a budget or a target: if no difference picture improves the render, none is coded.
    ///
    /// # Errors
    /// If libwebp fails.
    ///
    /// # Panics
    /// If frame and render are not of the size that it was made for.
    pub fn encode<'a>(
        &'a mut self,
        frame: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<Coded<'a>, WebpError> {
        self.difference = difference(frame, render);
        let source = Source { frame, render };
        let (is_coded, reached) = match rate {
            Rate::Quality(quality) => {
                self.probe(&source, quality)?;
                self.keep();
                (true, true)
            }
            Rate::Bytes(budget) => self.within(&source, budget, overhead)?,
            Rate::Psnr(target) => self.reaching(&source, target)?,
        };
        let Probe { whole, ref payload, ref reconstruction, psnr, .. } = self.best;
        Ok(match is_coded {
            true => {
                let payload = Some(Payload { whole, bytes: payload });
                Coded { payload, reconstruction, psnr, reached }
            }
            false => {
                Coded { payload: None, reconstruction: render, psnr: frame.psnr(render), reached }
            }
        })
    }

    /// Codes at a quality; the outcome is in `trial`.
    fn probe(&mut self, source: &Source, quality: f32) -> Result<(), WebpError> {
        let Source { frame, render } = *source;
        let trial = &mut self.trial;
        trial.quality = quality;
        trial.whole = self.webp.encode(&self.difference, quality, &mut trial.payload)?;
        let (width, height) = (frame.width, frame.height);
        if trial.payload.len() > max_payload_len(width, height) {
            return Err(WebpError::Encode(format!("{} bytes", trial.payload.len())));
        }
        let payload = Payload { whole: trial.whole, bytes: &trial.payload };
        self.webp.decode(payload, &mut self.decoded)?;
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
    ) -> Result<Fitted, WebpError> {
        let room = budget.saturating_sub(overhead);
        if room == 0 {
            return Ok((false, false));
        }
        let fits = |probe: &Probe| probe.payload.len() <= room;
        let preferred =
            |new: &Probe, old: &Probe| fits(new) && !(fits(old) && old.psnr >= new.psnr);
        self.bisect(source, fits, preferred)?;
        Ok(if fits(&self.best) { (self.is_better(source), true) } else { (false, false) })
    }

    /// The fewest bytes that reach the target, or the best picture there is.
    fn reaching(&mut self, source: &Source, target: f64) -> Result<Fitted, WebpError> {
        if source.frame.psnr(source.render) >= target {
            return Ok((false, true));
        }
        let reaches = |probe: &Probe| probe.psnr >= target;
        let preferred = |new: &Probe, old: &Probe| match (reaches(new), reaches(old)) {
            (true, true) => new.payload.len() < old.payload.len(),
            (false, false) => new.psnr > old.psnr,
            (new, _) => new,
        };
        self.bisect(source, |probe| !reaches(probe), preferred)?;
        Ok((self.is_better(source), reaches(&self.best)))
    }

    /// Codes at qualities that close in on the one at which `finer` turns from true to false. If
    /// there is no such turn, also codes at the end of the range. `best` receives the one that is
    /// `preferred` over all others.
    fn bisect(
        &mut self,
        source: &Source,
        finer: impl Fn(&Probe) -> bool,
        preferred: impl Fn(&Probe, &Probe) -> bool,
    ) -> Result<(), WebpError> {
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

    fn is_better(&self, source: &Source) -> bool {
        self.best.psnr > source.frame.psnr(source.render)
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
