//! The weights of the display filter for the prior's scene, in a file beside the prior's.
//!
//! They are no part of its identity: nothing is predicted from a filtered picture, so only the topside needs them.

use std::path::{Path, PathBuf};

use super::beside;
use super::error::PriorError;
use super::replace::replace_file;
use crate::filter_weights::{FilterWeights, FilterWeightsError};

/// What errors call them.
const FORMAT: &str = "filter weights";

/// The file beside a prior's file: `prior.ply.filter` beside `prior.ply`.
pub fn path_beside(prior: &Path) -> PathBuf {
    beside::path(prior, "filter")
}

/// Reads a file of weights. Errors name it.
///
/// # Errors
/// If it cannot be read, or holds no weights.
pub fn open(path: &Path) -> Result<FilterWeights, PriorError> {
    let read = || {
        let bytes = beside::read(path, FilterWeights::encoded_len() as u64, FORMAT)?;
        FilterWeights::read(&bytes).map_err(|error| refusal(&error))
    };
    read().map_err(|error| error.in_file(&path.display().to_string()))
}

/// Reads the weights in the file beside a prior's; `None` if there is no such file.
///
/// # Errors
/// As for [`open`].
pub fn open_beside(prior: &Path) -> Result<Option<FilterWeights>, PriorError> {
    let path = path_beside(prior);
    if beside::is_absent(&path) { Ok(None) } else { open(&path).map(Some) }
}

/// Writes a file of weights, which is there whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn save(weights: &FilterWeights, path: &Path) -> Result<(), PriorError> {
    replace_file(path, &weights.write())
}

fn refusal(error: &FilterWeightsError) -> PriorError {
    let at = match *error {
        FilterWeightsError::Length { expected, found } => expected.min(found),
        FilterWeightsError::Magic
        | FilterWeightsError::Check
        | FilterWeightsError::Range { .. } => 0,
    };
    PriorError::Field { format: FORMAT, offset: at as u64, reason: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::super::tables_file::tests::folder;
    use super::super::{Prior, RenderOverrides};
    use super::*;
    use crate::filter_weights::tests::random_weights;

    #[test]
    fn those_beside_a_prior_are_read_with_it_and_leave_its_identity() {
        let (_folder, path) = folder();
        let read = || Prior::open(&path, &RenderOverrides::default());
        let plain = read().unwrap();
        assert!(plain.filter_weights().is_none());
        let weights = random_weights(5);
        let beside = path_beside(&path);
        assert!(beside.to_str().unwrap().ends_with("p.ply.filter"));
        save(&weights, &beside).unwrap();
        let with = read().unwrap();
        assert_eq!(with.filter_weights().map(|weights| &**weights), Some(&weights));
        assert_eq!(with.id(), plain.id());
        let mut bytes = weights.write();
        bytes[100] ^= 1;
        std::fs::write(&beside, &bytes).unwrap();
        let text = read().unwrap_err().to_string();
        assert!(text.contains("p.ply.filter") && text.contains("damaged"), "{text}");
        std::fs::write(&beside, &bytes[..bytes.len() - 1]).unwrap();
        let text = read().unwrap_err().to_string();
        assert!(text.contains("expected"), "{text}");
    }
}
