//! The parts of a glTF document that tell where splats are.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::container::refusal;
use nvsprior::prior::{Field, FieldUse, PriorError, PriorWarning, passed_over};

/// The extension.
pub const SPLATS: &str = "KHR_gaussian_splatting";

/// Extensions that a file may require. The second allows integers as positions.
const KNOWN: [&str; 2] = [SPLATS, "KHR_mesh_quantization"];

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Document {
    pub asset: Asset,
    #[serde(default)]
    pub extensions_required: Vec<String>,
    pub scene: Option<usize>,
    #[serde(default)]
    pub scenes: Vec<Scene>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default)]
    pub buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
pub struct Asset {
    pub generator: Option<String>,
}

#[derive(Deserialize)]
pub struct Scene {
    #[serde(default)]
    pub nodes: Vec<usize>,
}

#[derive(Deserialize)]
pub struct Node {
    pub mesh: Option<usize>,
    #[serde(default)]
    pub children: Vec<usize>,
    /// By columns.
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    /// x, y, z, w.
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
pub struct Mesh {
    pub primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub struct Primitive {
    /// The accessor of each attribute.
    pub attributes: BTreeMap<String, usize>,
    #[serde(default)]
    pub extensions: Extensions,
}

#[derive(Default, Deserialize)]
pub struct Extensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    pub splats: Option<SplatExtension>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SplatExtension {
    /// Files of the draft have none.
    kernel: Option<String>,
    #[serde(default)]
    color_space: String,
    #[serde(default = "perspective")]
    projection: String,
    #[serde(default)]
    extensions: BTreeMap<String, serde::de::IgnoredAny>,
    #[serde(default, alias = "antialias")]
    antialiased: bool,
    #[serde(flatten)]
    others: BTreeMap<String, serde::de::IgnoredAny>,
}

/// What is done with the members of the extension.
pub const FIELDS: [Field; 6] = [
    ("kernel", FieldUse::Read),
    ("colorSpace", FieldUse::Read),
    ("projection", FieldUse::Read),
    ("sortingMethod", FieldUse::Harmless),
    ("antialiased", FieldUse::Read),
    ("extensions", FieldUse::Refused),
];

/// What is done with the attributes of a primitive.
pub const ATTRIBUTES: [Field; 6] = [
    ("POSITION", FieldUse::Read),
    ("KHR_gaussian_splatting:ROTATION", FieldUse::Read),
    ("KHR_gaussian_splatting:SCALE", FieldUse::Read),
    ("KHR_gaussian_splatting:OPACITY", FieldUse::Read),
    ("KHR_gaussian_splatting:SH_DEGREE_*", FieldUse::Read),
    // What a viewer without the extension draws: points of this colour.
    ("COLOR_0", FieldUse::Harmless),
];

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: usize,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct BufferView {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

#[derive(Deserialize)]
pub struct Buffer {
    pub uri: Option<String>,
}

fn perspective() -> String {
    "perspective".into()
}

impl Document {
    /// Reads the document, and checks that the file requires no extension that is not known here.
    pub fn read(json: &[u8]) -> Result<Document, PriorError> {
        let document: Document =
            serde_json::from_slice(json).map_err(|e| refusal(format!("document: {e}")))?;
        let unknown = |name: &&String| !KNOWN.contains(&name.as_str());
        match document.extensions_required.iter().find(unknown) {
            Some(name) => Err(refusal(format!("the file requires {name}, which is not read here"))),
            None => Ok(document),
        }
    }
}

impl Primitive {
    /// Highest degree of spherical harmonics that it names.
    pub fn sh_degree(&self) -> u32 {
        let has = |degree: &u32| {
            let prefix = format!("{SPLATS}:SH_DEGREE_{degree}_");
            self.attributes.keys().any(|name| name.starts_with(&prefix))
        };
        (1..=3).filter(has).max().unwrap_or(0)
    }

    pub fn is_antialiased(&self) -> bool {
        self.extensions.splats.as_ref().is_some_and(|splats| splats.antialiased)
    }

    /// Warnings of what is left out.
    pub fn warnings(&self) -> Vec<PriorWarning> {
        let names = self.attributes.keys().map(String::as_str);
        let mut warnings = passed_over("glTF attribute", names, &ATTRIBUTES);
        let splats = self.extensions.splats.iter();
        let others = splats.flat_map(|splats| splats.others.keys().map(String::as_str));
        warnings.extend(passed_over("glTF member", others, &FIELDS));
        warnings
    }

    /// How many splats its positions say that it has.
    pub fn count(&self, document: &Document) -> Option<usize> {
        Some(document.accessors.get(*self.attributes.get("POSITION")?)?.count)
    }
}

impl SplatExtension {
    /// Refuses what would be drawn wrong.
    pub fn check(&self) -> Result<(), PriorError> {
        if let Some(name) = self.extensions.keys().next() {
            return Err(refusal(format!(
                "splats by {name}, which is not read here: save them without it"
            )));
        }
        let Some(kernel) = &self.kernel else {
            return Err(refusal(format!(
                "no kernel: a file of a draft of {SPLATS}, with _ROTATION, _SCALE and COLOR_0; convert it anew"
            )));
        };
        for (what, found, known) in [
            ("kernel", kernel, "ellipse"),
            ("projection", &self.projection, "perspective"),
            ("colorSpace", &self.color_space, "srgb_rec709_display"),
        ] {
            if found != known {
                return Err(refusal(format!("{what} {found:?}: {known:?} is read here")));
            }
        }
        Ok(())
    }
}
