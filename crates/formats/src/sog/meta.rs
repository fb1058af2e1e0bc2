//! `meta.json` of a SOG file.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

use nvsprior::prior::{Field, FieldUse, PriorError, PriorWarning, Splats, passed_over};

/// The file, of version 2.
#[derive(Deserialize)]
pub struct Meta {
    #[serde(default)]
    pub asset: Asset,
    pub count: usize,
    #[serde(default)]
    pub antialias: bool,
    /// How it was trained to be drawn, of newer files.
    pub model: Option<String>,
    pub means: Means,
    pub scales: Coded,
    pub quats: Rotations,
    pub sh0: Coded,
    #[serde(rename = "shN")]
    pub sh_rest: Option<Palette>,
    #[serde(flatten)]
    pub others: BTreeMap<String, IgnoredAny>,
}

/// What is done with the fields of the file.
pub const FIELDS: [Field; 9] = [
    ("version", FieldUse::Read),
    ("asset", FieldUse::Harmless),
    ("count", FieldUse::Read),
    ("antialias", FieldUse::Read),
    ("model", FieldUse::Read),
    ("means", FieldUse::Read),
    ("scales", FieldUse::Read),
    ("quats", FieldUse::Read),
    ("sh*", FieldUse::Read),
];

#[derive(Default, Deserialize)]
pub struct Asset {
    pub generator: Option<String>,
}

/// Positions: bounds of their signed logarithms, and two pictures, of the lower and the upper byte.
#[derive(Deserialize)]
pub struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    pub files: [String; 2],
}

/// A picture whose bytes are entries of a table.
#[derive(Deserialize)]
pub struct Coded {
    pub codebook: Codebook,
    pub files: [String; 1],
}

#[derive(Deserialize)]
pub struct Rotations {
    pub files: [String; 1],
}

/// Spherical harmonics above degree 0: pictures of the palette and of its entry for each splat.
#[derive(Deserialize)]
pub struct Palette {
    /// Entries.
    pub count: usize,
    /// Their degree.
    bands: u32,
    pub codebook: Codebook,
    pub files: [String; 2],
}

/// Values by byte.
#[derive(Deserialize)]
#[serde(try_from = "Vec<f32>")]
pub struct Codebook([f32; 256]);

impl TryFrom<Vec<f32>> for Codebook {
    type Error = String;

    fn try_from(values: Vec<f32>) -> Result<Codebook, String> {
        let found = values.len();
        values
            .try_into()
            .map(Codebook)
            .map_err(|_| format!("a codebook of {found} values, not 256"))
    }
}

impl Codebook {
    pub fn get(&self, entry: u8) -> f32 {
        self.0[usize::from(entry)]
    }
}

/// What tells the version: files of version 1 do not say it.
#[derive(Deserialize)]
struct Version {
    #[serde(default = "first")]
    version: u32,
}

fn first() -> u32 {
    1
}

impl Meta {
    /// Reads the text.
    pub fn read(text: &[u8]) -> Result<Meta, PriorError> {
        let broken = |e: serde_json::Error| refusal(format!("meta.json: {e}"));
        let Version { version } = serde_json::from_slice(text).map_err(broken)?;
        if version != 2 {
            return Err(refusal(format!("version {version}: 2 is read here, save it anew")));
        }
        let meta: Meta = serde_json::from_slice(text).map_err(broken)?;
        match &meta.sh_rest {
            Some(rest) if !(1..=Splats::MAX_SH_DEGREE).contains(&rest.bands) => {
                Err(PriorError::ShDegree { degree: rest.bands })
            }
            Some(rest) if !(1..=1 << 16).contains(&rest.count) => {
                Err(refusal(format!("meta.json: a palette of {} entries", rest.count)))
            }
            _ => Ok(meta),
        }
    }

    pub fn is_antialiased(&self) -> bool {
        self.antialias || self.model.as_deref() == Some("antialiased")
    }

    /// Warnings of what is left out. Flat splats tell of themselves, by their scales.
    pub fn warnings(&self) -> Vec<PriorWarning> {
        let mut warnings =
            passed_over("SOG field", self.others.keys().map(String::as_str), &FIELDS);
        let known =
            [("3dgs", FieldUse::Read), ("antialiased", FieldUse::Read), ("2dgs", FieldUse::Read)];
        warnings.extend(passed_over("SOG model", self.model.as_deref(), &known));
        warnings
    }

    pub fn sh_degree(&self) -> u32 {
        self.sh_rest.as_ref().map_or(0, |rest| rest.bands)
    }

    /// A position of the lower and the upper byte of each of its numbers.
    pub fn position(&self, low: [u8; 4], high: [u8; 4]) -> [f32; 3] {
        std::array::from_fn(|axis| {
            let part = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / 65_535.0;
            let (min, max) = (self.means.mins[axis], self.means.maxs[axis]);
            let logarithm = min + (max - min) * part;
            libm::expm1(logarithm.abs()).copysign(logarithm) as f32
        })
    }
}

/// An error of the file's content.
pub fn refusal(reason: String) -> PriorError {
    PriorError::Content { format: "SOG", reason }
}
