//! The rows that the program holds to predict GPUs by: `tools/lab/src/cost/compiled.json`.

use std::path::Path;

use anyhow::Context as _;

use super::row::Row;
use crate::cost::{SUBGROUP, is_modelled};

/// Writes the file if it is to be renewed; else says what is wrong if it has other rows.
pub fn check(path: &Path, rows: &[Row], renew: bool) -> anyhow::Result<Option<String>> {
    let text = text(rows)?;
    if renew {
        std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))?;
        return Ok(None);
    }
    let held = std::fs::read_to_string(path);
    let held = held.with_context(|| format!("reading {}", path.display()))?;
    let fault =
        || format!("{} has other figures; `make gpu-check RENEW=1` renews it", path.display());
    Ok((held != text).then(fault))
}

/// The rows that the model reads, one a line.
fn text(rows: &[Row]) -> anyhow::Result<String> {
    let read = rows.iter().filter(|row| row.subgroup == SUBGROUP && is_modelled(row));
    let lines = read.map(serde_json::to_string).collect::<Result<Vec<_>, _>>()?;
    Ok(format!("[\n{}\n]\n", lines.join(",\n")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_figures_are_a_fault() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("compiled.json");
        let row = |stage: &str, instructions| Row {
            stage: stage.into(),
            module: stage.into(),
            subgroup: SUBGROUP,
            instructions,
            ..Row::default()
        };
        let rows = [row("solve", 7), row("train_step", 8)];
        assert!(check(&path, &rows, false).is_err(), "no file yet");
        assert_eq!(check(&path, &rows, true).unwrap(), None);
        assert_eq!(check(&path, &rows, false).unwrap(), None);
        let held: Vec<Row> = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(held, rows[..1]);
        let fault = check(&path, &[row("solve", 9)], false).unwrap().unwrap();
        assert!(fault.contains("make gpu-check RENEW=1"), "{fault}");
    }
}
