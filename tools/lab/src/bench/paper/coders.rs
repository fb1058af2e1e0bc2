//! WebP and JPEG XL, on frames and on difference pictures.

use anyhow::Context as _;

use super::row::{Coded, Setting};
use crate::bench::codecs::external::{self, External};
use crate::bench::codecs::own::Own;
use crate::bench::codecs::point::{Input, Mode};
use crate::bench::codecs::run::Run;

/// A method whose quality can be set.
pub trait Method {
    /// Its setting from the coarsest, 0, to the finest, 1.
    fn setting(&self, fine: f64) -> Setting;

    fn code(&self, setting: Setting) -> anyhow::Result<Coded>;

    /// A setting that brings each frame to a PSNR by itself, if there is one.
    fn each(&self, psnr: f64) -> Option<Setting>;
}

/// Distances of JPEG XL: coarsest and finest.
const DISTANCES: (f64, f64) = (25.0, 0.05);

pub enum Coder {
    Webp(Own),
    JpegXl(External),
}

impl Coder {
    pub fn webp() -> Coder {
        Coder::Webp(Own::webp("webp"))
    }

    /// `None` if it is not installed.
    pub fn jpeg_xl() -> Result<Coder, String> {
        let coder = external::jpeg_xl("jpeg-xl");
        match coder.is_installed() {
            true => Ok(Coder::JpegXl(coder)),
            false => Err(format!("not installed; needs {}", coder.needs())),
        }
    }
}

/// A coder of pictures on a run.
pub struct OnPictures<'a> {
    pub coder: &'a Coder,
    pub run: &'a Run,
    pub input: Input,
}

impl Method for OnPictures<'_> {
    fn setting(&self, fine: f64) -> Setting {
        let (coarsest, finest) = DISTANCES;
        match self.coder {
            Coder::Webp(_) => Setting::Quality(100.0 * fine),
            Coder::JpegXl(_) => Setting::Distance(coarsest * (finest / coarsest).powf(fine)),
        }
    }

    fn each(&self, psnr: f64) -> Option<Setting> {
        matches!(self.coder, Coder::Webp(_)).then_some(Setting::Psnr(psnr))
    }

    fn code(&self, setting: Setting) -> anyhow::Result<Coded> {
        let OnPictures { coder, run, input } = *self;
        let outcome = match (coder, setting.clone()) {
            (Coder::JpegXl(coder), Setting::Distance(distance)) => {
                coder.code(run, input, Mode::Intra, distance)?
            }
            (Coder::Webp(coder), setting) => {
                let rate = setting.rate().with_context(|| wrong(&setting))?;
                coder.code(run, input, rate)?
            }
            (Coder::JpegXl(_), setting) => anyhow::bail!(wrong(&setting)),
        };
        let (count, beside) = (run.len(), run.beside);
        Ok(Coded {
            setting,
            bytes: outcome.bytes as f64 / count + beside.bytes,
            encode_ms: outcome.encode_ms / count + beside.encode_ms,
            decode_ms: outcome.decode_ms / count + beside.decode_ms,
            shown: outcome.shown,
        })
    }
}

fn wrong(setting: &Setting) -> String {
    format!("the coder has no setting of this kind: {}", setting.text())
}
