//! The topside's side: bytes as a difference picture.

use crate::Picture;
use crate::packet::ResidualStart;

use super::super::ResidualError;
use super::bits::Reader;
use super::displaced::Earlier;
use super::encoder::WaveletEncoder;
use super::frame::Frame;
use super::header::{FineBlocks, Header};
use super::inter::Inter;
use super::pass::Pass;
use super::predictor::Predictors;
use super::step::Step;
use crate::coder_tables::Tables;
use crate::range_coder::{RangeDecoder, Tail};

/// A payload, or the start of one.
#[derive(Clone, Copy)]
pub struct Payload<'a> {
    /// Its bytes.
    pub bytes: &'a [u8],
    /// What comes after them.
    pub tail: Tail,
    /// It has small blocks.
    pub small_blocks: bool,
}

impl<'a> Payload<'a> {
    /// One whose end is missing.
    pub(crate) fn of_start(start: &ResidualStart<'a>) -> Payload<'a> {
        Payload { bytes: start.payload, tail: Tail::Unknown, small_blocks: start.small_blocks }
    }
}

const UNKNOWN_BLOCKS: ResidualError =
    ResidualError::Payload("it has displaced blocks, and is predicted from no other frame");

/// What an inter payload is decoded beside.
enum Beside<'a> {
    /// An earlier frame.
    Earlier(&'a Earlier<'a>),
    /// What its encoder had made of one, which was set.
    Encoder,
}

/// Decodes the pictures of one size, in memory of its own.
pub struct WaveletDecoder {
    frame: Frame,
    predictors: Predictors,
    pass: Pass,
    step: Option<Step>,
}

impl WaveletDecoder {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32, tables: &Tables) -> WaveletDecoder {
        let frame = Frame::new(width, height);
        let pass = Pass::new(&frame.geometry);
        let predictors = Predictors::new(tables, &Tables::stream());
        WaveletDecoder { frame, predictors, pass, step: None }
    }

    /// The quantiser's step of the payload decoded last; `None`: it added nothing.
    pub fn step(&self) -> Option<Step> {
        self.step
    }

    /// As if the payload decoded last had added nothing.
    pub fn forget_step(&mut self) {
        self.step = None;
    }

    /// Makes room for inter payloads.
    pub fn prepare_inter(&mut self) {
        self.frame.prepare_inter();
    }

    /// Adds a payload to its render, of the decoder's size. Of a payload that was cut short, what is there is added.
    /// Bytes that are not refused give a picture, whatever they are.
    ///
    /// # Errors
    /// If the payload's contexts look at the render, and it is not the encoder's: `portable` tells. If a whole payload
    /// has displaced blocks.
    pub fn add(
        &mut self,
        payload: Payload,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        self.add_inter(payload, portable, None, render)
    }

    /// As [`WaveletDecoder::add`], for an inter payload, if there is an earlier frame.
    ///
    /// # Errors
    /// As for [`WaveletDecoder::add`], but displaced blocks may be. All inter payloads need the encoder's render.
    pub fn add_inter(
        &mut self,
        payload: Payload,
        portable: bool,
        earlier: Option<&Earlier>,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        if earlier.is_some() {
            self.prepare_inter();
        }
        self.add_beside(payload, portable, earlier.map(Beside::Earlier), render)
    }

    /// Decodes what an encoder has written of its frame, or the start of it.
    pub(super) fn add_own(
        &mut self,
        encoder: &WaveletEncoder,
        bytes: &[u8],
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        let own = encoder.inter_in_use();
        if let Some(own) = own {
            self.prepare_inter();
            self.frame.inter.iter_mut().for_each(|inter| inter.set_as(own));
        }
        let small_blocks = encoder.has_small_blocks();
        let payload = Payload { bytes, tail: Tail::Zeros, small_blocks };
        self.add_beside(payload, true, own.map(|_| Beside::Encoder), render)
    }

    fn add_beside(
        &mut self,
        payload: Payload,
        portable: bool,
        beside: Option<Beside>,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        let WaveletDecoder { frame, predictors, pass, step } = self;
        *step = None;
        let mut decoder = RangeDecoder::new(payload.bytes, payload.tail);
        let Frame { small_blocks, inter, .. } = frame;
        let is_inter = beside.is_some();
        let inter = inter.as_mut().filter(|_| is_inter);
        let fine =
            FineBlocks { plain: small_blocks, displaced: inter.map(|inter| &mut inter.displaced) };
        let header = Header::read(fine, payload.small_blocks, &mut decoder);
        let Some(header) = header else {
            // If the end is missing, too little came. A whole payload says something that is not known here.
            return match payload.tail {
                Tail::Unknown => Ok(()),
                Tail::Zeros => Err(UNKNOWN_BLOCKS),
            };
        };
        if (header.sees_render || is_inter) && !portable {
            return Err(ResidualError::OtherRender);
        }
        if header.cut {
            decoder.cut();
        }
        (frame.sees_render, frame.step) = (header.sees_render, header.step);
        frame.low_predicted = header.low_predicted;
        frame.weigh();
        frame.is_inter = is_inter;
        if let (Some(inter), Some(beside)) = (&mut frame.inter, beside) {
            if let Beside::Earlier(earlier) = beside {
                inter.set(&frame.geometry, earlier, render, &mut frame.scratch);
            }
            if inter.read(&frame.geometry, &mut decoder, &mut frame.scratch).is_none() {
                return Ok(());
            }
        }
        frame.set_render(render);
        pass.forget_render();
        let predictor = predictors.of(frame);
        let mut reader = Reader { decoder, predictor };
        pass.run(frame, predictor, header.finest, &mut reader);
        pass.finish(frame, predictor);
        pass.add_to(frame.inter_in_use().map(Inter::picture), &mut render.data);
        *step = Some(header.step);
        Ok(())
    }
}
