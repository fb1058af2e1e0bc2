//! What a user should know of a file that was read.

use std::fmt;

/// What was left out of a prior's file, or understood in another way than the file may mean it.
#[derive(Clone, Debug, PartialEq)]
pub enum PriorWarning {
    /// Something that no list of fields knows: the field's kind and name. The trainer may draw another picture by it.
    PassedOver(String),
    /// So many splats have a scale of zero, as those of 2D Gaussian Splatting.
    Flat(usize),
    /// Numbers that stand on another scale than the format says, and were read so.
    ReadAs {
        /// Which ones.
        what: &'static str,
        /// What they were taken for.
        taken_for: &'static str,
    },
    /// Numbers that look as if they stood on another scale than the format says. They were read as the format says.
    LooksLike {
        /// Which ones.
        what: &'static str,
        /// What they look like.
        looks_like: &'static str,
    },
    /// The scene lies far from the origin of its coordinates. Its splats count from another one.
    Moved {
        /// The new one.
        origin: [f64; 3],
        /// How far 32-bit numbers are apart there, if the file's positions are no finer.
        coarse: Option<f64>,
    },
    /// A file in the prior's folder holds its key frames and other extras, under another name than the prior's.
    Misnamed {
        /// Its name.
        found: String,
        /// The one that is looked for.
        due: String,
    },
}

impl fmt::Display for PriorWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PriorWarning::PassedOver(what) => {
                write!(
                    f,
                    "{what} is not known here and was left out: the picture may not be the trainer's"
                )
            }
            PriorWarning::Flat(count) => write!(
                f,
                "{count} splats have a scale of zero, as those of 2D Gaussian Splatting: they are drawn as flat \
                 Gaussians, not by its rule"
            ),
            PriorWarning::ReadAs { what, taken_for } => {
                write!(
                    f,
                    "{what} were read as {taken_for}: check the picture, and save the scene anew"
                )
            }
            PriorWarning::Moved { origin: [x, y, z], coarse } => {
                write!(
                    f,
                    "the scene lies far from the origin of its coordinates: its splats count from {x}, {y}, {z}; poses \
                     are still the file's"
                )?;
                coarse.map_or(Ok(()), |step| {
                    write!(
                        f,
                        ". Its positions are rounded to 32 bits, which are {step} apart there: have them written as \
                         doubles, or trained near the origin"
                    )
                })
            }
            PriorWarning::Misnamed { found, due } => write!(
                f,
                "{found} holds this prior's key frames and extras, and was left out, as its name is another: copy it \
                 to {due}"
            ),
            PriorWarning::LooksLike { what, looks_like } => write!(
                f,
                "{what} look like {looks_like}: if the picture is wrong, have the scene written anew"
            ),
        }
    }
}
