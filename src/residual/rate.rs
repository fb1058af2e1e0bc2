//! How many bytes a residual takes: by quality, by a budget, or by the picture wanted.

use crate::Picture;
use crate::packet::{Coder, Residual, residual_part_len};

use super::difference::{add, difference_into};
use super::{ResidualError, Webp, check_size, max_payload_len};

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
pub struct CodedResidual<'a> {
    /// What to put in the packet.
    pub residual: Residual<'a>,
    /// The picture that the decoder will show, from the actual payload.
    pub reconstruction: &'a Picture,
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

/// Codes difference pictures of one size, in memory of its own.
pub struct ResidualEncoder {
    webp: Webp,
    difference: Picture,
    /// What libwebp made of the difference.
    decoded: Picture,
    /// The coding to keep, and the one just tried.
    best: Probe,
    trial: Probe,
    probes: u32,
}

/// One coding of the difference picture.
struct Probe {
    quality: f32,
    coder: Coder,
    payload: Vec<u8>,
    reconstruction: Picture,
    psnr: f64,
}

impl Probe {
    fn new(width: u32, height: u32) -> Probe {
        Probe {
            quality: 0.0,
            coder: Coder::Vp8,
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

/// What the search came to.
enum Choice {
    /// The best coding.
    Coded,
    /// No difference picture, and why.
    Uncoded(Residual<'static>),
}

impl ResidualEncoder {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32) -> ResidualEncoder {
        ResidualEncoder {
            webp: Webp::new(width, height),
            difference: Picture::new(width, height),
            decoded: Picture::new(width, height),
            best: Probe::new(width, height),
            trial: Probe::new(width, height),
            probes: 0,
        }
    }

    /// Codes what the camera saw and the render did not. `overhead` is the length of everything else
    /// that counts against [`Rate::Bytes`]: the packet's latent and camera part, link headers. The
    /// residual part's own length and check are counted here.
    ///
    /// Under a budget or a target, if no difference picture makes the render any better, none is
    /// coded.
    pub fn encode<'a>(
        &'a mut self,
        camera: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        check_size(&self.difference, camera)?;
        check_size(&self.difference, render)?;
        difference_into(camera, render, &mut self.difference);
        self.encode_own(camera, render, rate, overhead)
    }

    /// [`ResidualEncoder::encode`], with the bytes of [`super::difference`] already at hand. `difference` is swapped
    /// for another picture of its size.
    pub fn encode_difference<'a>(
        &'a mut self,
        camera: &Picture,
        render: &'a Picture,
        difference: &mut Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        check_size(&self.difference, camera)?;
        check_size(&self.difference, render)?;
        check_size(&self.difference, difference)?;
        std::mem::swap(&mut self.difference, difference);
        self.encode_own(camera, render, rate, overhead)
    }

    fn encode_own<'a>(
        &'a mut self,
        camera: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        self.probes = 0;
        let (choice, reached) = match rate {
            Rate::Quality(quality) if (0.0..=100.0).contains(&quality) => {
                self.probe(camera, render, quality)?;
                self.keep();
                (Choice::Coded, true)
            }
            Rate::Bytes(budget) => self.within(camera, render, budget, overhead)?,
            Rate::Psnr(target) if !target.is_nan() => self.reaching(camera, render, target)?,
            Rate::Quality(_) | Rate::Psnr(_) => return Err(ResidualError::Rate(rate)),
        };
        let Probe { quality, coder, ref payload, ref reconstruction, psnr } = self.best;
        let probes = self.probes;
        Ok(match choice {
            Choice::Coded => {
                let residual = Residual::Coded { coder, payload };
                let quality = Some(quality);
                CodedResidual { residual, reconstruction, psnr, quality, probes, reached }
            }
            Choice::Uncoded(residual) => {
                let (psnr, quality) = (camera.psnr(render), None);
                CodedResidual { residual, reconstruction: render, psnr, quality, probes, reached }
            }
        })
    }

    /// Codes at a quality; the outcome is in `trial`.
    fn probe(
        &mut self,
        camera: &Picture,
        render: &Picture,
        quality: f32,
    ) -> Result<(), ResidualError> {
        self.probes += 1;
        let trial = &mut self.trial;
        trial.quality = quality;
        trial.coder = self.webp.encode(&self.difference, quality, &mut trial.payload)?;
        let (width, height) = (camera.width, camera.height);
        if trial.payload.len() > max_payload_len(width, height) {
            return Err(ResidualError::Encode(format!("{} bytes", trial.payload.len())));
        }
        self.webp.decode(trial.coder, &trial.payload, &mut self.decoded)?;
        trial.reconstruction.data.copy_from_slice(&render.data);
        add(&self.decoded.data, &mut trial.reconstruction.data);
        trial.psnr = camera.psnr(&trial.reconstruction);
        Ok(())
    }

    /// Keeps the coding just tried.
    fn keep(&mut self) {
        std::mem::swap(&mut self.best, &mut self.trial);
    }

    /// The best picture within the budget.
    fn within(
        &mut self,
        camera: &Picture,
        render: &Picture,
        budget: usize,
        overhead: usize,
    ) -> Result<(Choice, bool), ResidualError> {
        let room = budget.saturating_sub(overhead);
        if room <= residual_part_len(0) {
            return Ok((Choice::Uncoded(Residual::Omitted), false));
        }
        let fits = |probe: &Probe| probe.part_len() <= room;
        let preferred =
            |new: &Probe, old: &Probe| fits(new) && !(fits(old) && old.psnr >= new.psnr);
        self.bisect(camera, render, fits, preferred)?;
        Ok(if fits(&self.best) {
            (self.if_better(camera, render), true)
        } else {
            (Choice::Uncoded(Residual::Omitted), false)
        })
    }

    /// The fewest bytes that reach the target, or the best picture there is.
    fn reaching(
        &mut self,
        camera: &Picture,
        render: &Picture,
        target: f64,
    ) -> Result<(Choice, bool), ResidualError> {
        if camera.psnr(render) >= target {
            return Ok((Choice::Uncoded(Residual::None), true));
        }
        let reaches = |probe: &Probe| probe.psnr >= target;
        let preferred = |new: &Probe, old: &Probe| match (reaches(new), reaches(old)) {
            (true, true) => new.part_len() < old.part_len(),
            (false, false) => new.psnr > old.psnr,
            (new, _) => new,
        };
        self.bisect(camera, render, |probe| !reaches(probe), preferred)?;
        Ok((self.if_better(camera, render), reaches(&self.best)))
    }

    /// Codes at qualities that close in on the one where `finer` turns from true to false; at the
    /// end of the range too, if no such turn was met. The one that is `preferred` over all others
    /// met ends in `best`.
    fn bisect(
        &mut self,
        camera: &Picture,
        render: &Picture,
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
            self.probe(camera, render, quality_of(level))?;
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

    fn if_better(&self, camera: &Picture, render: &Picture) -> Choice {
        if self.best.psnr > camera.psnr(render) {
            Choice::Coded
        } else {
            Choice::Uncoded(Residual::None)
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
