//! What a method made of the frames.

use std::io::IsTerminal as _;

use nvsprior::{Picture, Rate};
use serde::{Serialize, Serializer};

use crate::bench::codecs::run::Run;
use crate::bench::similarity::Similarity;

/// The methods whose quality can be set, in the order of their rows. The learned ones come after the second.
pub const SETTABLE: [&str; 10] = [
    "webp",
    "jpeg-xl",
    "affine+webp",
    "affine+jpeg-xl",
    "invs+webp",
    "invs+jpeg-xl",
    "ours-intra",
    "ours-stream",
    "affine-cnn+webp",
    "affine-cnn+jpeg-xl",
];
/// Pose estimators: the relocaliser, and a regressor outside.
pub const ESTIMATORS: [&str; 2] = ["estimator", "estimator-cnn"];
/// Rows of `nvsprior-lab codecs` beside these.
pub const CODECS: [&str; 9] = [
    "wavelet",
    "x264",
    "x265",
    "libaom",
    "svt-av1",
    "vvenc",
    "affine-webp",
    "affine-jpeg-xl",
    "found-affine-webp",
];

/// Says what is measured now, if there is no progress bar to do it.
pub fn announce(what: &str) {
    if !std::io::stderr().is_terminal() {
        tell!("measuring {what}");
    }
}

/// How fine a method codes.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// The quality of WebP, or of the program's own coder.
    Quality(f64),
    Distance(f64),
    /// Each frame at this PSNR, dB.
    Psnr(f64),
    /// Of a learned coder.
    Lambda(f64),
    /// Of a coder outside, in its own words.
    Words(String),
}

impl Setting {
    /// As the coders of packets take it; `None` if it is another coder's.
    pub fn rate(&self) -> Option<Rate> {
        match *self {
            Setting::Quality(quality) => Some(Rate::Quality(quality as f32)),
            Setting::Psnr(psnr) => Some(Rate::Psnr(psnr)),
            Setting::Distance(_) | Setting::Lambda(_) | Setting::Words(_) => None,
        }
    }

    pub fn text(&self) -> String {
        match self {
            Setting::Quality(quality) => format!("quality {quality:.1}"),
            Setting::Distance(distance) => format!("distance {distance:.2}"),
            Setting::Psnr(psnr) => format!("{psnr:.2} dB each"),
            Setting::Lambda(lambda) => format!("lambda {lambda}"),
            Setting::Words(words) => words.clone(),
        }
    }
}

/// Rows of pictures, spread over the frames.
const ROWS: usize = 3;

/// Which of so many frames are shown.
pub fn shown_of(count: usize) -> Vec<usize> {
    let mut indices: Vec<usize> =
        (0..ROWS).map(|i| i * count.saturating_sub(1) / (ROWS - 1)).collect();
    indices.dedup();
    indices
}

/// All frames coded: means per frame.
pub struct Coded {
    pub setting: Setting,
    /// All that is sent for a frame.
    pub bytes: f64,
    pub encode_ms: f64,
    pub decode_ms: f64,
    /// What the topside shows.
    pub shown: Vec<Picture>,
}

/// A method's row: means per frame.
#[derive(Clone, Serialize)]
pub struct Row {
    pub method: String,
    #[serde(serialize_with = "in_words")]
    pub setting: Setting,
    /// All that is sent for a frame.
    pub bytes: f64,
    /// Bytes of the raw frame for each byte that is sent.
    pub ratio: f64,
    pub encode_ms: f64,
    pub decode_ms: f64,
    pub frames: usize,
    /// What the topside shows of the frames of [`shown_of`].
    #[serde(skip)]
    pub shown: Vec<Picture>,
    /// Mean over the frames, dB.
    pub psnr: f64,
    #[serde(flatten)]
    pub similarity: Similarity,
    /// Frames whose pose was found; only of pose estimators.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found: Option<usize>,
    /// Whether the PSNR is the one that was aimed at; only if one was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reached: Option<bool>,
    /// Weights of a learned coder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<u64>,
}

fn in_words<S: Serializer>(setting: &Setting, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&setting.text())
}

impl Row {
    /// Measures what is shown. `frames`: the run of the frames.
    pub fn new(method: impl Into<String>, coded: Coded, frames: &Run) -> Row {
        let Coded { setting, bytes, encode_ms, decode_ms, shown } = coded;
        let raw = shown.first().map_or(0, |picture| picture.data.len());
        let kept = shown_of(shown.len()).into_iter().map(|index| shown[index].clone());
        Row {
            method: method.into(),
            setting,
            bytes,
            ratio: raw as f64 / bytes,
            encode_ms,
            decode_ms,
            frames: shown.len(),
            shown: kept.collect(),
            psnr: frames.psnr(&shown),
            similarity: Similarity::of(&frames.frames, &shown),
            found: None,
            reached: None,
            parameters: None,
        }
    }
}

/// A row, or why there is none.
#[derive(Clone, Serialize)]
#[serde(untagged)]
pub enum Entry {
    Measured(Box<Row>),
    Missing {
        method: String,
        #[serde(rename = "missing")]
        what: String,
    },
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
