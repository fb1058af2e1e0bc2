//! The rate of a residual: by quality, by a byte budget, or by PSNR.

use std::sync::Arc;

use crate::Picture;
use crate::packet::Residual;

use super::difference::difference_into;
use super::interest::Interest;
use super::stream::{Acknowledged, StreamEncoder, StreamFrame, Structure};
use super::wavelet::{RateEncoder, Tables};
use super::webp_rate::WebpEncoder;
use super::{ResidualError, check_size};

/// What decides how finely the difference picture is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// 0 to 100. For the wavelet coder: the logarithm of its quantiser in even steps, from 76 levels to 2. For WebP:
    /// libwebp's own quality.
    Quality(f32),
    /// As fine as fits the packet's bytes. The budget is hard.
    Bytes(usize),
    /// As coarse as gives this PSNR, dB.
    Psnr(f64),
}

impl Rate {
    /// Checks that the number can be one.
    fn check(self) -> Result<(), ResidualError> {
        let sound = match self {
            Rate::Quality(quality) => (0.0..=100.0).contains(&quality),
            Rate::Psnr(target) => !target.is_nan(),
            Rate::Bytes(_) => true,
        };
        if sound { Ok(()) } else { Err(ResidualError::Rate(self)) }
    }
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
    /// How often the difference picture was coded.
    pub probes: u32,
    /// Whether the rate was kept. It is not if a budget holds no difference picture at all, or if the best one does not
    /// reach a PSNR.
    pub reached: bool,
}

/// What a search for a rate came to.
pub(super) struct Choice {
    /// Whether a difference picture was coded, and if not, why.
    pub residual: Result<(), Residual<'static>>,
    pub reached: bool,
    pub probes: u32,
}

/// A frame of a stream, and what it may lean on.
#[derive(Clone, Copy)]
pub struct InStream<'a> {
    /// The frame.
    pub frame: StreamFrame<'a>,
    /// Which frame it leans on.
    pub structure: Structure,
    /// The frames that the topside is known to hold.
    pub acknowledged: &'a Acknowledged,
}

/// Which coder codes difference pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResidualCoder {
    /// The wavelet coder, which knows the render.
    #[default]
    Wavelet,
    /// WebP, as in the paper.
    Webp,
}

/// Codes difference pictures of one size, in memory of its own.
pub struct ResidualEncoder {
    coder: AnyEncoder,
    stream: StreamEncoder,
    /// The last frame has a residual, which later ones may lean on.
    keepable: bool,
    /// A picture of the size that is coded.
    difference: Picture,
}

enum AnyEncoder {
    Wavelet(Box<RateEncoder>),
    Webp(Box<WebpEncoder>),
}

/// What an encoder of difference pictures is made for.
#[derive(Clone, Debug)]
pub struct ResidualSetup {
    /// Size of the pictures, pixels.
    pub width: u32,
    /// See `width`.
    pub height: u32,
    /// Which coder.
    pub coder: ResidualCoder,
    /// The prior's tables, of the wavelet coder.
    pub tables: Arc<Tables>,
    /// The topside draws this device's renders, byte for byte.
    pub portable: bool,
}

impl ResidualSetup {
    /// A coder of pictures of a size, with the generic tables, on a portable device.
    pub fn new(width: u32, height: u32, coder: ResidualCoder) -> ResidualSetup {
        let tables = Arc::new(Tables::generic());
        ResidualSetup { width, height, coder, tables, portable: true }
    }

    /// Whether an encoder made for one setup serves the other. Tables count as equal only if they are the same object.
    pub(crate) fn is_as(&self, other: &ResidualSetup) -> bool {
        (self.width, self.height) == (other.width, other.height)
            && (self.coder, self.portable) == (other.coder, other.portable)
            && Arc::ptr_eq(&self.tables, &other.tables)
    }
}

impl ResidualEncoder {
    /// Makes an encoder.
    pub fn new(setup: &ResidualSetup) -> ResidualEncoder {
        let ResidualSetup { width, height, coder, ref tables, portable } = *setup;
        let coder = match coder {
            ResidualCoder::Wavelet => {
                let coder = RateEncoder::new(width, height, tables, portable);
                AnyEncoder::Wavelet(Box::new(coder))
            }
            ResidualCoder::Webp => AnyEncoder::Webp(Box::new(WebpEncoder::new(width, height))),
        };
        let difference = Picture::new(width, height);
        ResidualEncoder { coder, stream: StreamEncoder::default(), keepable: false, difference }
    }

    /// Codes what the camera saw and the render did not. `overhead`: the length of everything else that counts against
    /// [`Rate::Bytes`], such as the packet's latent and camera part and link headers. The residual part's own length
    /// and check are added here.
    ///
    /// With a budget or a target: if no difference picture improves the render, none is coded.
    pub fn encode<'a>(
        &'a mut self,
        camera: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        check_size(&self.difference, camera)?;
        check_size(&self.difference, render)?;
        if matches!(self.coder, AnyEncoder::Webp(_)) {
            difference_into(camera, render, &mut self.difference);
        }
        self.encode_own(camera, render, rate, overhead, None)
    }

    /// As [`ResidualEncoder::encode`], for the bytes of [`super::difference()`]. Swaps `difference` for another picture
    /// of its size.
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
        self.encode_own(camera, render, rate, overhead, None)
    }

    /// As [`ResidualEncoder::encode`], as a frame of a stream: it may lean on frames that were [kept](Self::keep).
    /// [`ResidualCoder::Webp`] codes it by itself.
    pub fn encode_in_stream<'a>(
        &'a mut self,
        camera: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
        stream: &InStream,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        check_size(&self.difference, camera)?;
        check_size(&self.difference, render)?;
        stream.frame.check(&self.difference)?;
        if matches!(self.coder, AnyEncoder::Webp(_)) {
            difference_into(camera, render, &mut self.difference);
        }
        self.encode_own(camera, render, rate, overhead, Some(stream))
    }

    /// Sets which parts of the picture get more of the bits, from here on; `None`: all get the same. WebP knows no such
    /// parts.
    pub fn set_interest(&mut self, interest: Option<&Arc<Interest>>) {
        if let AnyEncoder::Wavelet(coder) = &mut self.coder {
            coder.set_interest(interest);
        }
    }

    /// Lets later frames lean on the one that was just coded. Call it if its packet was made.
    pub fn keep(&mut self, frame: &StreamFrame, render: &Picture) {
        if let AnyEncoder::Wavelet(coder) = &self.coder
            && self.keepable
        {
            let (residual, shown, _) = coder.coded();
            self.stream.keep(frame, &residual, shown, render);
        }
    }

    /// Forgets the frames that were kept: the next one stands alone.
    pub fn forget(&mut self) {
        self.stream.clear();
    }

    fn encode_own<'a>(
        &'a mut self,
        camera: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
        stream: Option<&InStream>,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        self.keepable = false;
        rate.check()?;
        let choice = match &mut self.coder {
            AnyEncoder::Wavelet(coder) => {
                let leanable = stream.map(|InStream { frame, structure, acknowledged }| {
                    self.stream.leanable(frame, *structure, acknowledged)
                });
                coder.encode(camera, render, rate, overhead, leanable.as_ref())
            }
            AnyEncoder::Webp(coder) => {
                coder.encode(camera, render, &self.difference, rate, overhead)?
            }
        };
        let Choice { residual, reached, probes } = choice;
        self.keepable = stream.is_some() && residual.is_ok();
        let (residual, reconstruction, psnr) = match (residual, &self.coder) {
            (Err(none), _) => (none, render, camera.psnr(render)),
            (Ok(()), AnyEncoder::Wavelet(coder)) => coder.coded(),
            (Ok(()), AnyEncoder::Webp(coder)) => coder.coded(),
        };
        Ok(CodedResidual { residual, reconstruction, psnr, probes, reached })
    }
}

#[cfg(test)]
mod tests;
