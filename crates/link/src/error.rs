//! Why an end of a link cannot be made, or refuses what it is given.

use crate::keys::KeyError;
use crate::modem::ModemError;
use nvsprior::{Error, ErrorKind};

/// Why an end of a link cannot be made, or refuses what it is given.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum LinkError {
    #[error(transparent)]
    Modem(#[from] ModemError),
    #[error(transparent)]
    Key(#[from] KeyError),
    /// Of encoder or decoder.
    #[error(transparent)]
    Picture(#[from] Error),
    #[error("{option}: {found}, must be {allowed}")]
    Option { option: &'static str, found: String, allowed: &'static str },
    #[error(
        "a state of {len} bytes: damaged, or not of such an end; leave it out, and with keys give both sides the next \
         epoch"
    )]
    State { len: usize },
    #[error(
        "epoch {epoch}: this side was in epoch {known} with these keys; give both sides a greater one"
    )]
    Epoch { epoch: u64, known: u64 },
}

impl LinkError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            LinkError::Modem(error) => error.kind(),
            LinkError::Picture(error) => error.kind(),
            LinkError::Key(_)
            | LinkError::Option { .. }
            | LinkError::State { .. }
            | LinkError::Epoch { .. } => ErrorKind::Argument,
        }
    }

    pub(super) fn option(
        option: &'static str,
        found: impl ToString,
        allowed: &'static str,
    ) -> LinkError {
        LinkError::Option { option, found: found.to_string(), allowed }
    }
}
