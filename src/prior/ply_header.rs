//! What PLY files of splats have in common: header, lengths, comments with render options, preprocessing and key
//! frames.

use std::borrow::Cow;
use std::io::Cursor;
use std::str::FromStr;

use serde_ply::{ElementDef, PlyFormat, PlyHeader, PlyReader, PropertyType, ScalarType};

use super::key_frames::pose_from_words;
use super::{Extras, KeyFrames, PriorError, PriorFile, PriorFormat, RenderOptions, Splats};
use crate::image::{Clahe, Preprocessing, WhiteBalance};

/// First word of the comments that hold render options, preprocessing and key frames.
pub const COMMENT_PREFIX: &str = "nvsprior";

/// Second word of those that hold key frames.
pub const KEY_FRAME: &str = "key_frame";

/// Second word of the one that holds what positions count from.
pub const ORIGIN: &str = "origin";

/// Second words of those that hold the preprocessing, and the one white balance.
pub const WHITE_BALANCE: &str = "white_balance";
pub const GRAY_WORLD: &str = "gray_world";
pub const CLAHE: &str = "clahe";

/// A byte order mark, with which some editors begin a text.
const MARK: &[u8] = b"\xef\xbb\xbf";

/// The word that ends the header.
const END: &[u8] = b"end_header";

/// The file without a byte order mark; bytes of the header that are no UTF-8, as of comments in Latin-1, become `?`.
pub fn clean(bytes: &[u8]) -> Cow<'_, [u8]> {
    let bytes = bytes.strip_prefix(MARK).unwrap_or(bytes);
    let end = header_of(bytes).len();
    if std::str::from_utf8(&bytes[..end]).is_ok() {
        return Cow::Borrowed(bytes);
    }
    let mut cleaned = bytes.to_vec();
    cleaned[..end].iter_mut().filter(|byte| !byte.is_ascii()).for_each(|byte| *byte = b'?');
    Cow::Owned(cleaned)
}

/// The header of a PLY file, or all of it if no header ends.
pub fn header_of(bytes: &[u8]) -> &[u8] {
    let end = bytes.windows(END.len()).position(|window| window == END);
    &bytes[..end.map_or(bytes.len(), |at| at + END.len())]
}

/// The header, and how many bytes it takes.
pub fn read_header(bytes: &[u8]) -> Result<(PlyHeader, usize), PriorError> {
    let mut cursor = Cursor::new(bytes);
    let header = PlyReader::from_reader(&mut cursor)
        .map_err(|e| PriorError::Header { reason: e.0.to_string() })?
        .header()
        .clone();
    Ok((header, cursor.position() as usize))
}

/// Number of `f_rest_*` properties of a degree: `3 ((degree + 1)² − 1)`.
pub const fn rest_properties(degree: u32) -> usize {
    3 * ((degree as usize + 1).pow(2) - 1)
}

/// Checks that the content can hold what the header promises up to the last splat. So a wrong
/// header causes no allocation and no loop.
pub fn check_length(
    header: &PlyHeader,
    last_element: usize,
    body: usize,
    found: usize,
) -> Result<(), PriorError> {
    let elements = &header.elem_defs[..=last_element];
    let rows: u128 =
        elements.iter().map(|e| e.count as u128 * min_row_bytes(e, header.format)).sum();
    // The last number of a text needs no white space after it.
    let end = u128::from(header.format == PlyFormat::Ascii);
    let needed = (body as u128 + rows).saturating_sub(end);
    if needed > found as u128 {
        return Err(PriorError::Truncated { needed, found });
    }
    Ok(())
}

/// Fewest bytes that one row can take: exact for binary rows without lists.
fn min_row_bytes(element: &ElementDef, format: PlyFormat) -> u128 {
    let bytes = |property_type: &PropertyType| {
        let scalar = match property_type {
            _ if format == PlyFormat::Ascii => return 2,
            PropertyType::Scalar(scalar) => scalar,
            PropertyType::List { count_type, .. } => count_type,
        };
        match scalar {
            ScalarType::I8 | ScalarType::U8 => 1,
            ScalarType::I16 | ScalarType::U16 => 2,
            ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
            ScalarType::F64 => 8,
        }
    };
    element.properties.iter().map(|p| bytes(&p.property_type)).sum()
}

/// What a header's comments say.
pub struct Comments {
    pub options: RenderOptions,
    /// None states the near plane.
    pub near_by_size: bool,
    /// What the positions of splats and key frames count from, if that is stated.
    pub origin: Option<[f64; 3]>,
    pub preprocessing: Preprocessing,
    pub key_frames: KeyFrames,
    /// Those that are no key frames.
    pub others: Vec<String>,
}

impl Comments {
    pub fn of(comments: Vec<String>) -> Result<Comments, PriorError> {
        let gsplat = comments.iter().any(|c| c.to_ascii_lowercase().contains("nerfstudio"));
        let mut options = if gsplat { RenderOptions::GSPLAT } else { RenderOptions::INRIA };
        options.antialiased = comments.iter().any(|comment| states_mip(comment));
        let mut near_by_size = !gsplat;
        let mut preprocessing = Preprocessing::NONE;
        let mut origin = None;
        let (mut poses, mut others) = (Vec::new(), Vec::new());
        for comment in comments {
            let words: Vec<&str> = comment.split_whitespace().collect();
            if let ["nvsprior", "near", _] = words.as_slice() {
                near_by_size = false;
            }
            let understood = match words.as_slice() {
                [COMMENT_PREFIX, KEY_FRAME, rest @ ..] => match pose_from_words(rest) {
                    Ok(pose) => {
                        poses.push(pose);
                        continue;
                    }
                    Err(_) => None,
                },
                [COMMENT_PREFIX, ORIGIN, x, y, z] => {
                    place(x, y, z).map(|found| origin = Some(found))
                }
                [COMMENT_PREFIX, rest @ ..] => set_option(&mut options, rest)
                    .or_else(|| set_preprocessing(&mut preprocessing, rest)),
                _ => Some(()),
            };
            match understood {
                Some(()) => others.push(comment),
                None => return Err(PriorError::Comment { comment }),
            }
        }
        let key_frames = KeyFrames::new(poses)?;
        Ok(Comments { options, near_by_size, origin, preprocessing, key_frames, others })
    }

    /// The file of these comments and splats.
    pub fn file(self, splats: Splats, format: PriorFormat) -> PriorFile {
        let Comments { options, near_by_size, origin, .. } = self;
        let Comments { preprocessing, key_frames, others: comments, .. } = self;
        let splats = Splats { origin: origin.unwrap_or_default(), ..splats };
        let extras = Extras { key_frames, preprocessing, ..Extras::default() };
        PriorFile {
            comments,
            extras,
            near_by_size,
            states_origin: origin.is_some(),
            ..PriorFile::new(splats, options, format)
        }
    }
}

/// Whether a comment of another program says that the scene was trained anti-aliased: `SplatRenderMode: mip` of Brush,
/// gsplat, nerfstudio and splat-transform, `antialiased 1` of Postshot.
fn states_mip(comment: &str) -> bool {
    let comment = comment.to_ascii_lowercase();
    let mut words = comment.split([' ', '\t', ':', '=']).filter(|word| !word.is_empty());
    match (words.next(), words.next(), words.next()) {
        (Some("splatrendermode"), Some(mode), None) => matches!(mode, "mip" | "antialiased"),
        (Some("antialiased"), Some(value), None) => matches!(value, "1" | "true"),
        _ => false,
    }
}

/// A point by its finite coordinates.
fn place(x: &str, y: &str, z: &str) -> Option<[f64; 3]> {
    let point = [x.parse().ok()?, y.parse().ok()?, z.parse().ok()?];
    point.iter().all(|v: &f64| v.is_finite()).then_some(point)
}

/// Sets the option that the words name; `None` if they name no option.
fn set_option(options: &mut RenderOptions, words: &[&str]) -> Option<()> {
    let number = |word: &str| f32::from_str(word).ok();
    match words {
        ["near", value] => options.near = number(value)?,
        ["alpha_max", value] => options.alpha_max = number(value)?,
        ["antialiased", "0"] => options.antialiased = false,
        ["antialiased", "1"] => options.antialiased = true,
        ["trained_focal", value] => options.trained_focal = Some(number(value)?),
        ["background", r, g, b] => options.background = [number(r)?, number(g)?, number(b)?],
        _ => return None,
    }
    Some(())
}

/// Sets the part of the preprocessing that the words state; `None` if they state none.
fn set_preprocessing(preprocessing: &mut Preprocessing, words: &[&str]) -> Option<()> {
    match words {
        [WHITE_BALANCE, GRAY_WORLD] => preprocessing.white_balance = WhiteBalance::GrayWorld,
        [CLAHE, clip_limit, tiles] => {
            let clahe = Clahe::new(clip_limit.parse().ok()?, tiles.parse().ok()?);
            preprocessing.clahe = Some(clahe.ok()?);
        }
        _ => return None,
    }
    Some(())
}
