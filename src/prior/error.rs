//! Why a prior cannot be used.

use super::fault::Fault;
use super::id::PriorId;
use super::limits::{MAX_KEY_FRAMES, MAX_SH_DEGREE, MAX_SPLATS};

/// Why a prior cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PriorError {
    /// The file cannot be read.
    #[error("{0}")]
    Read(#[source] std::io::Error),
    /// A prior, its key frames or its coder tables cannot be written.
    #[error("writing: {0}")]
    Write(#[source] std::io::Error),
    /// The content is of no format known here.
    #[error("neither a PLY file nor another format of priors known here")]
    UnknownFormat,
    /// The header breaks the format's grammar.
    #[error("PLY header: {reason}")]
    Header {
        /// What is wrong with it.
        reason: String,
    },
    /// The header names no vertex element.
    #[error("no element \"vertex\" in the PLY header")]
    NoVertices,
    /// A property that every splat needs is not there.
    #[error("property \"{property}\" is missing: no scene as Inria or nerfstudio write it")]
    MissingProperty {
        /// Its name.
        property: String,
    },
    /// A property that splats need stands there twice, or as a list.
    #[error("property \"{property}\" must be one number per splat")]
    BadProperty {
        /// Its name.
        property: String,
    },
    /// The number of `f_rest_*` properties belongs to no degree of spherical harmonics.
    #[error("{found} properties f_rest_*: spherical harmonics need 0, 9, 24 or 45")]
    ShProperties {
        /// How many there are.
        found: usize,
    },
    /// The file is shorter than its header says.
    #[error("truncated: the header promises {needed} bytes or more, the file has {found}")]
    Truncated {
        /// Least size that the header can stand for, bytes.
        needed: u128,
        /// Size of the file, bytes.
        found: usize,
    },
    /// A splat cannot be read.
    #[error("splat {splat}, before byte {offset}: {reason}")]
    Row {
        /// Index of the splat.
        splat: usize,
        /// Where reading stopped, bytes from the start of the file.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A comment in the header that is meant for this program cannot be understood. It is not ignored: if the two sides
    /// read different options, they render different pictures.
    #[error(
        "\"comment {comment}\" is no render option, no preprocessing and no key frame that is known here"
    )]
    Comment {
        /// The comment.
        comment: String,
    },
    /// There are no splats.
    #[error("no splats")]
    Empty,
    /// There are more splats than an index reaches.
    #[error("{count} splats: more than {}", MAX_SPLATS)]
    TooMany {
        /// How many.
        count: usize,
    },
    /// Not one splat is sound.
    #[error("none of the {read} splats is usable; the first has a {fault}")]
    AllDropped {
        /// How many there are.
        read: usize,
        /// What the first one suffers from.
        fault: Fault,
    },
    /// A render option lies outside its range.
    #[error(
        "render option {option} = {value}: near must be finite and positive, \
         alpha_max in (0, 1), background in [0, 1]"
    )]
    Option {
        /// Its name.
        option: &'static str,
        /// Its value.
        value: f32,
    },
    /// The degree of the spherical harmonics is not known.
    #[error("spherical harmonics of degree {degree}: at most {}", MAX_SH_DEGREE)]
    ShDegree {
        /// The degree.
        degree: u32,
    },
    /// Two arrays of one set of splats disagree.
    #[error("array {array} holds {found} entries, but {expected} are due")]
    Shape {
        /// Name of the array.
        array: &'static str,
        /// Entries it has.
        found: usize,
        /// Entries that the positions and the degree ask for.
        expected: usize,
    },
    /// The file is of a newer version of its format.
    #[error("{format} of version {version}; this program reads version {known}: update it")]
    Newer {
        /// The format.
        format: &'static str,
        /// The file's version.
        version: u32,
        /// The newest version that is known here.
        known: u32,
    },
    /// A field of a binary format cannot be used.
    #[error("{format}, byte {offset}: {reason}")]
    Field {
        /// The format.
        format: &'static str,
        /// Where the field stands, bytes from the start of the file.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// The content of a compact prior was changed, or its end is missing.
    #[error("damaged: the check says {stated:08x}, the content {found:08x}")]
    Damaged {
        /// The check in the file.
        stated: u32,
        /// What the content gives.
        found: u32,
    },
    /// The splats of a file are not those that were written.
    #[error("the splats are prior {found}, not {stated} as the file says")]
    Identity {
        /// What the file says.
        stated: PriorId,
        /// What the splats and render options give.
        found: PriorId,
    },
    /// A splat to be written is unsound.
    #[error("splat {splat} has a {fault}")]
    Unsound {
        /// Its index.
        splat: usize,
        /// What it suffers from.
        fault: Fault,
    },
    /// A value is too large to be written in steps of the wanted size.
    #[error("splat {splat}: {column} {value} is out of the range of steps of {step}")]
    OutOfSteps {
        /// Index of the splat.
        splat: usize,
        /// What the value is.
        column: &'static str,
        /// The value.
        value: f32,
        /// The step.
        step: f32,
    },
    /// A step of a quantisation lies outside its range.
    #[error("quantisation of {name} in steps of {step}: at least 1e-6, at most {most}")]
    Step {
        /// What is quantised.
        name: &'static str,
        /// The step.
        step: f32,
        /// The largest allowed.
        most: f32,
    },
    /// A pose is no key frame.
    #[error("key frame {index}: {reason}")]
    KeyFrame {
        /// Its index.
        index: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// There are more key frames than a prior may have.
    #[error("{count} key frames: at most {}; thin them out by a greater distance", MAX_KEY_FRAMES)]
    TooManyKeyFrames {
        /// How many, at least.
        count: usize,
    },
    /// A line of a file of key frames cannot be used.
    #[error("line {line}: {reason}")]
    Line {
        /// Its number, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// One of the other errors, about the content of a file.
    #[error("{file}: {error}")]
    InFile {
        /// The file.
        file: String,
        /// What is wrong with it.
        error: Box<PriorError>,
    },
}

impl PriorError {
    /// Adds the name of the file to an error.
    pub(super) fn in_file(self, file: &str) -> PriorError {
        PriorError::InFile { file: file.to_owned(), error: Box::new(self) }
    }
}
