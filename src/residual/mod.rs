//! The residual: what the camera saw and the render did not, as a coded difference picture.
//!
//! It is always the difference from the 8-bit picture that the decoder will render. Its quality is
//! always measured on the 8-bit picture that the decoder will show.

mod difference;
mod interest;
#[allow(unsafe_code)] // It wraps a C codec; each block says why it is sound.
mod libwebp;
mod rate;
mod references;
mod stream;
mod warp;
pub mod wavelet;
mod webp;
mod webp_rate;

use crate::Picture;
use crate::packet::{Coder, Latent, Reference, Residual, ResidualStart};

use stream::StreamDecoder;
use wavelet::{Tables, Tail, WaveletDecoder};

pub use difference::{add, difference};
pub use interest::Interest;
pub use rate::{CodedResidual, InStream, Rate, ResidualCoder, ResidualEncoder, ResidualSetup};
pub use references::REFERENCES;
pub use stream::{Acknowledged, Mode, StreamFrame, Structure};
pub use warp::{Placement, Vantage, warp};
pub use webp::Webp;

/// Why a residual cannot be coded or decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResidualError {
    /// A picture has not the size that it must have.
    #[error("picture of {}×{}, but {}×{} is due", found.0, found.1, expected.0, expected.1)]
    Size {
        /// Width and height due, pixels.
        expected: (u32, u32),
        /// Width and height found.
        found: (u32, u32),
    },
    /// A picture's bytes are not as many as its size asks for.
    #[error("picture of {width}×{height} with {bytes} bytes")]
    Shape {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Bytes it has.
        bytes: usize,
    },
    /// A quality is outside 0 to 100, or a PSNR not a number.
    #[error("rate {0:?}: quality must lie in 0..=100, PSNR be a number")]
    Rate(Rate),
    /// A map of interest has no cells, too many, or not as many weights as cells.
    #[error(
        "map of interest of {columns}×{rows} cells with {weights} weights: give one for each, and 1 to 4096 along a side"
    )]
    InterestSize {
        /// Cells in a row.
        columns: u32,
        /// Rows.
        rows: u32,
        /// Weights given.
        weights: usize,
    },
    /// A weight of a map of interest is 0.
    #[error("map of interest: the weight of cell {cell} is 0; the least is 1")]
    InterestWeight {
        /// The cell, row by row.
        cell: usize,
    },
    /// A rectangle of interest holds no pixel of the picture.
    #[error("rectangle of interest: no pixel of the picture lies in it")]
    InterestEmpty,
    /// The image encoder refuses the difference picture.
    #[error("WebP encoder: {0}")]
    Encode(String),
    /// The payload can be read only beside the encoder's own render.
    #[error(
        "residual payload: it needs the encoder's render, but one of the two devices is not portable"
    )]
    OtherRender,
    /// The frame that a stream's residual leans on is not there, or is not the one that the encoder had.
    #[error(
        "frame {frame}: its residual leans on that of frame {reference}, which is missing, came in part, or is of \
         another stream"
    )]
    ReferenceMissing {
        /// Number of the frame, modulo 2²⁴.
        frame: u32,
        /// Number of its reference.
        reference: u32,
    },
    /// There is not one depth for each pixel.
    #[error("{found} depths, but {expected} are due")]
    Depths {
        /// Pixels.
        expected: usize,
        /// Depths.
        found: usize,
    },
    /// The payload is no picture of the expected kind.
    #[error("residual payload: {0}")]
    Payload(&'static str),
}

/// Longest payload of a difference picture of a size: libwebp's on noise at quality 100, with room
/// (see the tests of `webp`).
pub fn max_payload_len(width: u32, height: u32) -> usize {
    3 * (width as usize).next_multiple_of(16) * (height as usize).next_multiple_of(16) + 1024
}

/// Adds residuals to renders of one size, in memory of its own.
pub struct ResidualDecoder {
    wavelet: WaveletDecoder,
    webp: Webp,
    stream: StreamDecoder,
    difference: Picture,
}

impl ResidualDecoder {
    /// Makes one for pictures of a size, rendered from a prior with `tables`.
    pub fn new(width: u32, height: u32, tables: &Tables) -> ResidualDecoder {
        ResidualDecoder {
            wavelet: WaveletDecoder::new(width, height, tables),
            webp: Webp::new(width, height),
            stream: StreamDecoder::default(),
            difference: Picture::new(width, height),
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
        let (coder, payload) = match *residual {
            Residual::None | Residual::Omitted => return Ok(()),
            Residual::Coded { coder, payload } => (coder, payload),
            Residual::Stream { reference: None, payload } => (Coder::Wavelet, payload),
            Residual::Stream { reference: Some(_), .. } => return Err(OUT_OF_STREAM),
        };
        check_size(&self.difference, render)?;
        match coder {
            Coder::Wavelet => self.wavelet.add(payload, Tail::Zeros, portable, render),
            Coder::Vp8 | Coder::WebP => {
                self.webp.decode(coder, payload, &mut self.difference)?;
                difference::add(&self.difference.data, &mut render.data);
                Ok(())
            }
        }
    }

    /// Whether the frame that another one leans on is there, and the same as the encoder's.
    pub fn holds(&self, reference: Reference, frame: u32, vantage: &Vantage) -> bool {
        self.stream.holds(reference, frame, vantage)
    }

    /// As [`ResidualDecoder::add`], for a stream's residual that came whole. Later frames may lean on the frame if the
    /// render is the encoder's. `frame` needs depths only if the residual leans on another.
    ///
    /// # Errors
    /// As for [`ResidualDecoder::add`]. If the reference is missing.
    pub fn add_in_stream(
        &mut self,
        reference: Option<Reference>,
        payload: &[u8],
        frame: &StreamFrame,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        check_size(&self.difference, render)?;
        self.wavelet.prepare_lean();
        self.stream.set_render(frame, render);
        self.add_wavelet(reference, payload, Tail::Zeros, frame, portable, render)?;
        if portable {
            self.stream.keep(frame, render);
        }
        Ok(())
    }

    /// As [`ResidualDecoder::add_start`], for a stream's residual. No frame can lean on it.
    ///
    /// # Errors
    /// As for [`ResidualDecoder::add_in_stream`].
    pub fn add_start_in_stream(
        &mut self,
        start: &ResidualStart,
        frame: &StreamFrame,
        portable: bool,
        render: &mut Picture,
    ) -> Result<u32, ResidualError> {
        check_size(&self.difference, render)?;
        let ResidualStart { reference, payload, .. } = *start;
        self.add_wavelet(reference, payload, Tail::Unknown, frame, portable, render)?;
        Ok(render.height)
    }

    fn add_wavelet(
        &mut self,
        reference: Option<Reference>,
        payload: &[u8],
        tail: Tail,
        frame: &StreamFrame,
        portable: bool,
        render: &mut Picture,
    ) -> Result<(), ResidualError> {
        let Some(reference) = reference else {
            return self.wavelet.add(payload, tail, portable, render);
        };
        if !portable {
            return Err(ResidualError::OtherRender);
        }
        if !self.stream.holds(reference, frame.frame, frame.vantage) {
            let reference = frame.frame.wrapping_sub(reference.distance.into()) % Latent::FRAMES;
            return Err(ResidualError::ReferenceMissing { frame: frame.frame, reference });
        }
        frame.check(render)?;
        let warped = self.stream.warped(reference, frame);
        self.wavelet.add_leaning(payload, tail, portable, warped, render)
    }

    /// As [`ResidualDecoder::add`], with the start of a payload. Returns the number of rows that it reaches. A wavelet
    /// payload reaches all rows; the longer its start, the finer they are.
    pub fn add_start(
        &mut self,
        start: &ResidualStart,
        portable: bool,
        render: &mut Picture,
    ) -> Result<u32, ResidualError> {
        check_size(&self.difference, render)?;
        if start.reference.is_some() {
            return Err(OUT_OF_STREAM);
        }
        if start.coder == Coder::Wavelet {
            self.wavelet.add(start.payload, Tail::Unknown, portable, render)?;
            return Ok(render.height);
        }
        let rows = self.webp.decode_start(start, &mut self.difference)?;
        let bytes = rows * render.width as usize * 3;
        difference::add(&self.difference.data[..bytes], &mut render.data[..bytes]);
        Ok(rows as u32)
    }
}

const OUT_OF_STREAM: ResidualError =
    ResidualError::Payload("it leans on another frame of its stream");

/// Checks that a picture is whole and has the size of another.
fn check_size(of: &Picture, picture: &Picture) -> Result<(), ResidualError> {
    let (expected, found) = ((of.width, of.height), (picture.width, picture.height));
    if expected != found {
        return Err(ResidualError::Size { expected, found });
    }
    check_shape(picture)
}

fn check_shape(picture: &Picture) -> Result<(), ResidualError> {
    let Picture { width, height, ref data } = *picture;
    let bytes = data.len();
    if bytes > 0 && bytes == width as usize * height as usize * 3 {
        Ok(())
    } else {
        Err(ResidualError::Shape { width, height, bytes })
    }
}
