//! Difference pictures coded at a rate.

use std::sync::Arc;

use crate::Picture;
use crate::packet::Residual;

use super::ResidualError;
use super::checks::check_size;
use super::interest::Interest;
use super::rate::{Rate, RateResult};
use super::stream::{Acknowledged, StreamEncoder, StreamFrame, Structure};
use super::tune::Tune;
use super::wavelet::{FrameKind, RateEncoder};
use crate::coder_tables::Tables;

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

/// A frame of a stream, and what it may be predicted from.
#[derive(Clone, Copy)]
pub struct InStream<'a> {
    /// The frame.
    pub frame: StreamFrame<'a>,
    /// Which frame is its reference.
    pub structure: Structure,
    /// The frames that the topside is known to hold.
    pub acknowledged: &'a Acknowledged,
}

/// Codes difference pictures of one size, in memory of its own.
pub struct ResidualEncoder {
    coder: Box<RateEncoder>,
    stream: StreamEncoder,
    /// The last frame has a residual, from which later ones may be predicted.
    keepable: bool,
    size: (u32, u32),
}

/// What an encoder of difference pictures is made for.
#[derive(Clone, Debug)]
pub struct ResidualSetup {
    /// Size of the pictures, pixels.
    pub width: u32,
    /// See `width`.
    pub height: u32,
    /// What counts.
    pub tune: Tune,
    /// The prior's tables.
    pub tables: Arc<Tables>,
    /// The topside draws this device's renders, byte for byte.
    pub portable: bool,
}

impl ResidualSetup {
    /// A coder of pictures of a size, with the generic tables, on a portable device.
    pub fn new(width: u32, height: u32) -> ResidualSetup {
        let tables = Arc::new(Tables::generic());
        ResidualSetup { width, height, tune: Tune::Psnr, tables, portable: true }
    }

    /// Whether an encoder made for one setup serves the other. Tables count as equal only if they are the same object.
    pub(crate) fn is_as(&self, other: &ResidualSetup) -> bool {
        (self.width, self.height) == (other.width, other.height)
            && (self.tune, self.portable) == (other.tune, other.portable)
            && Arc::ptr_eq(&self.tables, &other.tables)
    }
}

impl ResidualEncoder {
    /// Makes an encoder.
    pub fn new(setup: &ResidualSetup) -> ResidualEncoder {
        let ResidualSetup { width, height, tune, ref tables, portable } = *setup;
        let coder = Box::new(RateEncoder::new(width, height, tables, portable, tune));
        let size = (width, height);
        ResidualEncoder { coder, stream: StreamEncoder::default(), keepable: false, size }
    }

    /// Codes what the camera saw and the render did not. `overhead`: the length of everything else that counts against
    /// [`Rate::Bytes`], such as the packet's other parts. The residual part's own check is added here.
    ///
    /// With a budget or a target: if no difference picture improves the render, none is coded.
    pub fn encode<'a>(
        &'a mut self,
        frame: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        self.encode_any(frame, render, rate, overhead, None)
    }

    /// As [`ResidualEncoder::encode`], as a frame of a stream: it may be predicted from frames that were
    /// [kept](Self::keep).
    pub fn encode_in_stream<'a>(
        &'a mut self,
        frame: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
        stream: &InStream,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        stream.frame.check(self.size)?;
        self.encode_any(frame, render, rate, overhead, Some(stream))
    }

    /// Sets which parts of the picture get more of the bits, from here on; `None`: all get the same.
    pub fn set_interest(&mut self, interest: Option<&Arc<Interest>>) {
        self.coder.set_interest(interest);
    }

    /// Lets later frames be predicted from the one that was just coded. Call it if its packet was made.
    pub fn keep(&mut self, frame: &StreamFrame, render: &Picture) {
        if self.keepable {
            let (residual, shown, _) = self.coder.coded();
            self.stream.keep(frame, &residual, shown, render);
        }
    }

    /// Forgets the frames that were kept: the next one is intra.
    pub fn forget(&mut self) {
        self.stream.clear();
    }

    fn encode_any<'a>(
        &'a mut self,
        frame: &Picture,
        render: &'a Picture,
        rate: Rate,
        overhead: usize,
        stream: Option<&InStream>,
    ) -> Result<CodedResidual<'a>, ResidualError> {
        self.keepable = false;
        check_size(self.size, frame)?;
        check_size(self.size, render)?;
        if !rate.is_valid() {
            return Err(ResidualError::Rate(rate));
        }
        let source = match stream {
            None => FrameKind::AllIntra,
            Some(InStream { frame, structure, acknowledged }) => {
                let reference = self.stream.reference(frame, *structure, acknowledged);
                reference.map_or(FrameKind::Intra, FrameKind::Inter)
            }
        };
        let result = self.coder.encode(frame, render, rate, overhead, source);
        let RateResult { content, reached, probes } = result;
        let without = content.without_payload();
        self.keepable = stream.is_some() && without.is_none();
        let (residual, reconstruction, psnr) = match without {
            Some(without) => (without, render, frame.psnr(render)),
            None => self.coder.coded(),
        };
        Ok(CodedResidual { residual, reconstruction, psnr, probes, reached })
    }
}
