//! What a method made of the frames.

use nvsprior::{Picture, Rate};

use super::quality::Similarity;
use crate::bench::codecs::run::Run;

/// How fine a method codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// The quality of WebP, or of the program's own coder.
    Quality(f64),
    /// JPEG XL's distance.
    Distance(f64),
    /// Each frame at this PSNR, dB.
    Psnr(f64),
    /// Of a learned coder.
    Lambda(f64),
}

impl Setting {
    /// As the coders of packets take it; `None` if it is another coder's.
    pub fn rate(self) -> Option<Rate> {
        match self {
            Setting::Quality(quality) => Some(Rate::Quality(quality as f32)),
            Setting::Psnr(psnr) => Some(Rate::Psnr(psnr)),
            Setting::Distance(_) | Setting::Lambda(_) => None,
        }
    }

    /// In words.
    pub fn text(self) -> String {
        match self {
            Setting::Quality(quality) => format!("quality {quality:.1}"),
            Setting::Distance(distance) => format!("distance {distance:.2}"),
            Setting::Psnr(psnr) => format!("{psnr:.2} dB each"),
            Setting::Lambda(lambda) => format!("lambda {lambda}"),
        }
    }
}

/// All frames coded: means per frame.
#[derive(Clone)]
pub struct Coded {
    pub setting: Setting,
    /// All that is sent for a frame.
    pub bytes: f64,
    pub encode_ms: f64,
    pub decode_ms: f64,
    /// What the topside shows.
    pub shown: Vec<Picture>,
}

/// A method's row.
#[derive(Clone)]
pub struct Row {
    pub method: String,
    pub coded: Coded,
    /// Mean over the frames, dB.
    pub psnr: f64,
    pub similarity: Similarity,
    /// Frames whose pose was found; only of pose estimators.
    pub found: Option<usize>,
    /// Whether the PSNR is the one that was aimed at; only if one was.
    pub reached: Option<bool>,
    /// Weights of a learned coder.
    pub parameters: Option<u64>,
}

impl Row {
    /// Measures what is shown. `frames`: the run of the frames.
    pub fn new(method: impl Into<String>, coded: Coded, frames: &Run) -> Row {
        Row {
            method: method.into(),
            psnr: frames.psnr(&coded.shown),
            similarity: Similarity::of(&frames.frames, &coded.shown),
            coded,
            found: None,
            reached: None,
            parameters: None,
        }
    }

    /// Bytes of the raw frame for each byte that is sent.
    pub fn ratio(&self) -> f64 {
        let raw = self.coded.shown.first().map_or(0, |picture| picture.data.len());
        raw as f64 / self.coded.bytes
    }
}

/// A row, or why there is none.
#[derive(Clone)]
pub enum Entry {
    Measured(Box<Row>),
    Missing { method: String, what: String },
}

impl Entry {
    pub fn measured(row: Row) -> Entry {
        Entry::Measured(Box::new(row))
    }

    pub fn missing(method: impl Into<String>, what: impl Into<String>) -> Entry {
        Entry::Missing { method: method.into(), what: what.into() }
    }

    pub fn method(&self) -> &str {
        match self {
            Entry::Measured(row) => &row.method,
            Entry::Missing { method, .. } => method,
        }
    }

    pub fn row(&self) -> Option<&Row> {
        match self {
            Entry::Measured(row) => Some(row),
            Entry::Missing { .. } => None,
        }
    }
}
