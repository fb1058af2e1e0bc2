//! The pictures that are coded, and how a coder's outcome counts.

use nvsprior::Picture;
use nvsprior::packet::{SHORT_LATENT_LEN, residual_part_len};
use nvsprior::residual::{add, difference};

use super::{Input, Mode, Point};
use crate::bench::similarity::Similarity;

/// The pictures that are coded: all of one size.
pub struct Run {
    pub frames: Vec<Picture>,
    pub renders: Vec<Picture>,
    differences: Vec<Picture>,
    /// For each frame; what a plain frame is the difference from.
    grey: Vec<Picture>,
    pub beside: Beside,
}

/// What a frame takes beside coding its difference picture, in the mean.
#[derive(Clone, Copy, Debug, Default)]
pub struct Beside {
    pub bytes: f64,
    pub encode_ms: f64,
    pub decode_ms: f64,
}

/// What a coder made of all pictures.
pub struct CodedRun {
    pub setting: f64,
    /// Of all payloads together, without containers.
    pub bytes: usize,
    pub encode_ms: f64,
    pub decode_ms: f64,
    /// What the topside shows.
    pub shown: Vec<Picture>,
}

impl CodedRun {
    /// Of no picture yet.
    pub fn new(setting: f64) -> CodedRun {
        CodedRun { setting, bytes: 0, encode_ms: 0.0, decode_ms: 0.0, shown: Vec::new() }
    }
}

impl Run {
    pub fn new(frames: Vec<Picture>, renders: Vec<Picture>, beside: Beside) -> Run {
        let differences = frames.iter().zip(&renders).map(|(f, r)| difference(f, r)).collect();
        let grey = |frame: &Picture| {
            let mut grey = frame.clone();
            grey.data.fill(128);
            grey
        };
        let grey = frames.iter().map(grey).collect();
        Run { frames, renders, differences, grey, beside }
    }

    pub fn len(&self) -> f64 {
        self.frames.len() as f64
    }

    /// What a coder of pictures codes.
    pub fn pictures(&self, input: Input) -> &[Picture] {
        match input {
            Input::Frame => &self.frames,
            Input::Difference => &self.differences,
        }
    }

    /// What it is the difference from, plus 128.
    pub fn bases(&self, input: Input) -> &[Picture] {
        match input {
            Input::Frame => &self.grey,
            Input::Difference => &self.renders,
        }
    }

    /// What the topside shows of a picture that a coder of pictures decodes.
    pub fn show(&self, input: Input, index: usize, decoded: &Picture) -> Picture {
        let mut shown = self.bases(input)[index].clone();
        add(&decoded.data, &mut shown.data);
        shown
    }

    /// Mean PSNR over the frames of what is shown, dB.
    pub fn psnr(&self, shown: &[Picture]) -> f64 {
        let each = self.frames.iter().zip(shown).map(|(frame, shown)| frame.psnr(shown));
        each.sum::<f64>() / self.len()
    }

    /// A point of a coder, from what it made of all pictures.
    pub fn point(
        &self,
        coder: &'static str,
        input: Input,
        mode: Mode,
        outcome: &CodedRun,
    ) -> Point {
        let payload = outcome.bytes as f64 / self.len();
        let (packet, beside) = match input {
            Input::Frame => (0.0, Beside::default()),
            Input::Difference => (packet_bytes(), self.beside),
        };
        Point {
            coder: coder.into(),
            input,
            mode,
            setting: outcome.setting,
            bytes: payload + packet + beside.bytes,
            psnr: self.psnr(&outcome.shown),
            similarity: Similarity::of(&self.frames, &outcome.shown),
            encode_ms: outcome.encode_ms / self.len() + beside.encode_ms,
            decode_ms: outcome.decode_ms / self.len() + beside.decode_ms,
        }
    }
}

/// Bytes of a steady packet without its payload: its latent part, and the residual's check.
pub fn packet_bytes() -> f64 {
    (SHORT_LATENT_LEN + residual_part_len(0)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_packet_adds_what_the_command_says() {
        assert_eq!(packet_bytes(), 20.0 + 2.0);
    }

    #[test]
    fn a_frame_is_its_difference_from_grey() {
        let frame = Picture::from_rgb(2, 1, vec![0, 1, 127, 128, 254, 255]).expect("2×1");
        let run = Run::new(vec![frame.clone()], vec![Picture::new(2, 1)], Beside::default());
        assert_eq!(run.show(Input::Frame, 0, &run.pictures(Input::Frame)[0]), frame);
    }
}
