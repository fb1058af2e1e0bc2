//! What a prior's file holds.

use super::coordinate_frame::CoordinateFrame;
use super::key_frames::KeyFrames;
use super::options::RenderOptions;
use super::report::PriorFormat;
use super::splats::Splats;
use crate::coder_tables::Tables;
use crate::image::Preprocessing;

/// What a file holds: splats as they stand there, not yet checked.
#[derive(Debug)]
pub struct PriorFile {
    /// The splats.
    pub splats: Splats,
    /// Render options by the file, or those usual for its format.
    pub options: RenderOptions,
    /// Which format.
    pub format: PriorFormat,
    /// Comments in its header, without those that are key frames.
    pub comments: Vec<String>,
    /// The key frames in it.
    pub key_frames: KeyFrames,
    /// The coder tables in it.
    pub coder_tables: Option<Tables>,
    /// How the pictures that it was trained on were treated; if it does not say so, not at all.
    pub preprocessing: Preprocessing,
    /// The coordinate frame that it states; `None`: it is that of the splats' positions.
    pub frame: Option<CoordinateFrame>,
}
