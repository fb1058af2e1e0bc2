//! What a prior's file holds.

use super::coordinate_frame::CoordinateFrame;
use super::extras::Extras;
use super::options::RenderOptions;
use super::report::PriorFormat;
use super::splats::Splats;
use super::warning::PriorWarning;
use crate::coder_tables::Tables;

/// What a file holds: splats as they stand there, not yet checked.
#[derive(Debug)]
pub struct PriorFile {
    /// The splats.
    pub splats: Splats,
    /// Their positions, if the file may hold them finer than [`Splats::positions`].
    pub exact_positions: Option<Vec<[f64; 3]>>,
    /// The file states [`Splats::origin`]: splats that lie far from there stay as they are.
    pub states_origin: bool,
    /// Render options by the file, or those usual for its format.
    pub options: RenderOptions,
    /// Neither the file nor its format states the near plane: it follows from the scene's size, at most
    /// [`RenderOptions::near`].
    pub near_by_size: bool,
    /// Which format.
    pub format: PriorFormat,
    /// Comments in its header, without those that are key frames.
    pub comments: Vec<String>,
    /// The coder tables in it.
    pub coder_tables: Option<Tables>,
    /// The coordinate frame that it states; `None`: it is that of the splats' positions.
    pub frame: Option<CoordinateFrame>,
    /// What else is in it.
    pub extras: Extras,
    /// What its user should know.
    pub warnings: Vec<PriorWarning>,
}

impl PriorFile {
    /// One that holds nothing else.
    pub fn new(splats: Splats, options: RenderOptions, format: PriorFormat) -> PriorFile {
        PriorFile {
            splats,
            exact_positions: None,
            states_origin: false,
            options,
            near_by_size: false,
            format,
            comments: Vec::new(),
            coder_tables: None,
            frame: None,
            extras: Extras::default(),
            warnings: Vec::new(),
        }
    }
}
