//! What is in a chain of updates.

use std::path::Path;

use nvsprior::prior::UpdateChain;

use crate::{record, row};

pub fn print(path: &Path) -> anyhow::Result<()> {
    let read = UpdateChain::open(path)?;
    let (chain, learnt) = (&read.chain, read.chain.learnt());
    let rows = record::rows_of(chain, "")?;
    row("file", path.display().to_string());
    row("format", "chain of updates of a prior".into());
    row("prior", learnt.prior().to_string());
    row("updates", format!("{}, which lead to state {}", rows.len(), learnt.state()));
    row("bytes", format!("{} of all updates", rows.iter().map(|row| row.bytes).sum::<usize>()));
    row("learnt", format!("{} splats, {} fades", learnt.splats().len(), learnt.fades()));
    for update in &rows {
        row(&update.name(), update.to_string());
    }
    if let Some(error) = read.left_out {
        row("left out", error.to_string());
    }
    Ok(())
}
