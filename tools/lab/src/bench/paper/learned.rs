//! What learned coders made of the frames, as `tools/paper` writes it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nvsprior::Picture;
use nvsprior_inputs::frame_file::{FrameFileError, read_picture};
use serde_json::Value;

use super::exchange::added;
use super::row::{Coded, Setting};
use crate::bench::codecs::run::Run;
use crate::bench::context::Shot;

/// The methods, on frames and on difference pictures.
pub const OF_FRAMES: [&str; 2] = ["mean-scale-hyperprior", "mlic++"];
pub const OF_DIFFERENCES: [&str; 2] = ["mean-scale-hyperprior-differences", "mlic++-differences"];

fn methods() -> impl Iterator<Item = &'static str> {
    OF_FRAMES.into_iter().chain(OF_DIFFERENCES)
}

fn names() -> String {
    methods().collect::<Vec<_>>().join(", ")
}

/// Why a folder of a learned coder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LearnedError {
    #[error("{}: {error}", path.display())]
    Read { path: PathBuf, error: std::io::Error },
    #[error("{}: no folder of a learned coder in it; `tools/paper` writes such folders: {}",
        path.display(), names())]
    Nothing { path: PathBuf },
    #[error("{}: {what}", path.display())]
    Method { path: PathBuf, what: String },
    #[error("{}: {error}", path.display())]
    Csv { path: PathBuf, error: csv::Error },
    #[error("{}: the header must be {}", path.display(), COLUMNS.join(","))]
    Header { path: PathBuf },
    #[error("{}: row {row}: {what}", path.display())]
    Row { path: PathBuf, row: usize, what: String },
    #[error("{}: no row of frame \"{name}\"", path.display())]
    Missing { path: PathBuf, name: String },
    #[error(transparent)]
    Picture(#[from] FrameFileError),
}

const COLUMNS: [&str; 4] = ["name", "bytes", "encode_ms", "decode_ms"];

pub struct Learned {
    pub coders: Vec<LearnedCoder>,
}

/// What one coder made of the frames, at one λ.
pub struct LearnedCoder {
    /// The method, and `@λ` if the folder's name has it.
    pub name: String,
    pub method: &'static str,
    pub lambda: f64,
    pub parameters: u64,
    /// Means per frame.
    bytes: f64,
    encode_ms: f64,
    decode_ms: f64,
    pictures: Vec<Picture>,
}

impl Learned {
    /// The coder of the row that has a method's own name: its folder's, or that of the greatest λ.
    pub fn main(&self, method: &str) -> Option<&LearnedCoder> {
        let of_method = || self.coders.iter().filter(|coder| coder.method == method);
        let greatest = || of_method().max_by(|a, b| a.lambda.total_cmp(&b.lambda));
        of_method().find(|coder| coder.name == method).or_else(greatest)
    }
}

impl LearnedCoder {
    /// Whether it codes difference pictures.
    fn of_differences(&self) -> bool {
        OF_DIFFERENCES.contains(&self.method)
    }

    /// What it takes and shows. `invs`: the frames beside the renders of exchange/.
    pub fn coded(&self, invs: &Run) -> Coded {
        let (beside, shown) = if self.of_differences() {
            let renders = invs.renders.iter().zip(&self.pictures);
            (invs.beside, renders.map(|(render, picture)| added(render, picture)).collect())
        } else {
            (Default::default(), self.pictures.clone())
        };
        Coded {
            setting: Setting::Lambda(self.lambda),
            bytes: self.bytes + beside.bytes,
            encode_ms: self.encode_ms + beside.encode_ms,
            decode_ms: self.decode_ms + beside.decode_ms,
            shown,
        }
    }
}

/// Reads each folder whose name is a method's, `@` and more may follow.
pub fn read(folder: &Path, shots: &[Shot]) -> Result<Learned, LearnedError> {
    let failed = |error| LearnedError::Read { path: folder.to_path_buf(), error };
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    folders.sort();
    let mut coders = Vec::new();
    for path in folders {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let before = name.split('@').next().unwrap_or_default();
        match methods().find(|method| *method == before) {
            Some(method) => coders.push(coder(&path, name, method, shots)?),
            None if path.join("method.json").exists() => {
                let what = format!("no learned coder of this name: {}", names());
                return Err(LearnedError::Method { path, what });
            }
            None => {}
        }
    }
    if coders.is_empty() {
        return Err(LearnedError::Nothing { path: folder.to_path_buf() });
    }
    Ok(Learned { coders })
}

fn coder(
    folder: &Path,
    name: String,
    method: &'static str,
    shots: &[Shot],
) -> Result<LearnedCoder, LearnedError> {
    let (lambda, parameters) = about(&folder.join("method.json"), method)?;
    let [bytes, encode_ms, decode_ms] = means(&folder.join("frames.csv"), shots)?;
    let picture = |shot: &Shot| {
        let path = folder.join("pictures").join(format!("{}.png", shot.name));
        read_picture(&path, shot.camera.width, shot.camera.height)
    };
    let pictures = shots.iter().map(picture).collect::<Result<_, _>>()?;
    Ok(LearnedCoder { name, method, lambda, parameters, bytes, encode_ms, decode_ms, pictures })
}

/// λ and the number of weights.
fn about(path: &Path, method: &str) -> Result<(f64, u64), LearnedError> {
    let failed = |error| LearnedError::Read { path: path.to_path_buf(), error };
    let wrong = |what: String| LearnedError::Method { path: path.to_path_buf(), what };
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let about: Value = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    let of = if OF_DIFFERENCES.contains(&method) { "differences" } else { "frames" };
    for (key, value) in [("method", method), ("of", of)] {
        if about[key] != value {
            return Err(wrong(format!("\"{key}\" must be \"{value}\", as the folder's name says")));
        }
    }
    let lambda = about["lambda"].as_f64().filter(|lambda| *lambda > 0.0);
    let lambda = lambda.ok_or_else(|| wrong("\"lambda\" must be a number above 0".into()))?;
    let parameters = about["parameters"].as_u64();
    Ok((lambda, parameters.ok_or_else(|| wrong("\"parameters\" must be a whole number".into()))?))
}

/// Mean bytes and milliseconds of the frames. Each has exactly one row; other frames may have some, too.
fn means(path: &Path, shots: &[Shot]) -> Result<[f64; 3], LearnedError> {
    let failed = |error| LearnedError::Csv { path: path.to_path_buf(), error };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(failed)?;
    if reader.headers().map_err(failed)?.iter().ne(COLUMNS) {
        return Err(LearnedError::Header { path: path.to_path_buf() });
    }
    let mut rows = HashMap::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(failed)?;
        let wrong = |what| LearnedError::Row { path: path.to_path_buf(), row: row + 1, what };
        let name = record.get(0).unwrap_or_default().to_owned();
        let mut values = [0.0; 3];
        for (i, value) in values.iter_mut().enumerate() {
            let parsed = record.get(i + 1).and_then(|text| text.parse::<f64>().ok());
            let valid = parsed.filter(|value| value.is_finite() && *value >= 0.0);
            let what = || wrong(format!("{}: no number from 0 on", COLUMNS[i + 1]));
            *value = valid.ok_or_else(what)?;
        }
        if rows.insert(name.clone(), values).is_some() {
            return Err(wrong(format!("\"{name}\" stands there twice")));
        }
    }
    let mut means = [0.0; 3];
    for shot in shots {
        let name = || shot.name.clone();
        let missing = || LearnedError::Missing { path: path.to_path_buf(), name: name() };
        let values = rows.get(&shot.name).ok_or_else(missing)?;
        for (mean, value) in means.iter_mut().zip(values) {
            *mean += value / shots.len() as f64;
        }
    }
    Ok(means)
}
