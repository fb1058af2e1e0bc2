//! A checked prior.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::besides::Besides;
use super::check::{clamp_logits, drop_invalid, flatten};
use super::coordinate_frame::{CoordinateFrame, origin_of};
use super::error::PriorError;
use super::extras::Extras;
use super::extras_file;
use super::file::{self, read_prior_file};
use super::file_content::PriorFile;
use super::id::PriorId;
use super::identity::identity_of;
use super::key_frames::KeyFrames;
use super::limits::MAX_SPLATS;
use super::near_plane::near_plane;
use super::options::{RenderOptions, RenderOverrides};
use super::plausible;
use super::report::{LoadReport, PriorFormat};
use super::splats::Splats;
use super::warning::PriorWarning;
use crate::coder_tables::Tables;
use crate::filter_weights::FilterWeights;
use crate::image::Preprocessing;

/// A checked, immutable prior: it has at least one splat, and the renderer can use every parameter.
#[derive(Clone, Debug)]
pub struct Prior {
    splats: Splats,
    options: RenderOptions,
    id: PriorId,
    frame: CoordinateFrame,
    /// The frame, if its file states it.
    stated_frame: Option<CoordinateFrame>,
    coder_tables: Option<Arc<Tables>>,
    extras: Extras,
    report: LoadReport,
}

impl Prior {
    /// Most splats a prior may hold: what a 32-bit index reaches.
    pub const MAX_SPLATS: usize = MAX_SPLATS;

    /// Reads a prior from a file. The content tells the format. [`super::ply`] says where the render options come from;
    /// `overrides` replaces them. Beside a file of a foreign format may be one of [`Extras`]: [`extras_file`].
    pub fn open(path: &Path, overrides: &RenderOverrides) -> Result<Prior, PriorError> {
        Prior::from_file(path, Prior::read_file(path)?, overrides)
    }

    /// Reads the content of a prior's file. If it is of another format, reads only its first bytes.
    pub fn read_file(path: &Path) -> Result<Vec<u8>, PriorError> {
        let name = path.display().to_string();
        read_prior_file(path).map_err(|e| PriorError::Read(e).in_file(&name))
    }

    /// As [`Prior::open`], from the content of the file at `path`.
    pub fn from_file(
        path: &Path,
        bytes: Vec<u8>,
        overrides: &RenderOverrides,
    ) -> Result<Prior, PriorError> {
        let named = |error| file::refusal(error, path).in_file(&path.display().to_string());
        let content = file::read(&bytes).map_err(named)?;
        drop(bytes);
        Prior::from_file_content(path, content, overrides)
    }

    /// As [`Prior::from_file`], of what another reader found in the file.
    pub fn from_file_content(
        path: &Path,
        content: PriorFile,
        overrides: &RenderOverrides,
    ) -> Result<Prior, PriorError> {
        let named = |error: PriorError| error.in_file(&path.display().to_string());
        let read = Prior::build(content).map_err(named)?;
        let extras = match read.report.format.is_own() {
            true => None,
            false => extras_file::read(path, read.id, read.len())?,
        };
        let misnamed = if extras.is_none() && !read.report.format.is_own() {
            extras_file::misnamed(path, read.id)
        } else {
            None
        };
        let mut prior = read.with_overrides(overrides).map_err(named)?;
        prior.report.warnings.extend(misnamed.map(|found| PriorWarning::Misnamed {
            found,
            due: extras_file::path_beside(path).display().to_string(),
        }));
        Ok(match extras {
            Some(extras) => Prior { extras, ..prior },
            None => prior,
        })
    }

    /// Reads a prior from a file's content; `name` stands for the file in errors.
    pub fn from_bytes(
        bytes: &[u8],
        name: &str,
        overrides: &RenderOverrides,
    ) -> Result<Prior, PriorError> {
        let content = file::read(bytes).map_err(|error| error.in_file(name))?;
        Prior::from_content(content, name, overrides)
    }

    /// As [`Prior::from_bytes`], of what another reader found in the content.
    pub fn from_content(
        content: PriorFile,
        name: &str,
        overrides: &RenderOverrides,
    ) -> Result<Prior, PriorError> {
        let options = overrides.over(content.options);
        let near_by_size = content.near_by_size && overrides.near.is_none();
        Prior::build(PriorFile { options, near_by_size, ..content })
            .map_err(|error| error.in_file(name))
    }

    /// Makes a prior of splats in memory. Invalid splats are dropped and counted, as from a file.
    pub fn from_splats(splats: Splats, options: RenderOptions) -> Result<Prior, PriorError> {
        Prior::build(PriorFile::new(splats, options, PriorFormat::Memory))
    }

    fn build(mut file: PriorFile) -> Result<Prior, PriorError> {
        let moved = moved(&mut file);
        let PriorFile { mut splats, mut options, format, comments, coder_tables, extras, .. } =
            file;
        options.check()?;
        splats.check_shape()?;
        let read = splats.len();
        if read == 0 {
            return Err(PriorError::Empty);
        }
        if read > Self::MAX_SPLATS {
            return Err(PriorError::TooMany { count: read });
        }
        let clamped_logits = clamp_logits(&mut splats);
        let mut warnings = file.warnings;
        warnings.extend(moved);
        warnings
            .extend(Some(flatten(&mut splats)).filter(|flat| *flat > 0).map(PriorWarning::Flat));
        let dropped = drop_invalid(&mut splats);
        if let (true, Some(first)) = (splats.is_empty(), dropped.first()) {
            return Err(PriorError::AllDropped { read, fault: first.fault });
        }
        let kept = splats.len();
        extras.check(kept)?;
        let stated_frame = file.frame;
        let frame = stated_frame.unwrap_or_else(|| CoordinateFrame::of(&splats.positions));
        if file.near_by_size {
            options.near = near_plane(options.near, frame.spread);
        }
        if !format.is_own() {
            warnings.extend(plausible::warnings(&splats, &frame));
        }
        Ok(Prior {
            id: identity_of(&splats, &options, stated_frame.as_ref(), coder_tables.as_ref()),
            frame,
            splats,
            options,
            stated_frame,
            coder_tables: coder_tables.map(Arc::new),
            extras,
            report: LoadReport { format, read, kept, dropped, clamped_logits, warnings, comments },
        })
    }

    /// The same splats, with other render options. If these differ, it is another prior.
    ///
    /// # Errors
    /// If they are none that a renderer can use.
    pub fn with_overrides(mut self, overrides: &RenderOverrides) -> Result<Prior, PriorError> {
        self.options = overrides.over(self.options);
        self.options.check()?;
        if *overrides != RenderOverrides::default() {
            self.id = self.identity();
        }
        Ok(self)
    }

    /// The same splats with other coder tables, or none. If the tables differ, it is another prior.
    pub fn with_coder_tables(mut self, tables: Option<Tables>) -> Prior {
        self.coder_tables = tables.map(Arc::new);
        self.id = self.identity();
        self
    }

    fn identity(&self) -> PriorId {
        let Besides { options, frame, coder_tables, .. } = self.besides();
        identity_of(&self.splats, options, frame, coder_tables)
    }

    /// The same prior with other extras; they are no part of its identity.
    ///
    /// # Errors
    /// If there is doubt of another number of splats.
    pub fn with_extras(self, extras: Extras) -> Result<Prior, PriorError> {
        extras.check(self.len())?;
        Ok(Prior { extras, ..self })
    }

    /// The same prior with other key frames; they are no part of its identity.
    pub fn with_key_frames(mut self, key_frames: KeyFrames) -> Prior {
        self.extras.key_frames = key_frames;
        self
    }

    /// The same prior with another preprocessing; it is no part of its identity.
    pub fn with_preprocessing(mut self, preprocessing: Preprocessing) -> Prior {
        self.extras.preprocessing = preprocessing;
        self
    }

    /// The same prior with other weights of the display filter, or none; they are no part of its identity.
    pub fn with_filter_weights(mut self, weights: Option<FilterWeights>) -> Prior {
        self.extras.filter_weights = weights.map(Arc::new);
        self
    }

    /// Number of splats; never zero.
    #[allow(clippy::len_without_is_empty)] // A prior is never empty.
    pub fn len(&self) -> usize {
        self.splats.len()
    }

    /// The trained parameters.
    pub fn splats(&self) -> &Splats {
        &self.splats
    }

    /// The world's point that positions of splats and key frames count from: zero, unless the scene lies far from its
    /// coordinates' origin. Encoders and decoders take and give poses in the world; renderers take them from here
    /// ([`Pose::relative_to`](crate::Pose::relative_to)).
    pub fn origin(&self) -> DVec3 {
        self.splats.origin.into()
    }

    /// How to render it.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// Its identity. If it is not equal on both sides of a link, their pictures differ.
    pub fn id(&self) -> PriorId {
        self.id
    }

    /// The place and size of the prior: the frame in which packets state camera positions.
    pub fn coordinate_frame(&self) -> CoordinateFrame {
        self.frame
    }

    /// All that it holds besides splats, for writing it.
    pub fn besides(&self) -> Besides<'_> {
        Besides {
            options: &self.options,
            frame: self.stated_frame.as_ref(),
            coder_tables: self.coder_tables.as_deref(),
            extras: &self.extras,
        }
    }

    /// What it holds that changes no picture.
    pub fn extras(&self) -> &Extras {
        &self.extras
    }

    /// Where to look for a lost camera; possibly none.
    pub fn key_frames(&self) -> &KeyFrames {
        &self.extras.key_frames
    }

    /// The scene coder tables; `None`: the generic tables are used.
    pub fn coder_tables(&self) -> Option<&Arc<Tables>> {
        self.coder_tables.as_ref()
    }

    /// The display filter's weights for the scene; `None`: the library's are used.
    pub fn filter_weights(&self) -> Option<&Arc<FilterWeights>> {
        self.extras.filter_weights.as_ref()
    }

    /// How the pictures that it was trained on were treated. Encoders treat their frames in the same way.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.extras.preprocessing
    }

    /// What loading found.
    pub fn report(&self) -> &LoadReport {
        &self.report
    }
}

/// Has the splats of a foreign file count from a point near to them, if they lie far from zero. Returns what its user
/// should know.
fn moved(file: &mut PriorFile) -> Option<PriorWarning> {
    let exact = file.exact_positions.take();
    let is_read = !file.format.is_own() && file.format != PriorFormat::Memory;
    if !is_read || file.states_origin {
        return None;
    }
    let origin = match &exact {
        Some(exact) => origin_of(exact),
        None => origin_of(&file.splats.positions),
    }?;
    let exact = exact.unwrap_or_else(|| file.splats.positions_from_zero());
    let is_coarse = exact.iter().flatten().all(|v| f64::from(*v as f32) == *v || !v.is_finite());
    file.splats.place(origin, &exact);
    file.extras.key_frames = file.extras.key_frames.relative_to(origin.into());
    let farthest = origin.into_iter().map(f64::abs).fold(0.0, f64::max) as f32;
    let coarse = is_coarse.then(|| f64::from(farthest.next_up() - farthest));
    Some(PriorWarning::Moved { origin, coarse })
}
