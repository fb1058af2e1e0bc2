//! Why an update cannot be used.

use std::path::Path;

use super::super::error::PriorError;
use super::super::id::PriorId;
use super::limits::{MAX_FADES, MAX_LEARNT};
use super::state::StateId;

/// Why an update cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum UpdateError {
    #[error("no update of a prior: it does not begin with \"nvsu\"")]
    UnknownFormat,
    #[error("update of version {version}; this program reads version {known}: update it")]
    Newer { version: u8, known: u8 },
    #[error("truncated: an update has {needed} bytes or more, this one {found}")]
    Truncated { needed: usize, found: usize },
    #[error("damaged: the check says {stated:08x}, the content {found:08x}; get the update again")]
    Damaged { stated: u32, found: u32 },
    /// The check is right, so no link did this: another program wrote it.
    #[error("update, from byte {offset}: {reason}; write it anew")]
    Field { offset: usize, reason: String },
    #[error("{part} {index} of the update: {reason}")]
    Part { part: &'static str, index: usize, reason: String },
    #[error("the update {reason}")]
    Content { reason: String },
    #[error("an update of prior {stated}, not of prior {prior}; take the updates of one prior")]
    Foreign { stated: PriorId, prior: PriorId },
    #[error(
        "update {number} stands on state {before}, but update {due} is due, on state {state}; \
         {}", advice(*.number, *.due)
    )]
    NotNext { number: u16, before: StateId, due: u32, state: StateId },
    #[error(
        "update {number} stands on state {before}, but the updates before it lead to state {state}; \
         take the updates of one dive"
    )]
    OtherChain { number: u16, before: StateId, state: StateId },
    #[error("a scene without room for updates: upload the prior with `upload_for_updates`")]
    NoRoom,
    #[error("{does} splat {ordinal} of {learnt} learnt ones; it belongs to other updates")]
    NotLearnt { does: &'static str, ordinal: u16, learnt: usize },
    /// The state before is right, so no other update is missing: another program wrote it.
    #[error("changes learnt splat {ordinal} beyond what a splat can be: {reason}; write it anew")]
    Change { ordinal: u16, reason: String },
    #[error("{count} learnt splats: at most {}; take back some before", MAX_LEARNT)]
    TooManyLearnt { count: usize },
    #[error("{count} fades in all updates: at most {}; fade larger boxes", MAX_FADES)]
    TooManyFades { count: usize },
    #[error("update {due} and all after it are left out: {error}")]
    LeftOut { due: u32, error: Box<UpdateError> },
    /// A file could not be read or written, or the prior with what was learnt is none.
    #[error(transparent)]
    Prior(#[from] PriorError),
    #[error("{file}: {error}")]
    InFile { file: String, error: Box<UpdateError> },
}

impl UpdateError {
    /// Adds the name of the file to an error.
    pub fn in_file(self, path: &Path) -> UpdateError {
        UpdateError::InFile { file: path.display().to_string(), error: Box::new(self) }
    }
}

/// What to do about an update that is not the next one.
fn advice(number: u16, due: u32) -> String {
    match u32::from(number) {
        number if number < due => "it is there already, or belongs to another dive".into(),
        number if number == due + 1 => format!("add update {due} first"),
        number => format!("add updates {due} to {} first", number - 1),
    }
}
