//! The table of `docs/latency.md`: a row for each report.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::schema::{Best, Coding, Report, Size};
use crate::bench::stages::{FLOW, PICTURE};
use nvsprior_inputs::report::{Table, between, fixed};

const BEGIN: &str = "<!-- devices: written by `nvsprior-lab device-report --table` -->\n";
const END: &str = "<!-- devices: end -->\n";

/// Reads reports, and gives the part of the document that is made from them.
pub fn section(reports: &[PathBuf]) -> anyhow::Result<String> {
    let reports = reports.iter().map(|path| Report::read(path));
    let reports = reports.collect::<anyhow::Result<Vec<_>>>()?;
    Ok(format!("{BEGIN}\n{}\n{END}", table(&reports).markdown()))
}

/// Puts a section in the place of a document's own.
pub fn renew(document: &Path, section: &str) -> anyhow::Result<()> {
    let name = || document.display().to_string();
    let text = std::fs::read_to_string(document).with_context(name)?;
    let old = between(&text, BEGIN, END);
    let old = old.with_context(|| format!("{} has no place for the table", name()))?;
    std::fs::write(document, text.replacen(old, section, 1)).with_context(name)
}

/// A row for each report. A cell has a figure for each size of pictures.
fn table(reports: &[Report]) -> Table {
    let coded = |budget: usize, figure: fn(&Coding) -> Option<f64>| {
        move |r: &Report| {
            by_size(
                r,
                &|size| size.coding.iter().find(|c| c.budget_bytes == budget).and_then(figure),
                1,
            )
        }
    };
    let encoded = |c: &Coding| c.encode_ms.map(|ms| ms.median);
    let decoded = |c: &Coding| Some(c.decode_ms.median);
    Table::of(
        reports,
        &[
            ("device", &device),
            ("machine", &machine),
            ("the same bytes", &same),
            ("GB/s; GFLOP/s; µs", &ceilings),
            ("render", &|r| by_size(r, &|size| size.forward_render_ms, 1)),
            ("search", &|r| by_size(r, &|size| size.steady.as_ref().map(|f| f.frame_ms), 1)),
            ("encode, 300 bytes", &coded(300, encoded)),
            ("decode, 300 bytes", &coded(300, decoded)),
            ("encode, 1000 bytes", &coded(1000, encoded)),
            ("decode, 1000 bytes", &coded(1000, decoded)),
            ("picture, measured / predicted", &|r| by_size(r, &|size| ratio(size, PICTURE.0), 2)),
            ("evaluation, measured / predicted", &|r| by_size(r, &|size| ratio(size, FLOW.0), 2)),
            ("device MB", &|r| by_size(r, &|size| megabytes(size.device_memory_used_bytes), 0)),
            ("host MB", &|r| by_size(r, &|size| megabytes(size.host_memory_bytes), 0)),
        ],
    )
}

fn device(report: &Report) -> String {
    let device = report.device.as_ref();
    device.map_or("none".into(), |d| format!("{}, {}: {}", d.name, d.driver, d.form))
}

fn machine(report: &Report) -> String {
    let host = &report.host;
    let name = host.board.as_ref().or(host.processor.as_ref()).unwrap_or(&host.system);
    format!("{name}, {} threads", host.threads)
}

fn same(report: &Report) -> String {
    match &report.verify {
        Some(verdict) if verdict.portable => format!("yes, {} pictures", verdict.pictures),
        Some(_) => "**no**".into(),
        None => "not known".into(),
    }
}

/// How much longer the stages of a job take than the model says.
fn ratio(size: &Size, job: &str) -> Option<f64> {
    let [measured, predicted] = size.of_job(job);
    measured.zip(predicted).filter(|(_, predicted)| *predicted > 0.0).map(|(m, p)| m / p)
}

fn megabytes(bytes: Option<u64>) -> Option<f64> {
    bytes.map(|bytes| bytes as f64 * 1e-6)
}

/// Copy, multiply-adds, dispatch.
fn ceilings(report: &Report) -> String {
    let Some(Best { rates, dispatch_seconds, .. }) = report.ceilings else { return "–".into() };
    let all = [rates.bytes * 1e-9, rates.flops * 1e-9, dispatch_seconds * 1e6];
    all.map(|value| fixed(value, 1)).join("; ")
}

fn by_size(report: &Report, figure: &dyn Fn(&Size) -> Option<f64>, digits: usize) -> String {
    let cell = |size| figure(size).map_or("–".to_owned(), |value| fixed(value, digits));
    report.sizes.iter().map(cell).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::super::schema::tests::report;
    use super::*;

    #[test]
    fn a_report_is_a_row_with_a_figure_for_each_size() {
        let mut second = report();
        second.sizes.push(Size { forward_render_ms: None, ..second.sizes[0].clone() });
        second.verify = None;
        let text = table(&[report(), second]).markdown();
        let rows: Vec<&str> = text.lines().skip(2).collect();
        assert!(rows[0].starts_with("| A device, driver 1.2: waves of 32 | A board, 8 threads |"));
        for cell in ["yes, 12 pictures", "60.0; 1500.0; 4.0", "12.5", "–", "7.0", "2.00", "26"] {
            assert!(rows[0].contains(&format!("| {cell} |")), "{cell}: {text}");
        }
        for cell in ["not known", "12.5; –", "2.00; 2.00"] {
            assert!(rows[1].contains(&format!("| {cell} |")), "{cell}: {text}");
        }
    }

    #[test]
    fn a_document_gets_the_table_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let [json, document] = ["a.json", "devices.md"].map(|name| folder.path().join(name));
        report().write(&json).unwrap();
        std::fs::write(&document, format!("Before\n\n{BEGIN}old\n{END}\nAfter\n")).unwrap();
        let section = section(&[json]).unwrap();
        renew(&document, &section).unwrap();
        let text = std::fs::read_to_string(&document).unwrap();
        assert_eq!(text, format!("Before\n\n{section}\nAfter\n"));
        std::fs::write(&document, "No place\n").unwrap();
        let error = renew(&document, &section).unwrap_err().to_string();
        assert!(error.contains("has no place for the table"), "{error}");
    }

    #[test]
    fn the_projects_page_is_made_from_its_reports() {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        let files = std::fs::read_dir(docs.join("devices")).unwrap();
        let mut files: Vec<_> = files.map(|file| file.unwrap().path()).collect();
        files.sort();
        let page = std::fs::read_to_string(docs.join("latency.md")).unwrap();
        let held = between(&page, BEGIN, END).unwrap();
        assert_eq!(held, section(&files).unwrap(), "docs/latency.md says how to renew it");
    }
}
