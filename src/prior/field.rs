//! What is done with the fields of a format.

use super::warning::PriorWarning;

/// What a reader does with a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldUse {
    /// It is read.
    Read,
    /// It changes no picture and is passed over.
    Harmless,
    /// A file that has it is refused.
    Refused,
}

/// A field of a format, by its name, and what is done with it. A name that ends with `*` stands for all that begin so.
pub type Field = (&'static str, FieldUse);

/// Warnings of the names that are in no list. `kind`: what they are the names of.
pub fn passed_over<'a>(
    kind: &str,
    names: impl IntoIterator<Item = &'a str>,
    known: &[Field],
) -> Vec<PriorWarning> {
    let is = |name: &str, field: &str| match field.strip_suffix('*') {
        Some(start) => name.starts_with(start),
        None => name == field,
    };
    let unknown = names.into_iter().filter(|name| !known.iter().any(|(field, _)| is(name, field)));
    unknown.map(|name| PriorWarning::PassedOver(format!("{kind} \"{name}\""))).collect()
}
