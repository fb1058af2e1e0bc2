//! The files beside a prior that is made of another one. They are checked before the work, and placed right before the
//! prior: work that fails or is stopped leaves an earlier prior of that name as it was.

use std::path::Path;

use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::filter_weights::FilterWeights;
use nvsprior::prior::{KeyFrames, PriorError, filter_file, tables_file};

use crate::container::Container;

/// An earlier run may have left key frames beside a prior that is written now. They would be read in place of those
/// written to it. Says so, and refuses broken ones before any work is done.
pub fn check_key_frames(out: &Path) -> Result<(), PriorError> {
    let beside = KeyFrames::path_beside(out);
    if beside.exists() {
        KeyFrames::open(&beside)?;
        eprintln!("{}: takes precedence over the key frames of the prior", beside.display());
    }
    Ok(())
}

/// The coder tables that [`place_tables`] puts beside a prior, if that cannot hold them.
fn tables_of(prior: &Prior, container: Container) -> Option<&Tables> {
    let tables = prior.coder_tables().filter(|_| matches!(container, Container::Ply));
    tables.map(AsRef::as_ref)
}

/// An earlier run may have left coder tables that would be read with a prior that is made of another one. Says so, and
/// refuses broken ones.
pub fn check_tables(prior: &Prior, container: Container, out: &Path) -> Result<(), PriorError> {
    let beside = tables_file::path_beside(out);
    if tables_of(prior, container).is_none() && beside.exists() {
        tables_file::open(&beside)?;
        eprintln!("{}: takes precedence over the coder tables of the prior", beside.display());
    }
    Ok(())
}

/// Puts a prior's coder tables beside the one that is made of it, if that cannot hold them.
pub fn place_tables(prior: &Prior, container: Container, out: &Path) -> Result<(), PriorError> {
    let save = |tables| tables_file::save(tables, &tables_file::path_beside(out));
    tables_of(prior, container).map_or(Ok(()), save)
}

/// As [`check_tables`], for the weights of a display filter, if there are none to place.
pub fn check_filter(weights: Option<&FilterWeights>, out: &Path) -> Result<(), PriorError> {
    let beside = filter_file::path_beside(out);
    if weights.is_none() && beside.exists() {
        filter_file::open(&beside)?;
        eprintln!("{}: its weights are used with the prior", beside.display());
    }
    Ok(())
}

/// Puts the weights of a prior's display filter beside a prior of the same scene.
pub fn place_filter(weights: Option<&FilterWeights>, out: &Path) -> Result<(), PriorError> {
    let save = |weights| filter_file::save(weights, &filter_file::path_beside(out));
    weights.map_or(Ok(()), save)
}
