//! Methods that are measured elsewhere, at one PSNR: between their points, on straight lines, bytes as logarithms.

use super::equal::TOLERANCE;
use super::learned::method_of;
use super::row::{Entry, Row, Setting};
use crate::bench::similarity::Similarity;

/// The row of a method at a PSNR; `None`: it has no point. Beyond its points it is the nearest of them.
pub fn at(method: &str, entries: &[Entry], target: f64) -> Option<Entry> {
    let rows = entries.iter().filter_map(Entry::row);
    let mut rows: Vec<&Row> = rows.filter(|row| method_of(&row.method) == method).collect();
    rows.retain(|row| row.psnr.is_finite() && row.bytes > 0.0);
    rows.sort_by(|a, b| a.psnr.total_cmp(&b.psnr));
    let off = |row: &Row| (row.psnr - target).abs();
    let nearest = *rows.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
    let row = match rows.windows(2).find(|pair| pair[0].psnr < target && target < pair[1].psnr) {
        Some(pair) if off(nearest) > TOLERANCE => between(pair[0], pair[1], target),
        _ => Row { reached: Some(off(nearest) <= TOLERANCE), ..nearest.clone() },
    };
    Some(Entry::measured(Row { method: method.to_owned(), ..row }))
}

fn between(low: &Row, high: &Row, target: f64) -> Row {
    let part = (target - low.psnr) / (high.psnr - low.psnr);
    let line = |low: f64, high: f64| low + part * (high - low);
    let both = |of: fn(&Similarity) -> Option<f64>| {
        Some(line(of(&low.similarity)?, of(&high.similarity)?))
    };
    let bytes = line(low.bytes.ln(), high.bytes.ln()).exp();
    Row {
        setting: Setting::Words(format!(
            "between {} and {}",
            low.setting.text(),
            high.setting.text()
        )),
        bytes,
        ratio: low.ratio * low.bytes / bytes,
        encode_ms: line(low.encode_ms, high.encode_ms),
        decode_ms: line(low.decode_ms, high.decode_ms),
        psnr: target,
        similarity: Similarity { ssim: both(|s| s.ssim), ms_ssim: both(|s| s.ms_ssim) },
        reached: Some(true),
        ..low.clone()
    }
}
