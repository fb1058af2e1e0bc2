//! The prior: a trained 3D Gaussian Splatting scene that vehicle and topside share.

pub mod analysis;
mod beside;
mod check;
mod claims;
pub mod coder_tables;
pub mod compact;
#[cfg(feature = "formats")]
mod compressed_ply;
mod coverage;
mod error;
mod frame;
mod identity;
mod key_frames;
mod part_source;
pub mod ply;
mod ply_header;
mod replace;
#[cfg(feature = "formats")]
mod spz;

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use check::{Dropped, Fault, INFINITE_LOGIT, MAX_COEFFICIENT, MAX_LOG_SCALE};
pub use claims::PriorClaims;
pub use coverage::Covering;
pub use error::PriorError;
pub use frame::PriorFrame;
pub use identity::PriorId;
pub use key_frames::KeyFrames;
pub use part_source::PartSource;
pub use replace::replace_file;

use crate::image::Preprocessing;
use crate::residual::wavelet::Tables;

/// How a prior was trained to be rendered; stored with it, and part of its identity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderOptions {
    /// Splats whose camera z is not above this are culled. gsplat: 0.01, Inria: 0.2.
    pub near: f32,
    /// Alpha is clamped to this. Inria and newest gsplat: 0.99, gsplat before 2026-03: 0.999.
    pub alpha_max: f32,
    /// Scale opacity by `√max(2.5e-5, det/det⁺)` (gsplat's anti-aliased mode).
    pub antialiased: bool,
    /// Linear RGB behind everything.
    pub background: [f32; 3],
}

impl RenderOptions {
    /// As Inria's trainer renders.
    pub const INRIA: RenderOptions =
        RenderOptions { near: 0.2, alpha_max: 0.99, antialiased: false, background: [0.0; 3] };
    /// As gsplat (nerfstudio's Splatfacto) renders.
    pub const GSPLAT: RenderOptions = RenderOptions { near: 0.01, ..RenderOptions::INRIA };

    /// Checks that the renderer's formulas hold: `near` finite and positive, `alpha_max` strictly
    /// between 0 and 1, background within `[0, 1]`.
    pub fn check(&self) -> Result<(), PriorError> {
        let refuse = |option, value| Err(PriorError::Option { option, value });
        if !(self.near.is_finite() && self.near > 0.0) {
            return refuse("near", self.near);
        }
        if !(self.alpha_max > 0.0 && self.alpha_max < 1.0) {
            return refuse("alpha_max", self.alpha_max);
        }
        match self.background.into_iter().find(|v| !(0.0..=1.0).contains(v)) {
            Some(value) => refuse("background", value),
            None => Ok(()),
        }
    }
}

/// Render options of a user that replace those of a prior's file; `None` keeps the file's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RenderOverrides {
    /// In place of [`RenderOptions::near`].
    pub near: Option<f32>,
    /// In place of [`RenderOptions::alpha_max`].
    pub alpha_max: Option<f32>,
    /// In place of [`RenderOptions::antialiased`].
    pub antialiased: Option<bool>,
    /// In place of [`RenderOptions::background`].
    pub background: Option<[f32; 3]>,
}

impl RenderOverrides {
    /// `options` with what is given here put in their place.
    pub fn over(&self, options: RenderOptions) -> RenderOptions {
        RenderOptions {
            near: self.near.unwrap_or(options.near),
            alpha_max: self.alpha_max.unwrap_or(options.alpha_max),
            antialiased: self.antialiased.unwrap_or(options.antialiased),
            background: self.background.unwrap_or(options.background),
        }
    }
}

/// Trained parameters of all splats, as files hold them: scales as logarithms, opacities as logits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Splats {
    /// Means, world axes, the prior's unit.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the splat's own axes.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions (w, x, y, z), splat to world; any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Logits of the opacities.
    pub opacity_logits: Vec<f32>,
    /// Spherical harmonics: per splat `(degree + 1)²` coefficients of RGB triples.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
}

impl Splats {
    /// Highest degree of spherical harmonics.
    pub const MAX_SH_DEGREE: u32 = 3;

    /// None yet, with room for `count` of the degree.
    pub(crate) fn with_capacity(count: usize, sh_degree: u32) -> Splats {
        let mut splats = Splats { sh_degree, ..Splats::default() };
        splats.positions.reserve_exact(count);
        splats.log_scales.reserve_exact(count);
        splats.rotations.reserve_exact(count);
        splats.opacity_logits.reserve_exact(count);
        splats.sh.reserve_exact(count * splats.sh_stride());
        splats
    }

    /// Number of splats.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Floats of spherical harmonics per splat: `3 (degree + 1)²`.
    pub fn sh_stride(&self) -> usize {
        3 * (self.sh_degree as usize + 1).pow(2)
    }

    /// Rotation of splat `index` at unit length, (w, x, y, z). The stored rotation may have any
    /// length. It is kept as trained, so that reading and writing a prior does not change its
    /// identity.
    pub fn unit_rotation(&self, index: usize) -> [f32; 4] {
        let q = self.rotations[index];
        let length = check::quaternion_length(q);
        q.map(|v| (f64::from(v) / length) as f32)
    }

    /// Opacity of splat `index`, from its logit.
    pub fn opacity(&self, index: usize) -> f64 {
        1.0 / (1.0 + libm::exp(-f64::from(self.opacity_logits[index])))
    }

    /// The splats that `kept` names, in their order.
    ///
    /// # Panics
    /// If `kept` has not an entry per splat.
    pub fn filtered(&self, kept: &[bool]) -> Splats {
        assert_eq!(kept.len(), self.len(), "one entry per splat");
        Splats {
            positions: pick(&self.positions, kept, 1),
            log_scales: pick(&self.log_scales, kept, 1),
            rotations: pick(&self.rotations, kept, 1),
            opacity_logits: pick(&self.opacity_logits, kept, 1),
            sh: pick(&self.sh, kept, self.sh_stride()),
            sh_degree: self.sh_degree,
        }
    }

    /// The splats without the spherical harmonics above a degree.
    pub fn with_sh_degree(&self, degree: u32) -> Splats {
        let sh_degree = degree.min(self.sh_degree);
        let own = 3 * (sh_degree as usize + 1).pow(2);
        let sh = self.sh.chunks_exact(self.sh_stride()).flat_map(|c| &c[..own]).copied().collect();
        Splats { sh, sh_degree, ..self.clone() }
    }

    /// Checks that the degree is known and that all arrays hold the same number of splats.
    pub fn check_shape(&self) -> Result<(), PriorError> {
        if self.sh_degree > Self::MAX_SH_DEGREE {
            return Err(PriorError::ShDegree { degree: self.sh_degree });
        }
        let expected = self.len();
        let lengths = [
            ("log_scales", self.log_scales.len(), expected),
            ("rotations", self.rotations.len(), expected),
            ("opacity_logits", self.opacity_logits.len(), expected),
            ("sh", self.sh.len(), expected * self.sh_stride()),
        ];
        match lengths.into_iter().find(|(_, found, expected)| found != expected) {
            Some((array, found, expected)) => Err(PriorError::Shape { array, found, expected }),
            None => Ok(()),
        }
    }
}

/// Entries of the splats that are kept, `stride` a splat.
fn pick<T: Copy>(array: &[T], kept: &[bool], stride: usize) -> Vec<T> {
    let entries = array.chunks_exact(stride).zip(kept);
    entries.filter(|(_, kept)| **kept).flat_map(|(entry, _)| entry).copied().collect()
}

/// Where a prior's splats came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorFormat {
    /// Handed over in memory.
    Memory,
    /// A PLY file in text.
    PlyAscii,
    /// A binary PLY file, little endian.
    PlyLittleEndian,
    /// A binary PLY file, big endian.
    PlyBigEndian,
    /// A compact prior.
    Compact,
    /// A PLY file packed by PlayCanvas's tools.
    #[cfg(feature = "formats")]
    PlyCompressed,
    /// A scene in Niantic's format, of this version.
    #[cfg(feature = "formats")]
    Spz(u32),
}

impl fmt::Display for PriorFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PriorFormat::Memory => "memory",
            PriorFormat::PlyAscii => "PLY, ascii",
            PriorFormat::PlyLittleEndian => "PLY, binary little endian",
            PriorFormat::PlyBigEndian => "PLY, binary big endian",
            PriorFormat::Compact => "compact prior",
            #[cfg(feature = "formats")]
            PriorFormat::PlyCompressed => "PLY, compressed",
            #[cfg(feature = "formats")]
            PriorFormat::Spz(version) => return write!(f, "SPZ, version {version}"),
        })
    }
}

/// What loading a prior found.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadReport {
    /// Container the splats came in.
    pub format: PriorFormat,
    /// Splats in the file.
    pub read: usize,
    /// Splats kept.
    pub kept: usize,
    /// Splats left out, by reason; empty if all were sound.
    pub dropped: Vec<Dropped>,
    /// Splats whose opacity logit was infinite, and became ±[`INFINITE_LOGIT`].
    pub clamped_logits: usize,
    /// Comments in the file's header, unchanged, without those that are key frames.
    pub comments: Vec<String>,
    /// Where the key frames came from.
    pub key_frames: PartSource,
    /// Where the coder tables came from.
    pub coder_tables: PartSource,
}

/// A checked, immutable prior: it has at least one splat, and the renderer can use every parameter.
#[derive(Clone, Debug)]
pub struct Prior {
    splats: Splats,
    options: RenderOptions,
    id: PriorId,
    frame: PriorFrame,
    key_frames: KeyFrames,
    coder_tables: Option<Arc<Tables>>,
    preprocessing: Preprocessing,
    report: LoadReport,
}

impl Prior {
    /// Most splats a prior may hold: what a 32-bit index reaches.
    pub const MAX_SPLATS: usize = u32::MAX as usize;

    /// Reads a prior from a file. The content tells the format. [`ply`] says where the render options come from;
    /// `overrides` replaces them. Key frames come from the file at [`KeyFrames::path_beside`] if there is one, else
    /// from the prior's own file. Coder tables come from [`coder_tables::path_beside`] in the same way.
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
        let (key_frames, tables) =
            (KeyFrames::open_beside(path)?, coder_tables::open_beside(path)?);
        let mut prior = Prior::from_bytes(&bytes, &path.display().to_string(), overrides)?;
        drop(bytes);
        if let Some(key_frames) = key_frames {
            prior.set_key_frames(key_frames, PartSource::Beside);
        }
        if let Some(tables) = tables {
            prior.set_coder_tables(Some(tables), PartSource::Beside);
        }
        Ok(prior)
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
        PriorFile::read(bytes).and_then(build).map_err(|error| error.in_file(name))
    }

    /// Makes a prior of splats in memory. Unsound splats are dropped and counted, as from a file.
    pub fn from_splats(splats: Splats, options: RenderOptions) -> Result<Prior, PriorError> {
        Prior::build(PriorFile {
            splats,
            options,
            format: PriorFormat::Memory,
            comments: Vec::new(),
            key_frames: KeyFrames::NONE,
            coder_tables: None,
            preprocessing: Preprocessing::NONE,
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
        let clamped_logits = check::clamp_logits(&mut splats);
        let dropped = check::drop_unsound(&mut splats);
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
        let id = PriorId::of(&splats, &options, coder_tables.as_ref());
        let frame = PriorFrame::of(&splats.positions);
        let coder_tables = coder_tables.map(Arc::new);
        Ok(Prior { splats, options, id, frame, key_frames, coder_tables, preprocessing, report })
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

    fn set_key_frames(&mut self, key_frames: KeyFrames, source: PartSource) {
        self.key_frames = key_frames;
        self.report.key_frames = source;
    }

    fn set_coder_tables(&mut self, tables: Option<Tables>, source: PartSource) {
        self.id = PriorId::of(&self.splats, &self.options, tables.as_ref());
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
    pub fn frame(&self) -> PriorFrame {
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

    /// How the pictures that it was trained on were treated. Encoders treat their frames in the same way.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// What loading found.
    pub fn report(&self) -> &LoadReport {
        &self.report
    }
}

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
}

impl PriorFile {
    /// Reads a file's content. The first bytes tell the format.
    fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
        if bytes.starts_with(compact::MAGIC) {
            return compact::read(bytes);
        }
        #[cfg(feature = "formats")]
        if spz::MAGICS.iter().any(|magic| bytes.starts_with(magic)) {
            return spz::read(bytes);
        }
        ply::read_ply(bytes)
    }

    /// Whether files of a known format start so.
    fn is_known(start: &[u8]) -> bool {
        let known = start.starts_with(ply::MAGIC) || start.starts_with(compact::MAGIC);
        #[cfg(feature = "formats")]
        let known = known || spz::MAGICS.iter().any(|magic| start.starts_with(magic));
        known
    }
}

/// Longest start of a file that tells its format, bytes.
const LONGEST_MAGIC: u64 = 4;

/// Reads the file. If its first bytes show another format, reads no further, so that a wrong path
/// (a device, a video) costs neither time nor memory.
fn read_prior_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    (&mut file).take(LONGEST_MAGIC).read_to_end(&mut bytes)?;
    if PriorFile::is_known(&bytes) {
        file.read_to_end(&mut bytes)?;
    }
    Ok(bytes)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// `count` sound splats of the degree, every parameter a different number.
    pub(crate) fn sample_splats(count: usize, sh_degree: u32) -> Splats {
        let mut next = 0.0;
        let mut value = || {
            next += 0.0625;
            next
        };
        let mut splats = Splats { sh_degree, ..Splats::default() };
        for _ in 0..count {
            splats.positions.push(std::array::from_fn(|_| value()));
            splats.log_scales.push(std::array::from_fn(|_| -value() / 100.0));
            splats.rotations.push(std::array::from_fn(|_| value()));
            splats.opacity_logits.push(value());
            let stride = splats.sh_stride();
            splats.sh.extend(std::iter::repeat_with(&mut value).take(stride));
        }
        splats
    }

    #[test]
    fn refuses_options_that_cannot_render() {
        let splats = sample_splats(1, 0);
        for options in [
            RenderOptions { near: 0.0, ..RenderOptions::INRIA },
            RenderOptions { near: f32::NAN, ..RenderOptions::INRIA },
            RenderOptions { alpha_max: 1.0, ..RenderOptions::INRIA },
            RenderOptions { background: [0.0, f32::NAN, 0.0], ..RenderOptions::INRIA },
        ] {
            let refused = Prior::from_splats(splats.clone(), options);
            assert!(matches!(refused, Err(PriorError::Option { .. })), "{options:?}");
        }
    }

    #[test]
    fn refuses_arrays_that_disagree() {
        let mut splats = sample_splats(3, 1);
        splats.sh.pop();
        let refused = Prior::from_splats(splats, RenderOptions::INRIA);
        assert!(matches!(refused, Err(PriorError::Shape { array: "sh", found: 35, expected: 36 })));
        let splats = Splats { sh_degree: 4, ..sample_splats(1, 0) };
        assert!(matches!(
            Prior::from_splats(splats, RenderOptions::INRIA),
            Err(PriorError::ShDegree { degree: 4 })
        ));
        assert!(matches!(
            Prior::from_splats(Splats::default(), RenderOptions::INRIA),
            Err(PriorError::Empty)
        ));
    }

    #[test]
    fn overrides_replace_only_what_they_name() {
        let overrides = RenderOverrides { near: Some(0.5), ..RenderOverrides::default() };
        let expected = RenderOptions { near: 0.5, ..RenderOptions::GSPLAT };
        assert_eq!(overrides.over(RenderOptions::GSPLAT), expected);
    }

    #[test]
    fn unit_rotation_has_unit_length_at_any_magnitude() {
        let mut splats = sample_splats(1, 0);
        for scale in [1e-5, 1.0, 1e30] {
            splats.rotations[0] = [0.0, 3.0 * scale, 0.0, -4.0 * scale];
            let unit = splats.unit_rotation(0);
            let error = unit.iter().zip([0.0, 0.6, 0.0, -0.8]).map(|(a, b)| (a - b).abs());
            assert!(error.fold(0.0, f32::max) < 1e-6, "{unit:?}");
        }
    }

    #[test]
    fn opening_what_is_no_prior_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("absent.ply");
        let error = Prior::open(&path, &RenderOverrides::default()).unwrap_err();
        let PriorError::InFile { error: inner, .. } = &error else { panic!("{error:?}") };
        assert!(matches!(**inner, PriorError::Read(_)));
        assert!(error.to_string().contains("absent.ply"));
        let path = folder.path().join("empty.ply");
        std::fs::write(&path, b"").unwrap();
        let error = Prior::open(&path, &RenderOverrides::default()).unwrap_err();
        assert!(error.to_string().contains("empty.ply"), "{error}");
    }
}
