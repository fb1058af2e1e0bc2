//! A checked prior.

use std::path::Path;
use std::sync::Arc;

use super::check::{clamp_logits, drop_invalid};
use super::coordinate_frame::CoordinateFrame;
use super::error::PriorError;
use super::file::{self, read_prior_file};
use super::file_content::PriorFile;
use super::filter_file;
use super::id::PriorId;
use super::identity::identity_of;
use super::key_frames::KeyFrames;
use super::limits::MAX_SPLATS;
use super::options::{RenderOptions, RenderOverrides};
use super::part_source::PartSource;
use super::report::{LoadReport, PriorFormat};
use super::splats::Splats;
use super::tables_file;
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
    /// Its file states the frame.
    frame_is_stated: bool,
    key_frames: KeyFrames,
    coder_tables: Option<Arc<Tables>>,
    filter_weights: Option<Arc<FilterWeights>>,
    preprocessing: Preprocessing,
    report: LoadReport,
}

impl Prior {
    /// Most splats a prior may hold: what a 32-bit index reaches.
    pub const MAX_SPLATS: usize = MAX_SPLATS;

    /// Reads a prior from a file. The content tells the format. [`super::ply`] says where the render options come from;
    /// `overrides` replaces them. Key frames come from the file at [`KeyFrames::path_beside`] if there is one, else
    /// from the prior's own file. Coder tables come from [`tables_file::path_beside`] in the same way, and
    /// weights of the display filter from [`filter_file::path_beside`].
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
        let (key_frames, tables) = (KeyFrames::open_beside(path)?, tables_file::open_beside(path)?);
        let filter_weights = filter_file::open_beside(path)?;
        let mut prior = Prior::from_bytes(&bytes, &path.display().to_string(), overrides)?;
        drop(bytes);
        if let Some(key_frames) = key_frames {
            prior.set_key_frames(key_frames, PartSource::Beside);
        }
        if let Some(tables) = tables {
            prior.set_coder_tables(Some(tables), PartSource::Beside);
        }
        Ok(prior.with_filter_weights(filter_weights))
    }

    /// Reads a prior from a file's content; `name` stands for the file in errors.
    pub fn from_bytes(
        bytes: &[u8],
        name: &str,
        overrides: &RenderOverrides,
    ) -> Result<Prior, PriorError> {
        let build = |file: PriorFile| {
            Prior::build(PriorFile { options: overrides.over(file.options), ..file })
        };
        file::read(bytes).and_then(build).map_err(|error| error.in_file(name))
    }

    /// Makes a prior of splats in memory. Invalid splats are dropped and counted, as from a file.
    pub fn from_splats(splats: Splats, options: RenderOptions) -> Result<Prior, PriorError> {
        Prior::build(PriorFile {
            splats,
            options,
            format: PriorFormat::Memory,
            comments: Vec::new(),
            key_frames: KeyFrames::NONE,
            coder_tables: None,
            preprocessing: Preprocessing::NONE,
            frame: None,
        })
    }

    fn build(file: PriorFile) -> Result<Prior, PriorError> {
        let PriorFile {
            mut splats,
            options,
            format,
            comments,
            key_frames,
            coder_tables,
            preprocessing,
            frame: stated_frame,
        } = file;
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
        let dropped = drop_invalid(&mut splats);
        if let (true, Some(first)) = (splats.is_empty(), dropped.first()) {
            return Err(PriorError::AllDropped { read, fault: first.fault });
        }
        let kept = splats.len();
        let report = LoadReport {
            format,
            read,
            kept,
            dropped,
            clamped_logits,
            comments,
            key_frames: PartSource::in_file(!key_frames.is_empty()),
            coder_tables: PartSource::in_file(coder_tables.is_some()),
        };
        let id = identity_of(&splats, &options, coder_tables.as_ref(), stated_frame.as_ref());
        let frame = stated_frame.unwrap_or_else(|| CoordinateFrame::of(&splats.positions));
        let coder_tables = coder_tables.map(Arc::new);
        Ok(Prior {
            splats,
            options,
            id,
            frame,
            frame_is_stated: stated_frame.is_some(),
            key_frames,
            coder_tables,
            filter_weights: None,
            preprocessing,
            report,
        })
    }

    /// The same prior with other key frames; they are no part of its identity.
    pub fn with_key_frames(mut self, key_frames: KeyFrames) -> Prior {
        self.set_key_frames(key_frames, PartSource::Memory);
        self
    }

    /// The same splats with other coder tables, or none. If the tables differ, it is another prior.
    pub fn with_coder_tables(mut self, tables: Option<Tables>) -> Prior {
        self.set_coder_tables(tables, PartSource::Memory);
        self
    }

    /// The same prior with another preprocessing; it is no part of its identity.
    pub fn with_preprocessing(mut self, preprocessing: Preprocessing) -> Prior {
        self.preprocessing = preprocessing;
        self
    }

    /// The same prior with other weights of the display filter, or none; they are no part of its identity.
    pub fn with_filter_weights(mut self, weights: Option<FilterWeights>) -> Prior {
        self.filter_weights = weights.map(Arc::new);
        self
    }

    fn set_key_frames(&mut self, key_frames: KeyFrames, source: PartSource) {
        self.key_frames = key_frames;
        self.report.key_frames = source;
    }

    fn set_coder_tables(&mut self, tables: Option<Tables>, source: PartSource) {
        let stated_frame = self.frame_is_stated.then_some(&self.frame);
        self.id = identity_of(&self.splats, &self.options, tables.as_ref(), stated_frame);
        self.report.coder_tables = if tables.is_some() { source } else { PartSource::None };
        self.coder_tables = tables.map(Arc::new);
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

    /// Where to look for a lost camera; possibly none.
    pub fn key_frames(&self) -> &KeyFrames {
        &self.key_frames
    }

    /// The scene coder tables; `None`: the generic tables are used.
    pub fn coder_tables(&self) -> Option<&Arc<Tables>> {
        self.coder_tables.as_ref()
    }

    /// The display filter's weights for the scene; `None`: the library's are used.
    pub fn filter_weights(&self) -> Option<&Arc<FilterWeights>> {
        self.filter_weights.as_ref()
    }

    /// How the pictures that it was trained on were treated. Encoders treat their frames in the same way.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// What loading found.
    pub fn report(&self) -> &LoadReport {
        &self.report
    }
}
