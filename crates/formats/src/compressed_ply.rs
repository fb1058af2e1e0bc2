//! PLY files as PlayCanvas's tools pack them, `.compressed.ply`.
//!
//! Splats in chunks of 256. Element `chunk` has their bounds: `min_x`…, `max_x`…, `min_scale_x`…, `max_scale_x`…, in
//! newer files also `min_r`… and `max_r`…. Element `vertex` has four words per splat: `packed_position` and
//! `packed_scale` (11, 10 and 11 bits between the bounds), `packed_rotation` (two bits for the largest of w, x, y, z,
//! ten for each of the others) and `packed_color` (four bytes: colour between the bounds or 0 and 1, and opacity).
//! Element `sh`, if there is one, has one byte per `f_rest_*`. The file is always binary, little endian, without lists.
//!
//! Comments mean what they mean in other PLY files, see [`nvsprior::prior::ply`].

use serde_ply::{ElementDef, PlyFormat, PlyHeader, PropertyType, ScalarType};

use nvsprior::Prior;
use nvsprior::parts::{Comments, check_length, clean, read_header, rest_properties};
use nvsprior::prior::{PriorError, PriorFile, PriorFormat, Splats, ply};

const CHUNK: usize = 256;

/// The constant spherical harmonic.
const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Width of the range of the other coefficients, around zero.
const SH_RANGE: f64 = 8.0;

const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// Bounds of a chunk, in the order of [`Bounds`].
#[rustfmt::skip]
const BOUNDS: [&str; 18] = [
    "min_x", "min_y", "min_z", "max_x", "max_y", "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r", "min_g", "min_b", "max_r", "max_g", "max_b",
];

const FORMAT: PriorFormat = PriorFormat::Foreign("PLY, compressed", None);

/// Reads a file; `None` if it is none of these, or its header is none that can be read.
pub fn read(bytes: &[u8]) -> Option<Result<PriorFile, PriorError>> {
    let starts = [ply::MAGIC, ply::MARKED_MAGIC].iter().any(|magic| bytes.starts_with(magic));
    let bytes = &starts.then(|| clean(bytes))?[..];
    let (header, body) = read_header(bytes).ok()?;
    is_packed(&header).then(|| read_packed(bytes, header, body))
}

/// Whether a header is that of a packed file.
fn is_packed(header: &PlyHeader) -> bool {
    let vertex = header.elem_defs.iter().find(|e| e.name == "vertex");
    vertex.is_some_and(|v| PACKED.iter().all(|name| v.properties.iter().any(|p| p.name == *name)))
}

/// Reads a packed file, whose header takes `body` bytes.
fn read_packed(bytes: &[u8], header: PlyHeader, body: usize) -> Result<PriorFile, PriorError> {
    if header.format != PlyFormat::BinaryLittleEndian {
        return Err(PriorError::Header { reason: "packed, but not binary little endian".into() });
    }
    let last = header.elem_defs.len() - 1;
    check_length(&header, last, body, bytes.len())?;
    let (chunks, _) = Table::of(&header, "chunk", body)?.ok_or_else(|| missing("chunk"))?;
    let (vertices, vertex) = Table::of(&header, "vertex", body)?.ok_or(PriorError::NoVertices)?;
    if vertices.count == 0 {
        return Err(PriorError::Empty);
    }
    if vertices.count > Prior::MAX_SPLATS {
        return Err(PriorError::TooMany { count: vertices.count });
    }
    if chunks.count < vertices.count.div_ceil(CHUNK) {
        let reason = format!("{} chunks for {} splats", chunks.count, vertices.count);
        return Err(PriorError::Header { reason });
    }
    let packed = [0, 1, 2, 3].map(|i| column(vertex, PACKED[i], ScalarType::U32));
    let [position, rotation, scale, colour] = packed;
    let at = [position?, rotation?, scale?, colour?];
    let sh = Harmonics::of(&header, body, vertices.count)?;
    let bounds = Chunks::of(&header, chunks)?;
    let mut splats = Splats::with_capacity(vertices.count, sh.degree);
    for index in 0..vertices.count {
        let bounds = bounds.read(bytes, index / CHUNK);
        push(&mut splats, &bounds, at.map(|at| vertices.word(bytes, index, at)));
        sh.push(&mut splats, bytes, index);
    }
    let comments = Comments::of(header.comments)?;
    Ok(comments.file(splats, FORMAT))
}

/// Appends a splat, up to the constant coefficients.
fn push(splats: &mut Splats, bounds: &Bounds, [position, rotation, scale, colour]: [u32; 4]) {
    let [min, max, min_scale, max_scale, min_colour, max_colour] = bounds;
    splats.positions.push(between(thirds(position), min, max));
    splats.log_scales.push(between(thirds(scale), min_scale, max_scale));
    splats.rotations.push(quaternion(rotation));
    let [r, g, b, opacity] = colour.to_be_bytes().map(|v| f64::from(v) / 255.0);
    splats.opacity_logits.push(crate::spz::logit(opacity));
    let rgb = between([r, g, b], min_colour, max_colour);
    splats.sh.extend(rgb.map(|v| ((f64::from(v) - 0.5) / SH_C0) as f32));
}

/// Three numbers from 0 to 1, of 11, 10 and 11 bits.
fn thirds(word: u32) -> [f64; 3] {
    let part = |shift: u32, max: u32| f64::from(word >> shift & max) / f64::from(max);
    [part(21, 2047), part(11, 1023), part(0, 2047)]
}

fn between(share: [f64; 3], min: &[f32; 3], max: &[f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| {
        let (min, max) = (f64::from(min[axis]), f64::from(max[axis]));
        (min * (1.0 - share[axis]) + max * share[axis]) as f32
    })
}

/// A quaternion (w, x, y, z). The components other than the largest lie within ±1/√2.
fn quaternion(word: u32) -> [f32; 4] {
    let mut q = [0.0; 4];
    let largest = (word >> 30) as usize;
    let others = (0..4).filter(|place| *place != largest);
    for (place, shift) in others.zip([20, 10, 0]) {
        let share = f64::from(word >> shift & 1023) / 1023.0;
        q[place] = (share - 0.5) * std::f64::consts::SQRT_2;
    }
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    q.map(|v| v as f32)
}

/// The rows of an element.
#[derive(Clone, Copy)]
struct Table {
    /// Byte of the first row.
    start: usize,
    row: usize,
    count: usize,
}

impl Table {
    /// The place of an element's rows, and its properties; `None` if there is no such element.
    fn of<'a>(
        header: &'a PlyHeader,
        name: &str,
        body: usize,
    ) -> Result<Option<(Table, &'a ElementDef)>, PriorError> {
        let mut start = body;
        for element in &header.elem_defs {
            let row = row_bytes(element)?;
            if element.name == name {
                return Ok(Some((Table { start, row, count: element.count }, element)));
            }
            start += row * element.count;
        }
        Ok(None)
    }

    /// Bytes of a row, which the content has been found to hold.
    fn bytes<'a>(&self, bytes: &'a [u8], index: usize) -> &'a [u8] {
        &bytes[self.start + index * self.row..][..self.row]
    }

    fn word(&self, bytes: &[u8], index: usize, at: usize) -> u32 {
        let row = self.bytes(bytes, index);
        u32::from_le_bytes(std::array::from_fn(|i| row[at + i]))
    }
}

fn row_bytes(element: &ElementDef) -> Result<usize, PriorError> {
    let sizes = element.properties.iter().map(|p| match &p.property_type {
        PropertyType::Scalar(scalar) => Ok(scalar_bytes(scalar)),
        PropertyType::List { .. } => Err(PriorError::BadProperty { property: p.name.clone() }),
    });
    sizes.sum()
}

fn scalar_bytes(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::F64 => 8,
    }
}

/// Where a property of this type stands in a row.
fn column(element: &ElementDef, name: &str, scalar: ScalarType) -> Result<usize, PriorError> {
    let mut at = 0;
    for property in &element.properties {
        let PropertyType::Scalar(found) = &property.property_type else { continue };
        if property.name == name && *found == scalar {
            return Ok(at);
        }
        at += scalar_bytes(found);
    }
    Err(missing(name))
}

fn missing(name: &str) -> PriorError {
    PriorError::MissingProperty { property: name.to_owned() }
}

/// Least and greatest position, logarithmic scale and colour of a chunk.
type Bounds = [[f32; 3]; 6];

/// Where the bounds of chunks stand.
struct Chunks {
    table: Table,
    /// Columns of [`BOUNDS`]; older files have none of colours.
    columns: [Option<usize>; 18],
}

impl Chunks {
    fn of(header: &PlyHeader, table: Table) -> Result<Chunks, PriorError> {
        let chunk = header.elem_defs.iter().find(|e| e.name == "chunk");
        let chunk = chunk.ok_or_else(|| missing("chunk"))?;
        let coloured = chunk.properties.iter().any(|p| p.name == BOUNDS[12]);
        let mut columns = [None; 18];
        for (at, name) in columns.iter_mut().zip(BOUNDS).take(if coloured { 18 } else { 12 }) {
            *at = Some(column(chunk, name, ScalarType::F32)?);
        }
        Ok(Chunks { table, columns })
    }

    fn read(&self, bytes: &[u8], index: usize) -> Bounds {
        let value = |bound: usize| match self.columns[bound] {
            Some(at) => f32::from_bits(self.table.word(bytes, index, at)),
            // Without bounds, colours run from 0 to 1.
            None => f32::from(u8::from(bound >= 15)),
        };
        std::array::from_fn(|triple| std::array::from_fn(|axis| value(3 * triple + axis)))
    }
}

/// The coefficients besides the constant ones.
struct Harmonics {
    table: Option<Table>,
    degree: u32,
}

impl Harmonics {
    fn of(header: &PlyHeader, body: usize, splats: usize) -> Result<Harmonics, PriorError> {
        let Some((table, element)) = Table::of(header, "sh", body)? else {
            return Ok(Harmonics { table: None, degree: 0 });
        };
        let found = element.properties.len();
        let degree = (1..=Splats::MAX_SH_DEGREE).find(|degree| rest_properties(*degree) == found);
        let degree = degree.ok_or(PriorError::ShProperties { found })?;
        if table.count != splats {
            let reason = format!("{} rows of spherical harmonics, {splats} splats", table.count);
            return Err(PriorError::Header { reason });
        }
        for (index, property) in element.properties.iter().enumerate() {
            let name = format!("f_rest_{index}");
            let byte = matches!(property.property_type, PropertyType::Scalar(ScalarType::U8));
            if property.name != name || !byte {
                return Err(missing(&name));
            }
        }
        Ok(Harmonics { table: Some(table), degree })
    }

    /// Appends a splat's coefficients: channel by channel in the file, coefficient by coefficient here.
    fn push(&self, splats: &mut Splats, bytes: &[u8], index: usize) {
        let Some(table) = self.table else { return };
        let row = table.bytes(bytes, index);
        let value = |byte: u8| {
            let share = match byte {
                0 => 0.0,
                255 => 1.0,
                _ => (f64::from(byte) + 0.5) / 256.0,
            };
            ((share - 0.5) * SH_RANGE) as f32
        };
        let channel = row.len() / 3;
        for coefficient in 0..channel {
            splats.sh.extend([0, 1, 2].map(|c| value(row[c * channel + coefficient])));
        }
    }
}

#[cfg(test)]
mod tests;
