//! The coders of packets, wavelet coder and WebP: without a container.

use std::sync::Arc;

use nvsprior::coder_tables::Tables;
use nvsprior::render::Scene;
use nvsprior::render::filter::FilterPlan;
use nvsprior::residual::{Rate, ResidualDecoder, ResidualEncoder, ResidualSetup, Tune, add};

use nvsprior::Picture;
use nvsprior_paper::{Webp, WebpEncoder};

use super::{CodedRun, Input, Mode, Point, Run};
use crate::bench::forward::timed;

#[derive(Clone, Copy)]
enum Coder {
    Wavelet,
    Webp,
}

pub struct Own {
    name: &'static str,
    coder: Coder,
    tune: Tune,
    tables: Arc<Tables>,
    portable: bool,
    /// What makes the display filter for pictures of a size; `None`: they are not filtered.
    filter: Option<FilterPlan>,
    /// Coarsest first.
    rates: Vec<Rate>,
}

impl Own {
    /// The wavelet coder, as an encoder of a scene has it.
    pub fn wavelet(scene: &Scene, portable: bool, tune: Tune) -> Own {
        Own {
            name: match tune {
                Tune::Psnr => "wavelet",
                Tune::Ssim => "wavelet tuned to ssim",
                Tune::Detection => "wavelet tuned to detection",
            },
            coder: Coder::Wavelet,
            tune,
            tables: scene.coder_tables().clone(),
            portable,
            filter: None,
            // Budgets reach coarser than quality 0.
            rates: [30, 60, 100, 180]
                .map(Rate::Bytes)
                .into_iter()
                .chain(qualities([0.0, 6.0, 12.0, 18.0, 24.0, 30.0, 36.0, 46.0, 60.0, 80.0]))
                .collect(),
        }
    }

    /// The wavelet coder, its pictures filtered for display.
    pub fn filtered(scene: &Scene, portable: bool, filter: FilterPlan) -> Own {
        let name = "wavelet with display filter";
        Own { name, filter: Some(filter), ..Own::wavelet(scene, portable, Tune::Psnr) }
    }

    pub fn webp(name: &'static str) -> Own {
        Own {
            name,
            coder: Coder::Webp,
            tune: Tune::Psnr,
            tables: Arc::new(Tables::generic()),
            portable: true,
            filter: None,
            rates: qualities([0.0, 2.0, 6.0, 15.0, 25.0, 35.0, 50.0, 65.0, 85.0]).collect(),
        }
    }

    pub fn name(&self) -> &'static str {
        self.name
    }

    /// How many points it gives for a kind of input.
    pub fn settings(&self) -> usize {
        self.rates.len()
    }

    /// Codes the run at each rate.
    pub fn measure(&self, run: &Run, input: Input, done: impl Fn()) -> anyhow::Result<Vec<Point>> {
        let point = |rate: &Rate| {
            let outcome = self.code(run, input, *rate)?;
            done();
            Ok(run.point(self.name, input, Mode::Intra, &outcome))
        };
        self.rates.iter().map(point).collect()
    }

    pub fn code(&self, run: &Run, input: Input, rate: Rate) -> anyhow::Result<CodedRun> {
        match self.coder {
            Coder::Wavelet => self.code_by_wavelets(run, input, rate),
            Coder::Webp => self.code_by_webp(run, input, rate),
        }
    }

    fn code_by_webp(&self, run: &Run, input: Input, rate: Rate) -> anyhow::Result<CodedRun> {
        let (width, height) = (run.frames[0].width, run.frames[0].height);
        let (mut encoder, mut decoder) =
            (WebpEncoder::new(width, height), Webp::new(width, height));
        let mut difference = Picture::new(width, height);
        let mut outcome = CodedRun::new(setting(rate));
        for (frame, base) in run.frames.iter().zip(run.bases(input)) {
            let (coded, ms) = timed(|| Ok(encoder.encode(frame, base, rate, 0)?))?;
            outcome.encode_ms += ms;
            let mut shown = base.clone();
            if let Some(payload) = coded.payload {
                outcome.bytes += payload.bytes.len();
                let mut decode = || {
                    decoder.decode(payload, &mut difference)?;
                    add(&difference.data, &mut shown.data);
                    Ok(())
                };
                outcome.decode_ms += timed(&mut decode)?.1;
            }
            let name = self.name;
            anyhow::ensure!(shown == *coded.reconstruction, "{name}: decoded to another picture");
            outcome.shown.push(shown);
        }
        Ok(outcome)
    }

    fn code_by_wavelets(&self, run: &Run, input: Input, rate: Rate) -> anyhow::Result<CodedRun> {
        let Own { tune, portable, .. } = *self;
        let (width, height) = (run.frames[0].width, run.frames[0].height);
        let tables = self.tables.clone();
        let setup = ResidualSetup { width, height, tune, tables, portable };
        let mut encoder = ResidualEncoder::new(&setup);
        let mut decoder = ResidualDecoder::new(width, height, &setup.tables);
        let filter = self.filter.as_ref().map(|parts| parts.filter(width, height));
        let mut filter = filter.transpose()?;
        let mut outcome = CodedRun::new(setting(rate));
        for (frame, base) in run.frames.iter().zip(run.bases(input)) {
            let (coded, ms) = timed(|| Ok(encoder.encode(frame, base, rate, 0)?))?;
            outcome.encode_ms += ms;
            outcome.bytes += coded.residual.payload().len();
            let mut shown = base.clone();
            let ((), ms) = timed(|| Ok(decoder.add(&coded.residual, portable, &mut shown)?))?;
            outcome.decode_ms += ms;
            let name = self.name;
            anyhow::ensure!(shown == *coded.reconstruction, "{name}: decoded to another picture");
            if let (Some(filter), Some(step)) = (&mut filter, decoder.step()) {
                let filtered = || Ok(filter.apply(step.index(), &base.data, &mut shown)?);
                outcome.decode_ms += timed(filtered)?.1;
            }
            outcome.shown.push(shown);
        }
        Ok(outcome)
    }
}

fn qualities<const N: usize>(values: [f32; N]) -> impl Iterator<Item = Rate> {
    values.into_iter().map(Rate::Quality)
}

/// The number of a rate.
fn setting(rate: Rate) -> f64 {
    match rate {
        Rate::Quality(quality) => f64::from(quality),
        Rate::Bytes(bytes) => bytes as f64,
        Rate::Psnr(psnr) => psnr,
    }
}
