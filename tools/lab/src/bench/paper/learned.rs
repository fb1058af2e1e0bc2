//! What coders outside made of the frames: the learned ones of `tools/paper`, and anyone's.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use nvsprior::Picture;
use nvsprior_inputs::frame_file::{FrameFileError, read_picture};
use serde_json::Value;

use super::exchange::added;
use super::row::{CODECS, Coded, ESTIMATORS, SETTABLE, Setting};
use crate::bench::codecs::point::{Input, Mode, Point};
use crate::bench::codecs::run::{Run, packet_bytes};
use crate::bench::context::Shot;
use crate::bench::similarity::Similarity;

/// The methods of the paper, on frames and on difference pictures.
pub const OF_FRAMES: [&str; 2] = ["mean-scale-hyperprior", "mlic++"];
pub const OF_DIFFERENCES: [&str; 2] = ["mean-scale-hyperprior-differences", "mlic++-differences"];

/// The method of a row or folder: its name up to the `@`.
pub fn method_of(name: &str) -> &str {
    name.split('@').next().unwrap_or_default()
}

/// What a folder's name must be to be a row's.
fn check_name(name: &str) -> Result<(), String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "+-_.=@".contains(c);
    if !name.starts_with(|c: char| c.is_ascii_alphanumeric())
        || !name.chars().all(plain)
        || name.len() > 64
    {
        return Err("the name of a row has at most 64 letters, digits, and + - _ . = @".into());
    }
    match SETTABLE.iter().chain(&ESTIMATORS).chain(&CODECS).find(|own| **own == method_of(name)) {
        Some(own) => {
            Err(format!("`{own}` is a row of the program's own: give the folder another name"))
        }
        None => Ok(()),
    }
}

/// Why a folder of a learned coder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LearnedError {
    #[error("{}: {error}", path.display())]
    Read { path: PathBuf, error: std::io::Error },
    #[error("{}: no folder of a coder in it, which has {}: docs/paper.md", path.display(), PARTS.join(", "))]
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

/// What a coder's folder has.
const PARTS: [&str; 3] = ["method.json", "frames.csv", "pictures"];
const COLUMNS: [&str; 4] = ["name", "bytes", "encode_ms", "decode_ms"];

pub struct Learned {
    pub coders: Vec<LearnedCoder>,
}

/// What one coder made of the frames, at one λ.
pub struct LearnedCoder {
    /// The folder's: the method, and `@` and more.
    pub name: String,
    pub method: String,
    setting: Setting,
    pub parameters: Option<u64>,
    /// It codes difference pictures.
    is_of_differences: bool,
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
        let lambda = |coder: &LearnedCoder| match coder.setting {
            Setting::Lambda(lambda) => lambda,
            _ => 0.0,
        };
        let greatest = || of_method().max_by(|a, b| lambda(a).total_cmp(&lambda(b)));
        of_method().find(|coder| coder.name == method).or_else(greatest)
    }

    /// The methods, each once.
    pub fn methods(&self) -> impl Iterator<Item = &str> {
        let names: BTreeSet<&str> = self.coders.iter().map(|coder| &coder.method[..]).collect();
        names.into_iter()
    }
}

impl LearnedCoder {
    /// What it takes and shows. `invs`: the frames beside the renders of exchange/.
    pub fn coded(&self, invs: &Run) -> Coded {
        let (beside, shown) = if self.is_of_differences {
            let renders = invs.renders.iter().zip(&self.pictures);
            (invs.beside, renders.map(|(render, picture)| added(render, picture)).collect())
        } else {
            (Default::default(), self.pictures.clone())
        };
        Coded {
            setting: self.setting.clone(),
            bytes: self.bytes + beside.bytes,
            encode_ms: self.encode_ms + beside.encode_ms,
            decode_ms: self.decode_ms + beside.decode_ms,
            shown,
        }
    }

    /// A point of it on a run, the place of its setting among others for its setting.
    pub fn point(&self, run: &Run, place: usize) -> Point {
        let coded = self.coded(run);
        let (input, packet) = match self.is_of_differences {
            true => (Input::Difference, packet_bytes()),
            false => (Input::Frame, 0.0),
        };
        Point {
            coder: self.method.clone().into(),
            input,
            mode: Mode::Intra,
            setting: place as f64,
            bytes: coded.bytes + packet,
            psnr: run.psnr(&coded.shown),
            similarity: Similarity::of(&run.frames, &coded.shown),
            encode_ms: coded.encode_ms,
            decode_ms: coded.decode_ms,
        }
    }
}

/// Reads each folder that has a part of a coder's: its name is the row's.
pub fn read(folder: &Path, shots: &[Shot]) -> Result<Learned, LearnedError> {
    let failed = |error| LearnedError::Read { path: folder.to_path_buf(), error };
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if PARTS.iter().any(|part| path.join(part).exists()) {
            folders.push(path);
        }
    }
    if folders.is_empty() {
        return Err(LearnedError::Nothing { path: folder.to_path_buf() });
    }
    folders.sort();
    let coders = folders.iter().map(|path| coder(path, shots)).collect::<Result<_, _>>()?;
    Ok(Learned { coders })
}

fn coder(folder: &Path, shots: &[Shot]) -> Result<LearnedCoder, LearnedError> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let wrong = |what| LearnedError::Method { path: folder.to_path_buf(), what };
    check_name(&name).map_err(wrong)?;
    let method = method_of(&name).to_owned();
    let About { setting, parameters, is_of_differences } = about(&folder.join(PARTS[0]), &method)?;
    let [bytes, encode_ms, decode_ms] = means(&folder.join(PARTS[1]), shots)?;
    let picture = |shot: &Shot| {
        let path = folder.join(PARTS[2]).join(format!("{}.png", shot.name));
        read_picture(&path, shot.camera.width, shot.camera.height)
    };
    let pictures = shots.iter().map(picture).collect::<Result<_, _>>()?;
    Ok(LearnedCoder {
        name,
        method,
        setting,
        parameters,
        is_of_differences,
        bytes,
        encode_ms,
        decode_ms,
        pictures,
    })
}

/// What `method.json` says.
struct About {
    setting: Setting,
    parameters: Option<u64>,
    is_of_differences: bool,
}

fn about(path: &Path, method: &str) -> Result<About, LearnedError> {
    let failed = |error| LearnedError::Read { path: path.to_path_buf(), error };
    let wrong = |what: String| LearnedError::Method { path: path.to_path_buf(), what };
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let about: Value = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    let is = |key: &str, due: &str| match &about[key] {
        found if found == due => Ok(()),
        _ => Err(wrong(format!("\"{key}\" must be \"{due}\", as the folder's name says"))),
    };
    if !about["method"].is_null() {
        is("method", method)?;
    }
    let is_of_differences = match &about["of"] {
        of if of == "frames" => false,
        of if of == "differences" => true,
        _ => return Err(wrong("\"of\" must be \"frames\" or \"differences\"".into())),
    };
    for (names, kind) in [(OF_FRAMES, "frames"), (OF_DIFFERENCES, "differences")] {
        if names.contains(&method) {
            is("of", kind)?;
        }
    }
    let setting = match (&about["setting"], &about["lambda"]) {
        (Value::String(words), _) => Setting::Words(words.replace(['|', '\n'], " ")),
        (Value::Null, Value::Null) => Setting::Words("not stated".into()),
        (Value::Null, lambda) => {
            let lambda = lambda.as_f64().filter(|lambda| *lambda > 0.0);
            Setting::Lambda(
                lambda.ok_or_else(|| wrong("\"lambda\" must be a number above 0".into()))?,
            )
        }
        _ => return Err(wrong("\"setting\" must be a text".into())),
    };
    let parameters = match &about["parameters"] {
        Value::Null => None,
        value => {
            let what = "\"parameters\" must be a whole number";
            Some(value.as_u64().ok_or_else(|| wrong(what.into()))?)
        }
    };
    Ok(About { setting, parameters, is_of_differences })
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
