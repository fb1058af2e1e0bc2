//! What is in an update.

use std::path::Path;

use nvsprior::prior::{NewSplat, Update};

use crate::row;

pub fn print(path: &Path) -> anyhow::Result<()> {
    let update = Update::open(path)?;
    let bytes = std::fs::metadata(path)?.len();
    let count = update.splats.len();
    row("file", path.display().to_string());
    row("format", "update of a prior".into());
    row("prior", update.prior.to_string());
    row("number", update.number.to_string());
    row("stands on", format!("state {}", update.before));
    row("state", update.state().to_string());
    row("frames", format!("{} to {}", update.frames[0], update.frames[1]));
    row("bytes", bytes.to_string());
    let each = bytes as f64 / count.max(1) as f64;
    let each = if count > 0 { format!(", {each:.2} bytes each") } else { String::new() };
    row("splats", format!("{count} new{each}"));
    row("changed", format!("{} learnt before", update.changed.len()));
    row("taken back", format!("{} learnt before", update.removed.len()));
    print_fades(&update);
    print_place(&update);
    Ok(())
}

/// Each fade by the corners of its box.
fn print_fades(update: &Update) {
    row("fades", update.fades.len().to_string());
    for fade in &update.fades {
        let [from, to] = update.grid.corners(fade);
        let share = f64::from(fade.factor) / 2.55;
        row("fade", format!("to {share:.0} % from {} to {}", place(from), place(to)));
    }
}

/// The box that the new splats lie in.
fn print_place(update: &Update) {
    let positions = || update.splats.iter().map(|splat: &NewSplat| splat.position);
    let bound = |pick: fn(i32, i32) -> i32| {
        positions().reduce(|a, b| std::array::from_fn(|axis| pick(a[axis], b[axis])))
    };
    row("step", format!("{} of the prior's unit", update.grid.step()));
    if let (Some(min), Some(max)) = (bound(Ord::min), bound(Ord::max)) {
        let place = |steps| place(update.grid.position(steps).map(f64::from));
        row("where", format!("from {} to {}", place(min), place(max)));
    }
}

fn place([x, y, z]: [f64; 3]) -> String {
    format!("({x:.4}, {y:.4}, {z:.4})")
}
