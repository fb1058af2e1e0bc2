//! Numbers in a glTF file, of any component type.

use super::container::refusal;
use super::document::{Document, Primitive};
use nvsprior::prior::PriorError;

/// What accessors show.
pub struct Accessors<'a> {
    pub document: &'a Document,
    /// The file's own data.
    pub data: &'a [u8],
    /// Where the data begins in the file.
    pub start: usize,
}

/// An attribute's numbers: for each splat as many as the attribute has components.
pub struct Column<'a> {
    /// How many splats.
    pub count: usize,
    bytes: &'a [u8],
    stride: usize,
    component: Component,
    normalized: bool,
}

#[derive(Clone, Copy)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl Component {
    /// Of glTF's code.
    fn of(code: u32) -> Option<Component> {
        Some(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5126 => Component::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::F32 => 4,
        }
    }

    /// The number at the start of `bytes`. Normalised integers stand for -1 to 1, or for 0 to 1.
    fn read(self, bytes: &[u8], normalized: bool) -> f64 {
        let (value, most) = match self {
            Component::I8 => (f64::from(bytes[0] as i8), 127.0),
            Component::U8 => (f64::from(bytes[0]), 255.0),
            Component::I16 => (f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
            Component::U16 => (f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
            Component::F32 => {
                return f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
            }
        };
        if normalized { (value / most).max(-1.0) } else { value }
    }
}

impl<'a> Accessors<'a> {
    /// The attribute `name` of a primitive, with `width` components for each splat.
    pub fn column(
        &self,
        primitive: &Primitive,
        name: &str,
        width: usize,
    ) -> Result<Column<'a>, PriorError> {
        let index = primitive.attributes.get(name);
        let index = index.ok_or_else(|| refusal(format!("attribute {name} is missing")))?;
        let wrong =
            |reason: String| refusal(format!("attribute {name}, accessor {index}: {reason}"));
        let accessor = self.document.accessors.get(*index);
        let accessor = accessor.ok_or_else(|| wrong("there is none".into()))?;
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        if accessor.kind != kind {
            return Err(wrong(format!("{}, not {kind}", accessor.kind)));
        }
        let component = Component::of(accessor.component_type);
        let component = component
            .ok_or_else(|| wrong(format!("component type {}", accessor.component_type)))?;
        if accessor.sparse.is_some() {
            return Err(wrong("sparse accessors are not read here".into()));
        }
        let view = accessor.buffer_view.ok_or_else(|| wrong("it has no bufferView".into()))?;
        let view = self.document.buffer_views.get(view);
        let view = view.ok_or_else(|| wrong("its bufferView is not there".into()))?;
        let own = view.buffer == 0
            && self.document.buffers.first().is_some_and(|buffer| buffer.uri.is_none());
        if !own {
            return Err(wrong("its data is not in the file itself".into()));
        }
        let element = width * component.bytes();
        let stride = view.byte_stride.unwrap_or(element);
        if stride < element {
            return Err(wrong(format!("a stride of {stride} bytes for {element}")));
        }
        let bytes = self.slice(view.byte_offset, view.byte_length, accessor.byte_offset)?;
        let needed = match accessor.count {
            0 => 0,
            count => (count as u128 - 1) * stride as u128 + element as u128,
        };
        if needed > bytes.len() as u128 {
            return Err(wrong(format!("{} bytes, {needed} are due", bytes.len())));
        }
        let (count, normalized) = (accessor.count, accessor.normalized);
        Ok(Column { count, bytes, stride, component, normalized })
    }

    /// `length` bytes of the data from byte `at`, without the first `skipped`.
    fn slice(&self, at: usize, length: usize, skipped: usize) -> Result<&'a [u8], PriorError> {
        let end = at as u128 + length as u128;
        let found = || self.data.get(at..end.try_into().ok()?)?.get(skipped..);
        let file = self.start + self.data.len();
        let needed = self.start as u128 + end.max(at as u128 + skipped as u128);
        found().ok_or(PriorError::Truncated { needed, found: file })
    }
}

impl Column<'_> {
    /// The numbers of splat `index`.
    pub fn get<const N: usize>(&self, index: usize) -> [f64; N] {
        let splat = &self.bytes[index * self.stride..];
        let size = self.component.bytes();
        std::array::from_fn(|i| self.component.read(&splat[i * size..], self.normalized))
    }
}
