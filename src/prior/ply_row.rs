//! A row of an element of a PLY file: the values of chosen scalar properties.

use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

/// Reads a row as the values of these properties, in this order; `T::default()` up to `N` values. Other properties are
/// passed over.
#[derive(Clone, Copy, Debug)]
pub struct PlyRow<T, const N: usize> {
    properties: &'static [&'static str],
    values: PhantomData<[T; N]>,
}

impl<T, const N: usize> PlyRow<T, N> {
    /// At most `N` properties.
    pub fn new(properties: &'static [&'static str]) -> PlyRow<T, N> {
        debug_assert!(properties.len() <= N);
        PlyRow { properties, values: PhantomData }
    }
}

impl<'de, T: Deserialize<'de> + Default + Copy, const N: usize> DeserializeSeed<'de>
    for PlyRow<T, N>
{
    type Value = [T; N];

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<[T; N], D::Error> {
        deserializer.deserialize_struct("row", self.properties, self)
    }
}

impl<'de, T: Deserialize<'de> + Default + Copy, const N: usize> Visitor<'de> for PlyRow<T, N> {
    type Value = [T; N];

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "the properties {}", self.properties.join(", "))
    }

    /// Binary rows of scalars: the library sorts the values.
    fn visit_seq<A: SeqAccess<'de>>(self, mut row: A) -> Result<[T; N], A::Error> {
        let mut values = [T::default(); N];
        let count = self.properties.len();
        for (index, value) in values.iter_mut().enumerate().take(count) {
            let found = row.next_element()?;
            *value = found.ok_or_else(|| A::Error::invalid_length(index, &self))?;
        }
        Ok(values)
    }

    /// Rows of text or with lists: values come in the file's order.
    fn visit_map<A: MapAccess<'de>>(self, mut row: A) -> Result<[T; N], A::Error> {
        let mut values = [T::default(); N];
        while let Some(index) = row.next_key_seed(PropertyIndex(self.properties))? {
            match index {
                Some(index) => values[index] = row.next_value()?,
                None => drop(row.next_value::<IgnoredAny>()?),
            }
        }
        Ok(values)
    }
}

/// Which of these properties a name is.
struct PropertyIndex(&'static [&'static str]);

impl<'de> DeserializeSeed<'de> for PropertyIndex {
    type Value = Option<usize>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl Visitor<'_> for PropertyIndex {
    type Value = Option<usize>;

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("the name of a property")
    }

    fn visit_bytes<E>(self, name: &[u8]) -> Result<Self::Value, E> {
        Ok(self.0.iter().position(|property| property.as_bytes() == name))
    }
}
