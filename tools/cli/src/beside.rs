//! The files beside a prior that is made of another one.

use std::path::Path;

use nvsprior::Prior;
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

/// Puts a prior's coder tables beside the one that is made of it, if that cannot hold them. If an earlier run left
/// tables there, they would be read with it: says so.
pub fn place_tables(prior: &Prior, container: Container, out: &Path) -> Result<(), PriorError> {
    let beside = tables_file::path_beside(out);
    match (prior.coder_tables(), container) {
        (Some(tables), Container::Ply) => return tables_file::save(tables, &beside),
        _ if !beside.exists() => return Ok(()),
        _ => (),
    }
    tables_file::open(&beside)?;
    eprintln!("{}: takes precedence over the coder tables of the prior", beside.display());
    Ok(())
}

/// Puts the weights of a prior's display filter beside a prior of the same scene. Without weights, those that an
/// earlier run left there would be read with it: says so.
pub fn place_filter(weights: Option<&FilterWeights>, out: &Path) -> Result<(), PriorError> {
    let beside = filter_file::path_beside(out);
    if let Some(weights) = weights {
        return filter_file::save(weights, &beside);
    }
    if beside.exists() {
        filter_file::open(&beside)?;
        eprintln!("{}: its weights are used with the prior", beside.display());
    }
    Ok(())
}
