//! Why a prior cannot be used.

use super::fault::Fault;
use super::id::PriorId;
use super::limits::{MAX_KEY_FRAMES, MAX_SH_DEGREE, MAX_SPLATS};

/// Why a prior cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum PriorError {
    #[error("{0}")]
    Read(#[source] std::io::Error),
    #[error("writing: {0}")]
    Write(#[source] std::io::Error),
    #[error("neither a PLY file nor another format of priors known here")]
    UnknownFormat,
    #[error("{0}")]
    Foreigner(&'static str),
    #[error("PLY header: {reason}")]
    Header { reason: String },
    #[error("no element \"vertex\" in the PLY header")]
    NoVertices,
    #[error("property \"{property}\" is missing: no scene as Inria or nerfstudio write it")]
    MissingProperty { property: String },
    #[error(
        "a point cloud: it has positions, but no opacity, scale and rotation of splats; train one with `nvsprior map`"
    )]
    PointCloud,
    #[error("property \"{property}\" must be one number per splat")]
    BadProperty { property: String },
    #[error("{found} properties f_rest_*: spherical harmonics need 0, 9, 24 or 45")]
    ShProperties { found: usize },
    #[error("truncated: the header promises {needed} bytes or more, the file has {found}")]
    Truncated { needed: u128, found: usize },
    #[error("splat {splat}, before byte {offset}: {reason}")]
    Row { splat: usize, offset: u64, reason: String },
    /// A comment in the header that is meant for this program cannot be understood. It is not ignored: if the two sides
    /// read different options, they render different pictures.
    #[error(
        "\"comment {comment}\" is no render option, no preprocessing and no key frame that is known here"
    )]
    Comment { comment: String },
    #[error("no splats")]
    Empty,
    #[error("{count} splats: more than {}", MAX_SPLATS)]
    TooMany { count: usize },
    #[error("none of the {read} splats is usable; the first has a {fault}")]
    AllDropped { read: usize, fault: Fault },
    #[error(
        "render option {option} = {value}: near must be finite and positive, \
         alpha_max in (0, 1), background in [0, 1]"
    )]
    Option { option: &'static str, value: f32 },
    #[error("spherical harmonics of degree {degree}: at most {}", MAX_SH_DEGREE)]
    ShDegree { degree: u32 },
    #[error("array {array} holds {found} entries, but {expected} are due")]
    Shape { array: &'static str, found: usize, expected: usize },
    #[error("{format} of version {version}; this program reads version {known}: update it")]
    Newer { format: &'static str, version: u32, known: u32 },
    #[error("{format}: {reason}")]
    Content { format: &'static str, reason: String },
    #[error("{format}, byte {offset}: {reason}")]
    Field { format: &'static str, offset: u64, reason: String },
    #[error("damaged: the check says {stated:08x}, the content {found:08x}")]
    Damaged { stated: u32, found: u32 },
    #[error("the splats are prior {found}, not {stated} as the file says")]
    Identity { stated: PriorId, found: PriorId },
    #[error("about prior {stated}, not about {found}: remove it, or have it written anew")]
    Foreign { stated: PriorId, found: PriorId },
    #[error("splat {splat} has a {fault}")]
    Invalid { splat: usize, fault: Fault },
    #[error("splat {splat}: {column} {value} is out of the range of steps of {step}")]
    OutOfSteps { splat: usize, column: &'static str, value: f32, step: f32 },
    #[error("quantisation of {name} in steps of {step}: at least 1e-6, at most {max}")]
    Step { name: &'static str, step: f32, max: f32 },
    #[error("part {part}: {error}")]
    InPart { part: String, error: Box<PriorError> },
    #[error("part {part} must be understood, and is not known here: update this program")]
    UnknownPart { part: String },
    #[error("block {block}: {error}")]
    InBlock { block: usize, error: Box<PriorError> },
    #[error("blocks of {size} splats: at least 1, at most {most}")]
    BlockSize { size: usize, most: usize },
    #[error("key frame {index}: {reason}")]
    KeyFrame { index: usize, reason: &'static str },
    #[error("{count} key frames: at most {}; thin them out by a greater distance", MAX_KEY_FRAMES)]
    TooManyKeyFrames { count: usize },
    #[error("{file}: {error}")]
    InFile { file: String, error: Box<PriorError> },
}

impl PriorError {
    /// Adds the name of the file to an error.
    pub fn in_file(self, file: &str) -> PriorError {
        PriorError::InFile { file: file.to_owned(), error: Box::new(self) }
    }
}
