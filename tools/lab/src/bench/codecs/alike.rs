//! How alike the coders' pictures look to the frames, at equal bytes and at equal PSNR.

use super::point::{Input, Mode, Point, value_at};
use super::rates::Curve;
use nvsprior_inputs::report::{Table, fixed_or_empty};

/// Bytes per frame at which coders are compared.
const BYTES: [f64; 3] = [100.0, 300.0, 1000.0];
/// PSNR at which they are compared, dB.
const PSNR: [f64; 2] = [33.0, 35.0];

/// A measure of a point, by its name.
type Measure = (&'static str, fn(&Point) -> Option<f64>);

const MEASURES: [Measure; 2] =
    [("ssim", |point| point.similarity.ssim), ("ms_ssim", |point| point.similarity.ms_ssim)];

/// A row for each coder of difference pictures that codes each by itself. Values lie on straight lines between the
/// measured points, over bytes as logarithms or over PSNR; empty beyond the points.
pub fn table(curves: &[Curve]) -> Table {
    let mut header = vec!["coder".to_owned()];
    for (name, _) in MEASURES {
        header.extend(BYTES.map(|bytes| format!("{name}_at_{bytes}_bytes")));
        header.extend(PSNR.map(|psnr| format!("{name}_at_{psnr}_db")));
    }
    let mut table = Table::new(&header);
    let compared = |curve: &&Curve| curve.input == Input::Difference && curve.mode == Mode::Intra;
    for curve in curves.iter().filter(compared) {
        let mut row = vec![curve.coder.to_owned()];
        for (_, measure) in MEASURES {
            let at_bytes =
                |bytes: f64| value_at(&curve.points, |p| p.bytes.ln(), measure, bytes.ln());
            let at_psnr = |psnr| value_at(&curve.points, |p| p.psnr, measure, psnr);
            row.extend(BYTES.map(at_bytes).map(|value| fixed_or_empty(value, 4)));
            row.extend(PSNR.map(at_psnr).map(|value| fixed_or_empty(value, 4)));
        }
        table.push(row);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::similarity::Similarity;

    fn point(input: Input, bytes: f64, psnr: f64, ssim: f64) -> Point {
        let similarity = Similarity { ssim: Some(ssim), ms_ssim: None };
        let (mode, setting, encode_ms, decode_ms) = (Mode::Intra, 0.0, 0.0, 0.0);
        Point {
            coder: "test".into(),
            input,
            mode,
            setting,
            bytes,
            psnr,
            similarity,
            encode_ms,
            decode_ms,
        }
    }

    #[test]
    fn measures_are_read_at_equal_bytes_and_at_equal_psnr() {
        let points = [
            point(Input::Difference, 1000.0, 34.0, 0.96),
            point(Input::Difference, 100.0, 32.0, 0.90),
            point(Input::Frame, 200.0, 33.0, 0.5),
        ];
        let text = table(&Curve::all(&points)).markdown();
        let rows: Vec<&str> = text.lines().skip(2).collect();
        // log10 of 300 is 2.4771.
        assert_eq!(rows, ["| test | 0.9000 | 0.9286 | 0.9600 | 0.9300 |  |  |  |  |  |  |"]);
    }
}
