//! How many bytes a residual takes: by quality, by a budget, or by the picture wanted.

use crate::Picture;
use crate::packet::{Residual, residual_part_len};

use super::{ResidualError, apply, check_shape, decode_difference, difference, webp};

/// What decides how finely the difference picture is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Libwebp's quality, 0 to 100.
    Quality(f32),
    /// As fine as fits the packet's bytes. The budget is hard.
    Bytes(usize),
    /// As coarse as gives this PSNR, dB.
    Psnr(f64),
}

/// A coded difference picture, and what the decoder will make of it.
#[derive(Clone, Debug)]
pub struct CodedResidual {
    /// What to put in the packet.
    pub residual: Residual,
    /// The picture that the decoder will show, from the actual payload.
    pub reconstruction: Picture,
    /// Its PSNR against the camera's picture, dB.
    pub psnr: f64,
    /// Libwebp's quality; `None` where there is no difference picture.
    pub quality: Option<f32>,
    /// How often the difference picture was coded.
    pub probes: u32,
    /// Whether the rate asked for was kept: not where a budget holds no difference picture at all,
    /// or where the best one falls short of a PSNR.
    pub reached: bool,
}

/// Steps of the bisection. Libwebp has 128 quantisers, so seven steps tell them all apart.
const STEPS: u32 = 7;

/// Codes what the camera saw and the render did not. `overhead` is the length of everything else
/// that counts against [`Rate::Bytes`]: the packet's latent and camera part, link headers. The
/// residual part's own length and check are counted here.
///
/// Under a budget or a target, where no difference picture makes the render any better, none is
/// coded.
pub fn encode_residual(
    camera: &Picture,
    render: &Picture,
    rate: Rate,
    overhead: usize,
) -> Result<CodedResidual, ResidualError> {
    let found = (render.width, render.height);
    if found != (camera.width, camera.height) {
        return Err(ResidualError::Size { expected: (camera.width, camera.height), found });
    }
    check_shape(camera)?;
    check_shape(render)?;
    let mut coder = Prober { camera, render, difference: difference(camera, render), probes: 0 };
    match rate {
        Rate::Quality(quality) if (0.0..=100.0).contains(&quality) => {
            let probe = coder.probe(quality)?;
            Ok(coder.coded(probe, true))
        }
        Rate::Bytes(budget) => coder.within(budget, overhead),
        Rate::Psnr(target) if !target.is_nan() => coder.reaching(target),
        Rate::Quality(_) | Rate::Psnr(_) => Err(ResidualError::Rate(rate)),
    }
}

/// One coding of the difference picture.
struct Probe {
    quality: f32,
    residual: Residual,
    /// Length of the residual part.
    part_len: usize,
    reconstruction: Picture,
    psnr: f64,
}

struct Prober<'a> {
    camera: &'a Picture,
    render: &'a Picture,
    difference: Picture,
    probes: u32,
}

impl Prober<'_> {
    fn probe(&mut self, quality: f32) -> Result<Probe, ResidualError> {
        self.probes += 1;
        let (coder, payload) = webp::encode(&self.difference, quality)?;
        let decoded = decode_difference(coder, &payload, self.render)?;
        let reconstruction = apply(self.render, &decoded);
        let psnr = self.camera.psnr(&reconstruction);
        let part_len = residual_part_len(payload.len());
        let residual = Residual::Coded { coder, payload };
        Ok(Probe { quality, residual, part_len, reconstruction, psnr })
    }

    /// The best picture within the budget.
    fn within(mut self, budget: usize, overhead: usize) -> Result<CodedResidual, ResidualError> {
        let room = budget.saturating_sub(overhead);
        if room <= residual_part_len(0) {
            return Ok(self.uncoded(Residual::Omitted, false));
        }
        let fits = |probe: &Probe| probe.part_len <= room;
        let best =
            self.bisect(fits, |new, old| fits(new) && !(fits(old) && old.psnr >= new.psnr))?;
        Ok(if fits(&best) {
            self.if_better(best, true)
        } else {
            self.uncoded(Residual::Omitted, false)
        })
    }

    /// The fewest bytes that reach the target, or the best picture there is.
    fn reaching(mut self, target: f64) -> Result<CodedResidual, ResidualError> {
        if self.camera.psnr(self.render) >= target {
            return Ok(self.uncoded(Residual::None, true));
        }
        let reaches = |probe: &Probe| probe.psnr >= target;
        let best = self.bisect(
            |probe| !reaches(probe),
            |new, old| match (reaches(new), reaches(old)) {
                (true, true) => new.part_len < old.part_len,
                (false, false) => new.psnr > old.psnr,
                (new, _) => new,
            },
        )?;
        let reached = reaches(&best);
        Ok(self.if_better(best, reached))
    }

    /// Codes at qualities that close in on the one where `finer` turns from true to false; at the
    /// end of the range too, where no such turn was met. The probe that is `preferred` over all
    /// others met.
    fn bisect(
        &mut self,
        finer: impl Fn(&Probe) -> bool,
        preferred: impl Fn(&Probe, &Probe) -> bool,
    ) -> Result<Probe, ResidualError> {
        let (mut low, mut high) = (0.0, 1.0);
        let mut best = self.probe(quality_of(0.5))?;
        if finer(&best) {
            low = 0.5
        } else {
            high = 0.5
        }
        for step in 1..=STEPS {
            let level = if step < STEPS {
                0.5 * (low + high)
            } else if low == 0.0 {
                low
            } else if high == 1.0 {
                high
            } else {
                break;
            };
            let probe = self.probe(quality_of(level))?;
            if finer(&probe) {
                low = level
            } else {
                high = level
            }
            if preferred(&probe, &best) {
                best = probe;
            }
        }
        Ok(best)
    }

    fn if_better(self, probe: Probe, reached: bool) -> CodedResidual {
        if probe.psnr > self.camera.psnr(self.render) {
            self.coded(probe, reached)
        } else {
            self.uncoded(Residual::None, reached)
        }
    }

    fn coded(self, probe: Probe, reached: bool) -> CodedResidual {
        let Probe { quality, residual, reconstruction, psnr, .. } = probe;
        let quality = Some(quality);
        CodedResidual { residual, reconstruction, psnr, quality, probes: self.probes, reached }
    }

    fn uncoded(self, residual: Residual, reached: bool) -> CodedResidual {
        let reconstruction = self.render.clone();
        let psnr = self.camera.psnr(self.render);
        CodedResidual {
            residual,
            reconstruction,
            psnr,
            quality: None,
            probes: self.probes,
            reached,
        }
    }
}

/// The quality at which libwebp's quantiser, 127 to 0, lies at `1 − level` of its range: inverts
/// `QualityToCompression` of its `quant_enc.c`. Evenly spaced qualities would not do, as the lowest
/// hundredth of them spans a fifth of the quantisers: those that small packets need.
fn quality_of(level: f64) -> f32 {
    let linear = level.powi(3);
    let quality = if linear < 0.5 { 1.5 * linear } else { 0.5 * (linear + 1.0) };
    (100.0 * quality) as f32
}

#[cfg(test)]
mod tests;
