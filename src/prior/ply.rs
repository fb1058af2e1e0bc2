//! PLY files as Inria's trainer and nerfstudio write them.
//!
//! Element `vertex`, one row per splat: `x y z`, `f_dc_0..2` and `f_rest_*` (spherical harmonics), `opacity` (logit),
//! `scale_0..2` (logarithms), `rot_0..3` (w, x, y, z). Text or binary of either byte order, any order of properties,
//! any scalar type. In place of `f_dc_0..2` there may be `red green blue`, without `scale_2` splats are flat, and
//! `filter_3D` of Mip-Splatting is merged into scales and opacity. Other properties and elements are left out, with a
//! warning if [`FIELDS`] does not name them. The number of `f_rest_*` gives the degree: 0, 9, 24 or 45 of them for
//! degree 0 to 3. They run channel by channel in the file (all of red first), coefficient by coefficient in
//! [`Splats::sh`].
//!
//! **Render options** come from the header's comments, since the format has no place for them:
//!
//! 1. a comment that contains "nerfstudio" (any case) means [`RenderOptions::GSPLAT`], none means
//!    [`RenderOptions::INRIA`];
//!    If no comment states the near plane otherwise, it is smaller for a small scene;
//! 2. a comment `SplatRenderMode: mip` or `antialiased 1` means anti-aliased;
//! 3. comments `nvsprior near 0.2`, `nvsprior alpha_max 0.99`, `nvsprior antialiased 0` (or 1) and
//!    `nvsprior background 0 0 0`, as [`write_ply`] leaves them, replace single options;
//! 4. `nvsprior origin X Y Z` says what positions and key frames count from: [`Splats::origin`].
//!
//! **Key frames** are comments too, one key frame per comment: `nvsprior key_frame qw qx qy qz tx
//! ty tz`, a world-to-camera pose. **Preprocessing** as well: `nvsprior white_balance gray_world`, and
//! `nvsprior clahe 2 8`, clip limit and tiles along a side. Any other comment that starts with
//! `nvsprior` is refused.

use std::borrow::Cow;
use std::io::{BufRead, Cursor, Read, Write};

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{PlyFormat, PlyReader};

use super::key_frames::words;
use super::ply_header::{
    CLAHE, COMMENT_PREFIX, Comments, GRAY_WORLD, KEY_FRAME, ORIGIN, WHITE_BALANCE, check_length,
    clean, header_of, read_header, rest_properties,
};
use super::ply_layout::{Layout, REST};
use super::ply_row::PlyRow;
use super::{KeyFrames, PriorError, PriorFile, PriorFormat, RenderOptions, Splats};
use crate::Pose;
use crate::image::{Preprocessing, WhiteBalance};

pub use super::ply_layout::FIELDS;

/// How a PLY file starts.
pub const MAGIC: &[u8] = b"ply";

/// How one starts that an editor has marked as UTF-8.
pub const MARKED_MAGIC: &[u8] = b"\xef\xbb\xbfp";

/// Reads the content of a PLY file. Memory depends on the content's size, whatever the header says.
pub fn read_ply(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    let bytes = &clean(bytes)[..];
    if !bytes.starts_with(MAGIC) {
        return Err(PriorError::UnknownFormat);
    }
    let (header, body) = read_header(bytes)?;
    let mut layout = Layout::of(&header)?;
    check_length(&header, layout.element, body, bytes.len())?;
    let comments = Comments::of(header.comments)?;
    let (splats, exact) = read_splats(bytes, header.format, &layout)?;
    let format = match header.format {
        PlyFormat::Ascii => PriorFormat::PlyAscii,
        PlyFormat::BinaryLittleEndian => PriorFormat::PlyLittleEndian,
        PlyFormat::BinaryBigEndian => PriorFormat::PlyBigEndian,
    };
    let warnings = std::mem::take(&mut layout.warnings);
    let exact_positions = layout.is_double.then_some(exact);
    Ok(PriorFile { warnings, exact_positions, ..comments.file(splats, format) })
}

/// The splats, and their positions as they stand there if they are doubles.
fn read_splats(
    bytes: &[u8],
    format: PlyFormat,
    layout: &Layout,
) -> Result<(Splats, Vec<[f64; 3]>), PriorError> {
    let bytes = &match format {
        PlyFormat::Ascii => common_numbers(bytes),
        _ => Cow::Borrowed(bytes),
    }[..];
    let mut cursor = Cursor::new(bytes);
    // The reader needs white space after every number of a text, also after the last one.
    let tail: &[u8] = if format == PlyFormat::Ascii { b"\n" } else { b"" };
    let splats = Splats::with_capacity(layout.count, layout.sh_degree);
    let mut sink = SplatSink { splats, exact: Vec::new(), layout };
    let mut reader = PlyReader::from_reader((&mut cursor).chain(tail))
        .map_err(|e| PriorError::Header { reason: e.0.to_string() })?;
    let read = read_elements(&mut reader, layout, &mut sink);
    drop(reader);
    read.map_err(|e| PriorError::Row {
        splat: sink.splats.len(),
        offset: cursor.position(),
        reason: e.0.to_string(),
    })?;
    Ok((sink.splats, sink.exact))
}

/// A text whose numbers are written as every reader knows them: Microsoft's compilers print `-nan(ind)` and `1.#QNAN`.
/// Splats of such numbers are dropped by the usual rule. The length stays, for the offsets in errors.
fn common_numbers(text: &[u8]) -> Cow<'_, [u8]> {
    const STRANGE: [(&[u8], &[u8]); 4] =
        [(b"nan(", b"nan"), (b"-1.#inf", b"-inf"), (b"1.#inf", b"inf"), (b".#", b"nan")];
    let is = |word: &[u8], part: &[u8]| {
        word.windows(part.len()).any(|window| window.eq_ignore_ascii_case(part))
    };
    if !STRANGE.iter().any(|(part, _)| is(text, part)) {
        return Cow::Borrowed(text);
    }
    let body = header_of(text).len();
    let mut common = text.to_vec();
    for word in common[body..].split_mut(u8::is_ascii_whitespace) {
        if let Some((_, number)) = STRANGE.iter().find(|(part, _)| is(word, part)) {
            let (front, rest) = word.split_at_mut(number.len().min(word.len()));
            front.copy_from_slice(&number[..front.len()]);
            rest.fill(b' ');
        }
    }
    Cow::Owned(common)
}

/// Passes over the elements before the splats, then reads those into `sink`.
fn read_elements<R: BufRead>(
    mut reader: &mut PlyReader<R>,
    layout: &Layout,
    sink: &mut SplatSink,
) -> Result<(), serde_ply::DeserializeError> {
    for _ in 0..layout.element {
        let has_rows = reader.current_element().is_some_and(|e| !e.properties.is_empty());
        reader.next_value_seed(SkipRows { has_rows })?;
    }
    reader.next_value_seed(sink)
}

/// Passes over the rows of one element.
struct SkipRows {
    /// False if the rows have no properties: they take no bytes, so the content does not bound their number.
    has_rows: bool,
}

impl<'de> DeserializeSeed<'de> for SkipRows {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        if self.has_rows { deserializer.deserialize_seq(self) } else { Ok(()) }
    }
}

impl<'de> Visitor<'de> for SkipRows {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("rows")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        while rows.next_element_seed(SkipRow)?.is_some() {}
        Ok(())
    }
}

/// Passes over one row.
struct SkipRow;

impl<'de> DeserializeSeed<'de> for SkipRow {
    type Value = IgnoredAny;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<IgnoredAny, D::Error> {
        deserializer.deserialize_map(IgnoredAny)
    }
}

/// Collects splats row by row.
struct SplatSink<'a> {
    splats: Splats,
    /// Positions, if they are doubles.
    exact: Vec<[f64; 3]>,
    layout: &'a Layout,
}

impl<'de> DeserializeSeed<'de> for &mut SplatSink<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for &mut SplatSink<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("splats")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        // A value that does not fit an f32 becomes infinite, and the check that follows drops its splat.
        while let Some(values) = rows.next_element_seed(PlyRow::new(self.layout.properties()))? {
            self.layout.push(&mut self.splats, &values);
            if self.layout.is_double {
                self.exact.push([values[0], values[1], values[2]]);
            }
        }
        Ok(())
    }
}

/// Writes splats as a binary PLY file with Inria's list of properties (normals zero), and options, preprocessing and
/// key frames as comments. [`read_ply`] gives all of them back unchanged.
pub fn write_ply(
    splats: &Splats,
    options: &RenderOptions,
    key_frames: &KeyFrames,
    preprocessing: &Preprocessing,
    mut writer: impl Write,
) -> Result<(), PriorError> {
    splats.check_shape()?;
    let mut bytes = header_text(splats, options, key_frames, preprocessing).into_bytes();
    let stride = splats.sh_stride();
    for (i, position) in splats.positions.iter().enumerate() {
        let sh = &splats.sh[i * stride..(i + 1) * stride];
        let rest = (0..3).flat_map(|channel| sh[3..].iter().skip(channel).step_by(3));
        let row = position
            .iter()
            .chain(&[0.0; 3])
            .chain(&sh[..3])
            .chain(rest)
            .chain([&splats.opacity_logits[i]])
            .chain(&splats.log_scales[i])
            .chain(&splats.rotations[i]);
        bytes.extend(row.flat_map(|v| v.to_le_bytes()));
        writer.write_all(&bytes).map_err(PriorError::Write)?;
        bytes.clear();
    }
    // The header alone, if there are no splats.
    writer.write_all(&bytes).and_then(|()| writer.flush()).map_err(PriorError::Write)
}

/// The words of the comments that state a preprocessing; none if there is none.
fn preprocessing_comments(preprocessing: &Preprocessing) -> impl Iterator<Item = String> {
    let balance = match preprocessing.white_balance {
        WhiteBalance::None => None,
        WhiteBalance::GrayWorld => Some(format!("{WHITE_BALANCE} {GRAY_WORLD}")),
    };
    let clahe = preprocessing
        .clahe
        .map(|clahe| format!("{CLAHE} {} {}", clahe.clip_limit(), clahe.tiles()));
    balance.into_iter().chain(clahe)
}

fn header_text(
    splats: &Splats,
    options: &RenderOptions,
    key_frames: &KeyFrames,
    preprocessing: &Preprocessing,
) -> String {
    let [x, y, z] = splats.origin;
    let RenderOptions { near, alpha_max, antialiased, background: [r, g, b], trained_focal } =
        options;
    let options = [
        format!("near {near}"),
        format!("alpha_max {alpha_max}"),
        format!("antialiased {}", u8::from(*antialiased)),
        format!("background {r} {g} {b}"),
    ];
    let key_frame = |pose: &Pose| format!("{KEY_FRAME} {}", words(pose).join(" "));
    let key_frames = key_frames.poses().iter().map(key_frame);
    let comments: String = options
        .into_iter()
        .chain(trained_focal.map(|focal| format!("trained_focal {focal}")))
        .chain([format!("{ORIGIN} {x} {y} {z}")])
        .chain(preprocessing_comments(preprocessing))
        .chain(key_frames)
        .map(|c| format!("comment {COMMENT_PREFIX} {c}\n"))
        .collect();
    let rest = &REST[..rest_properties(splats.sh_degree)];
    let properties: String = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
        .iter()
        .chain(rest)
        .chain(&["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"])
        .map(|name| format!("property float {name}\n"))
        .collect();
    format!(
        "ply\nformat binary_little_endian 1.0\n{comments}element vertex {}\n\
         {properties}end_header\n",
        splats.len()
    )
}

#[cfg(test)]
mod tests;
