//! Files of our own formats with other parts in them. Splats stay byte for byte, and parts that are not known here.

use super::container::{Container, Format, Head, PartName};
use super::error::PriorError;
use super::extras::Extras;
use super::file;
use super::identity::identity_of;
use crate::coder_tables::Tables;

/// The content of a compact or blocked prior with other extras. Its identity stays.
///
/// # Errors
/// If `bytes` are no compact or blocked prior, or if there is doubt of another number of splats.
pub fn with_extras(bytes: &[u8], extras: &Extras) -> Result<Vec<u8>, PriorError> {
    let mut file = own(bytes)?;
    extras.check(file.head.splats as usize)?;
    extras.put(&mut file);
    Ok(assembled(&file, bytes))
}

/// The content of a compact or blocked prior with other coder tables, or none. That makes it another prior.
///
/// # Errors
/// If `bytes` are no compact or blocked prior.
pub fn with_coder_tables(bytes: &[u8], tables: Option<&Tables>) -> Result<Vec<u8>, PriorError> {
    let mut file = own(bytes)?;
    let read = file::read(bytes)?;
    let id = identity_of(&read.splats, &read.options, read.frame.as_ref(), tables);
    file.head = Head { id, ..file.head };
    file.set(PartName::TABLES, tables.map(Tables::write));
    Ok(assembled(&file, bytes))
}

/// The parts of a file of one of our own formats.
fn own(bytes: &[u8]) -> Result<Container<'_>, PriorError> {
    let format = match bytes.starts_with(&Format::Blocked.magic()) {
        true => Format::Blocked,
        false => Format::Compact,
    };
    Container::read(bytes, format)
}

/// A file with its parts changed. What lies behind them, blocks of splats, stays.
fn assembled(file: &Container, before: &[u8]) -> Vec<u8> {
    let mut bytes = file.to_bytes();
    bytes.extend(&before[file.head.end as usize..]);
    bytes
}
