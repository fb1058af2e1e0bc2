//! What a prior's file holds besides splats.

use super::check::fault_of;
use super::container::{Container, Head, covered_parts};
use super::coordinate_frame::CoordinateFrame;
use super::error::PriorError;
use super::extras::Extras;
use super::options::RenderOptions;
use super::splats::Splats;
use crate::coder_tables::Tables;

/// What a file holds besides splats.
#[derive(Clone, Copy, Debug)]
pub struct Besides<'a> {
    /// How it is rendered.
    pub options: &'a RenderOptions,
    /// The coordinate frame, if it is not that of the splats.
    pub frame: Option<&'a CoordinateFrame>,
    /// The scene's own coder tables.
    pub coder_tables: Option<&'a Tables>,
    /// What changes no picture.
    pub extras: &'a Extras,
}

impl Besides<'_> {
    /// The file's head, and all its parts but the splats, which count from `origin`.
    pub(super) fn file(&self, head: Head, origin: [f64; 3]) -> Container<'static> {
        let mut file = Container::new(head);
        for (name, content) in covered_parts(self.options, self.frame, self.coder_tables, origin) {
            file.set(name, content);
        }
        self.extras.put(&mut file);
        file
    }

    /// Checks it, and the splats that it goes with.
    pub(super) fn check(&self, splats: &Splats) -> Result<(), PriorError> {
        self.options.check()?;
        splats.check_shape()?;
        if splats.is_empty() {
            return Err(PriorError::Empty);
        }
        if u32::try_from(splats.len()).is_err() {
            return Err(PriorError::TooMany { count: splats.len() });
        }
        self.extras.check(splats.len())?;
        let faults = (0..splats.len()).map(|splat| (splat, fault_of(splats, splat)));
        for (splat, fault) in faults {
            fault.map_or(Ok(()), |fault| Err(PriorError::Invalid { splat, fault }))?;
        }
        Ok(())
    }
}
