//! Residuals added to renders.

use crate::Picture;
use crate::packet::{Reference, Residual, ResidualStart};
use crate::range_coder::Tail;

use super::ResidualError;
use super::checks::check_size;
use super::stream::{StreamDecoder, StreamFrame};
use super::warp::Viewpoint;
use super::wavelet::{Payload, Step, WaveletDecoder};
use crate::coder_tables::Tables;

/// Adds residuals to renders of one size, in memory of its own.
pub struct ResidualDecoder {
    wavelet: WaveletDecoder,
    stream: StreamDecoder,
    size: (u32, u32),
}

impl ResidualDecoder {
    /// Makes one for pictures of a size, rendered from a prior with `tables`.
    pub fn new(width: u32, height: u32, tables: &Tables) -> ResidualDecoder {
        ResidualDecoder {
            wavelet: WaveletDecoder::new(width, height, tables),
            stream: StreamDecoder::default(),
            size: (width, height),
        }
    }

    /// Adds a residual to a render, which becomes the picture. Changes nothing on an error. `portable`: the render is
    /// the encoder's, byte for byte.
    ///
    /// # Errors
    /// If the payload is no picture of the render's size, or needs the encoder's render and this is another.
    pub fn add(
        &mut self,
        residual: &Residual,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        self.wavelet.forget_step();
        let (small_blocks, bytes) = match *residual {
            Residual::None | Residual::Omitted => return Ok(()),
            Residual::Coded { small_blocks, payload }
            | Residual::Stream { reference: None, small_blocks, payload } => {
                (small_blocks, payload)
            }
            Residual::Stream { reference: Some(_), .. } => return Err(OUT_OF_STREAM),
        };
        check_size(self.size, render)?;
        let payload = Payload { bytes, tail: Tail::Zeros, small_blocks };
        self.wavelet.add(payload, portable, render)
    }

    /// The quantiser's step of the residual added last; `None`: nothing was added, or its coder has none.
    pub fn step(&self) -> Option<Step> {
        self.wavelet.step()
    }

    /// Whether another one's reference frame is there, and the same as the encoder's.
    pub fn holds(&self, reference: Reference, frame: u32, viewpoint: &Viewpoint) -> bool {
        self.stream.holds(reference, frame, viewpoint)
    }

    /// As [`ResidualDecoder::add`], for a stream's residual that came whole. Later frames may be predicted from the
    /// frame if the render is the encoder's. `frame` needs depths only if the residual is predicted from another. A
    /// residual of no stream is added as it is.
    ///
    /// # Errors
    /// As for [`ResidualDecoder::add`]. If the reference is missing.
    pub fn add_in_stream(
        &mut self,
        residual: &Residual,
        frame: &StreamFrame,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        let Residual::Stream { reference, small_blocks, payload: bytes } = *residual else {
            return self.add(residual, portable, render);
        };
        check_size(self.size, render)?;
        self.wavelet.prepare_inter();
        self.stream.set_render(frame, render);
        let payload = Payload { bytes, tail: Tail::Zeros, small_blocks };
        self.add_wavelet(reference, payload, frame, portable, render)?;
        if portable {
            self.stream.keep(frame, render);
        }
        Ok(())
    }

    /// As [`ResidualDecoder::add_start`], for a stream's residual. No frame can be predicted from it.
    ///
    /// # Errors
    /// As for [`ResidualDecoder::add_in_stream`].
    pub fn add_start_in_stream(
        &mut self,
        start: &ResidualStart,
        frame: &StreamFrame,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        check_size(self.size, render)?;
        self.add_wavelet(start.reference, Payload::of_start(start), frame, portable, render)
    }

    fn add_wavelet(
        &mut self,
        reference: Option<Reference>,
        payload: Payload,
        frame: &StreamFrame,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        let Some(reference) = reference else {
            return self.wavelet.add(payload, portable, render);
        };
        if !portable {
            return Err(ResidualError::OtherRender);
        }
        if !self.stream.holds(reference, frame.frame, frame.viewpoint) {
            let reference = frame.frame.wrapping_sub(reference.distance.into());
            return Err(ResidualError::ReferenceMissing { frame: frame.frame, reference });
        }
        frame.check((render.width, render.height))?;
        let earlier = self.stream.earlier(reference, frame);
        self.wavelet.add_inter(payload, portable, earlier.as_ref(), render)
    }

    /// As [`ResidualDecoder::add`], with the start of a payload. The longer it is, the finer the picture.
    pub fn add_start(
        &mut self,
        start: &ResidualStart,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        self.wavelet.forget_step();
        check_size(self.size, render)?;
        match start.reference {
            Some(_) => Err(OUT_OF_STREAM),
            None => self.wavelet.add(Payload::of_start(start), portable, render),
        }
    }
}

const OUT_OF_STREAM: ResidualError =
    ResidualError::Payload("it is predicted from another frame of its stream");
