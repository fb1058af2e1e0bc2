//! What the identity covers besides splats.

use super::super::{CoordinateFrame, PriorError, RenderOptions};
use super::file::Container;
use super::part::PartName;
use super::{frame, options, tables};
use crate::coder_tables::Tables;

/// What the identity covers besides splats.
#[derive(Clone, Debug, PartialEq)]
pub struct Covered {
    pub options: RenderOptions,
    pub frame: Option<CoordinateFrame>,
    pub coder_tables: Option<Tables>,
    /// What the splats' positions count from.
    pub origin: [f64; 3],
}

impl Covered {
    /// Reads them. Options must be there.
    pub fn read(file: &Container) -> Result<Covered, PriorError> {
        let options = file.required(PartName::OPTIONS)?.read_content(options::read)?;
        let frame = file.read_part(PartName::FRAME, frame::read)?;
        let coder_tables = file.read_part(PartName::TABLES, tables::read)?;
        let origin = file.read_part(PartName::ORIGIN, frame::read_origin)?.unwrap_or_default();
        Ok(Covered { options, frame, coder_tables, origin })
    }
}

/// The parts that the identity covers, without splats, each as its name and content.
pub fn covered_parts(
    options: &RenderOptions,
    frame: Option<&CoordinateFrame>,
    coder_tables: Option<&Tables>,
    origin: [f64; 3],
) -> [(PartName, Option<Vec<u8>>); 4] {
    let is_moved = origin != [0.0; 3];
    [
        (PartName::OPTIONS, Some(options::to_bytes(options))),
        (PartName::FRAME, frame.map(frame::to_bytes)),
        (PartName::TABLES, coder_tables.map(Tables::write)),
        (
            PartName::ORIGIN,
            is_moved.then(|| origin.into_iter().flat_map(f64::to_le_bytes).collect()),
        ),
    ]
}
