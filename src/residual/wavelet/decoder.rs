//! The topside's side: bytes as a difference picture.

use crate::Picture;

use super::super::ResidualError;
use super::bits::Reader;
use super::frame::Frame;
use super::header::Header;
use super::pass::Pass;
use super::predictor::Predictor;
use super::range_coder::{RangeDecoder, Tail};
use super::tables::Tables;

/// Decodes the pictures of one size, in memory of its own.
pub struct WaveletDecoder {
    frame: Frame,
    predictor: Predictor,
    pass: Pass,
}

impl WaveletDecoder {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32, tables: &Tables) -> WaveletDecoder {
        let frame = Frame::new(width, height);
        let pass = Pass::new(&frame.geometry);
        WaveletDecoder { frame, predictor: Predictor::new(tables), pass }
    }

    /// Adds a payload to its render, of the decoder's size. Of a payload that was cut short, what is there is added.
    /// Any bytes give a picture.
    ///
    /// # Errors
    /// If the payload's contexts look at the render, and it is not the encoder's: `portable` tells.
    pub fn add(
        &mut self,
        payload: &[u8],
        tail: Tail,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        let WaveletDecoder { frame, predictor, pass } = self;
        let mut decoder = RangeDecoder::new(payload, tail);
        let Some(header) = Header::read(&mut frame.predicted, &mut decoder) else {
            return Ok(());
        };
        if header.sees_render && !portable {
            return Err(ResidualError::OtherRender);
        }
        if header.cut {
            decoder.cut();
        }
        (frame.sees_render, frame.step) = (header.sees_render, header.step);
        frame.low_predicted = header.low_predicted;
        frame.set_render(render);
        let mut reader = Reader { decoder, predictor };
        pass.run(frame, predictor, header.finest, &mut reader);
        pass.finish(frame, predictor);
        pass.add_to(&mut render.data);
        Ok(())
    }
}
