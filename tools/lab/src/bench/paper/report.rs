//! The rows: printed, as JSON, as Markdown beside the paper's figures, as a plot and as pictures.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;

use super::methods::ANCHOR;
use super::published::{Table, frame_psnr, tables};
use super::row::{Entry, Row};
use super::{equal, picture};
use crate::bench::codecs::run::Run;
use crate::bench::perturbed::SHORT;
use crate::bench::plot;
use nvsprior_inputs::report::{self, fixed, write_json};

/// All rows: at the working points, and at one PSNR.
pub struct Rows {
    pub working: Vec<Entry>,
    /// The PSNR that [`Rows::equal`] aims at, dB.
    pub target: f64,
    pub equal: Vec<Entry>,
}

pub fn print(rows: &Rows) {
    println!("means per frame; bytes are all that is sent, pose and header included");
    list(&rows.working);
    println!("\nat the PSNR of {ANCHOR}, {:.2} dB", rows.target);
    list(&rows.equal);
}

fn list(entries: &[Entry]) {
    let columns = ["method", "bytes", "ratio", "dB", "SSIM", "MS-SSIM", "encode ms", "decode ms"];
    let mut table = report::Table::new(columns.into_iter().chain(["setting"]));
    for entry in entries {
        table.push(std::iter::once(entry.method().to_owned()).chain(cells(entry)));
    }
    table.print();
}

fn or_none(value: Option<f64>) -> String {
    value.map_or("–".into(), |value| fixed(value, 3))
}

/// What tables say of a method: its figures and its setting, or what is missing.
fn cells(entry: &Entry) -> [String; 8] {
    match entry {
        Entry::Missing { what, .. } => {
            let mut cells = std::array::from_fn(|_| "–".to_owned());
            cells[7] = format!("missing: {what}");
            cells
        }
        Entry::Measured(row) => [
            fixed(row.bytes, 0),
            fixed(row.ratio, 1),
            fixed(row.psnr, 2),
            or_none(row.similarity.ssim),
            or_none(row.similarity.ms_ssim),
            fixed(row.encode_ms, 1),
            fixed(row.decode_ms, 1),
            words(row),
        ],
    }
}

/// A row's setting, and what else there is to say of it.
fn words(row: &Row) -> String {
    let mut words = row.setting.text();
    if let Some(found) = row.found {
        words += &format!(", {found} of {} frames found", row.frames);
    }
    if let Some(parameters) = row.parameters {
        words += &format!(", {:.1} M weights", parameters as f64 * 1e-6);
    }
    if row.reached == Some(false) {
        words += ", the nearest to the PSNR asked for";
    }
    words
}

/// Writes paper.json, paper-equal.json, paper.md, paper.svg and paper.png.
pub fn write(folder: &Path, set: &str, frames: &Run, rows: &Rows) -> anyhow::Result<()> {
    write_json(&folder.join("paper.json"), &rows.working)?;
    write_json(&folder.join("paper-equal.json"), &rows.equal)?;
    let path = folder.join("paper.md");
    let text = markdown(set, frames, rows);
    std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
    plot::codecs(&folder.join("paper.svg"), curves(rows))?;
    picture::write(&folder.join("paper.png"), frames, &rows.working)
}

/// A curve per method: its working point, and that at the common PSNR.
fn curves(rows: &Rows) -> Vec<(String, Vec<(f64, f64)>)> {
    let point = |row: &Row| (row.bytes, row.psnr);
    let curve = |row: &Row| {
        let equal = rows.equal.iter().filter_map(Entry::row);
        let equal = equal.filter(|equal| equal.method == row.method);
        let points = std::iter::once(row).chain(equal).map(point);
        (row.method.clone(), points.filter(|point| point.1.is_finite()).collect())
    };
    rows.working.iter().filter_map(Entry::row).map(curve).collect()
}

fn markdown(set: &str, frames: &Run, rows: &Rows) -> String {
    let (tables, psnr) = (tables(set), frame_psnr(set));
    let mut text = String::new();
    let size = frames.frames.first().map_or((0, 0), |frame| (frame.width, frame.height));
    let _ = writeln!(
        text,
        "# {}, {} frames of {}×{}\n\n\
         All figures are means per frame. Bytes are all that is sent for a frame: for `affine+` and `invs+` the \
         payload, 28 \
         bytes of pose as in the paper, and 24 of a warp; for `ours-` and `estimator` whole packets; for the others \
         the \
         payload alone. WebP's payload is counted without its container. Times are of this machine; those of JPEG XL \
         include the start of its programs.\n\n## Working points\n\n\
         The paper does not state its coders' settings, but what PSNR they give plain frames. So WebP has the one \
         quality, \
         in all its rows, with which plain frames come nearest to the paper's {:.2} dB; JPEG XL has the one distance \
         with \
         which they come nearest to {:.2} dB. The program's own coder has the quality with which it reaches the PSNR \
         of \
         `{ANCHOR}`, {:.2} dB. `estimator` starts each frame from nothing, by the prior's key frames; `estimator-cnn` \
         starts \
         at given poses, and searches nowhere else. Its time and that of `affine-cnn` are without the regressor's. \
         Packets \
         of both estimators state their session, 29 bytes more. A frame is found \
         if its render is at most {SHORT} dB below the best that any row has.\n",
        set,
        frames.frames.len(),
        size.0,
        size.1,
        psnr[0],
        psnr[1],
        rows.target,
    );
    text += &table(&rows.working, tables);
    for Table { data, label, frames, .. } in tables {
        let _ = writeln!(
            text,
            "\nThe figures for \"{data}\" are cited from the paper (`{label}`): {frames} frames of its own data, on \
                its own \
             machine."
        );
    }
    let _ = writeln!(
        text,
        "\n## At one PSNR\n\nThe quality of each method is set for {:.2} dB, the PSNR of `{ANCHOR}` above, to within \
            {} dB.\n",
        rows.target,
        equal::TOLERANCE,
    );
    text += &table(&rows.equal, &[]);
    text
}

fn table(entries: &[Entry], published: &[Table]) -> String {
    let columns = [
        "method",
        "bytes",
        "ratio",
        "PSNR, dB",
        "SSIM",
        "MS-SSIM",
        "encode, ms",
        "decode, ms",
        "setting",
    ];
    let cited = published
        .iter()
        .map(|table| format!("the paper reports for its {}: bytes, ratio, PSNR, ms", table.data));
    let mut table = report::Table::new(columns.map(String::from).into_iter().chain(cited));
    for entry in entries {
        let cited = published.iter().map(|table| {
            table.row(entry.method()).map_or("–".into(), |row| {
                format!("{}, {:.2}, {:.2}, {}", row.bytes, row.ratio, row.psnr, row.ms)
            })
        });
        let method = format!("`{}`", entry.method());
        table.push(std::iter::once(method).chain(cells(entry)).chain(cited));
    }
    table.markdown()
}
