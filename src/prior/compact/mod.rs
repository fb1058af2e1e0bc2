//! The compact prior, `.nvsg`: one file with all that belongs to a prior. Splats take about twelve bytes each.
//!
//! The bytes: `docs/format/prior.md`. Positions are off by up to half a step; rotations of key frames by up to 0.28°. A
//! prior of another format can be kept exactly instead: [`write_exact`].
//!
//! **Order.** Splats are in the order of the curve. The order is part of the prior's identity: the identity is the one
//! that [`write()`] returns, not that of the splats given to it. Splats close in space are also close in memory.
//!
//! **Same on every machine.** Reading uses only additions, products and square roots, and ends with a check of the
//! identity: a reader has the splats that the writer saw. Writing what was read, at the same quantisation, gives the
//! same splats again.
//!
//! **What it costs**, beside other coders: `docs/experiments/coders.md`, compact priors.

mod coded;
mod exact;
mod planes;
mod quantise;
mod stream;

use std::io::Write;

use super::container::{Container, Covered, Format, Head, PartName};
use super::identity::identity_of;
use super::{Besides, Extras, PriorError, PriorFile, PriorFormat, PriorId, Splats};
pub use coded::Coded;
pub use quantise::{Quantisation, UNIFORM_BITS};

/// How a compact prior starts.
pub const MAGIC: &[u8] = &Format::Compact.magic();

/// Writes a prior in steps. Splats come in the order of a curve, and with them their doubt. The order is part of the
/// prior's identity: the identity is the one that this returns, not that of the splats given to it. Writing what was
/// read, at the same quantisation, gives the same splats again.
///
/// # Errors
/// If the quantisation is out of its range, if a splat is invalid or one of its values too large for its step, or if
/// `writer` fails.
pub fn write(
    splats: &Splats,
    besides: &Besides,
    quantisation: &Quantisation,
    writer: impl Write,
) -> Result<PriorId, PriorError> {
    quantisation.check()?;
    besides.check(splats)?;
    let (coded, order) = Coded::of(splats, quantisation)?;
    let extras = besides.extras.reordered(&order);
    let besides = Besides { extras: &extras, ..*besides };
    let kept = Splats { origin: splats.origin, ..coded.splats() };
    finish(&kept, &besides, PartName::SPLATS, coded.to_bytes()?, writer)
}

/// Writes a prior with its splats as they are, so that picture and identity stay.
///
/// # Errors
/// If a splat is invalid, or if `writer` fails.
pub fn write_exact(
    splats: &Splats,
    besides: &Besides,
    writer: impl Write,
) -> Result<PriorId, PriorError> {
    besides.check(splats)?;
    finish(splats, besides, PartName::EXACT, exact::to_bytes(splats)?, writer)
}

/// Writes the file of splats that stand in a part as `content`.
fn finish(
    splats: &Splats,
    besides: &Besides,
    name: PartName,
    content: Vec<u8>,
    mut writer: impl Write,
) -> Result<PriorId, PriorError> {
    let id = identity_of(splats, besides.options, besides.frame, besides.coder_tables);
    let head = Head::new(Format::Compact, splats.sh_degree, splats.len(), id);
    let mut file = besides.file(head, splats.origin);
    file.set(name, Some(content));
    let written = writer.write_all(&file.to_bytes()).and_then(|()| writer.flush());
    written.map_err(PriorError::Write)?;
    Ok(id)
}

/// Reads the content of a compact prior. Memory depends on the content's size, whatever the head says: at most 1000
/// bytes per byte, and a window of 64 MiB.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    let file = Container::read(bytes, Format::Compact)?;
    if file.head.end != bytes.len() as u64 {
        let reason = "more bytes than parts".into();
        return Err(Format::Compact.refusal(file.head.end as usize, reason));
    }
    let Covered { options, frame, coder_tables, origin } = Covered::read(&file)?;
    let (degree, count) = (file.head.sh_degree, file.head.splats as usize);
    let exact = |content: &[u8], at| exact::read(content, at, count, degree);
    let coded = |content: &[u8], at| Ok(Coded::read(content, at, count, degree)?.splats());
    let mut splats = match file.read_part(PartName::EXACT, exact)? {
        Some(splats) => splats,
        None => file.required(PartName::SPLATS)?.read_content(coded)?,
    };
    splats.origin = origin;
    let found = identity_of(&splats, &options, frame.as_ref(), coder_tables.as_ref());
    if found != file.head.id {
        return Err(PriorError::Identity { stated: file.head.id, found });
    }
    let extras = Extras::read(&file)?;
    let read = PriorFile::new(splats, options, PriorFormat::Compact);
    Ok(PriorFile { coder_tables, frame, extras, ..read })
}

#[cfg(test)]
mod tests;
