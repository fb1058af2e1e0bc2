//! Coders side by side at the same PSNR.

use super::point::{Input, Mode, Point, bd_rate, bytes_at};

/// The coder that all others are held against.
const WAVELET: &str = "wavelet";

/// PSNR at which coders are compared, dB.
pub const LEVELS: [f64; 7] = [30.0, 31.0, 32.0, 33.0, 34.0, 35.0, 36.0];

/// Points of one coder, input and mode.
pub struct Curve<'a> {
    pub coder: &'a str,
    pub input: Input,
    pub mode: Mode,
    pub points: Vec<&'a Point>,
}

impl<'a> Curve<'a> {
    /// All of them, in the order of their first points.
    pub fn all(points: &'a [Point]) -> Vec<Curve<'a>> {
        let mut curves: Vec<Curve> = Vec::new();
        for point in points {
            let (coder, input, mode) = (&*point.coder, point.input, point.mode);
            let same = |c: &&mut Curve| (c.coder, c.input, c.mode) == (coder, input, mode);
            match curves.iter_mut().find(same) {
                Some(curve) => curve.points.push(point),
                None => curves.push(Curve { coder, input, mode, points: vec![point] }),
            }
        }
        curves
    }

    /// Its name in one line.
    pub fn name(&self) -> String {
        format!("{}, {}, {}", self.coder, self.input.name(), self.mode.name())
    }

    /// Bytes at each of [`LEVELS`].
    pub fn bytes(&self) -> [Option<f64>; LEVELS.len()] {
        LEVELS.map(|psnr| bytes_at(&self.points, psnr))
    }

    /// Whether it is the reference for all others: the wavelet coder on the difference picture.
    fn is_reference(&self) -> bool {
        self.coder == WAVELET && self.input == Input::Difference
    }

    /// Whether it is the wavelet coder, whatever it is tuned to.
    fn is_own(&self) -> bool {
        self.coder.starts_with(WAVELET)
    }
}

/// A curve, and how the reference compares with it.
pub struct Row<'a> {
    pub curve: &'a Curve<'a>,
    /// How many more bytes the reference takes, as a share of this coder's; `None` for the reference itself, or without
    /// a common PSNR.
    pub bd_rate: Option<f64>,
    pub bytes: [Option<f64>; LEVELS.len()],
}

pub fn rows<'a>(curves: &'a [Curve<'a>]) -> Vec<Row<'a>> {
    let reference = curves.iter().find(|curve| curve.is_reference());
    let row = |curve: &'a Curve<'a>| {
        let other = reference.filter(|_| !curve.is_reference());
        let bd_rate = other.and_then(|reference| bd_rate(&reference.points, &curve.points));
        Row { curve, bd_rate, bytes: curve.bytes() }
    };
    curves.iter().map(row).collect()
}

/// The least bytes of any other coder at a level, and the reference's share of them.
pub struct Best<'a> {
    pub psnr: f64,
    pub curve: &'a Curve<'a>,
    pub bytes: f64,
    pub share: f64,
}

/// The best other coder at each of [`LEVELS`] that the reference and another coder reach; only for some modes.
pub fn best_others<'a>(rows: &[Row<'a>], modes: &[Mode]) -> Vec<Best<'a>> {
    let Some(reference) = rows.iter().find(|row| row.curve.is_reference()) else { return vec![] };
    let others = || {
        let others = rows.iter().filter(|row| !row.curve.is_own());
        others.filter(|row| modes.contains(&row.curve.mode))
    };
    let best = |(level, &psnr): (usize, &f64)| {
        let bytes = others().filter_map(|row| Some((row.curve, row.bytes[level]?)));
        let (curve, bytes) = bytes.min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Best { psnr, curve, bytes, share: reference.bytes[level]? / bytes })
    };
    LEVELS.iter().enumerate().filter_map(best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::similarity::Similarity;

    fn points(coder: &'static str, input: Input, factor: f64) -> Vec<Point> {
        let point = |psnr: f64| Point {
            coder: coder.into(),
            input,
            mode: Mode::Intra,
            setting: psnr,
            bytes: factor * (0.2 * psnr).exp(),
            psnr,
            similarity: Similarity::default(),
            encode_ms: 0.0,
            decode_ms: 0.0,
        };
        [28.0, 33.5].map(point).to_vec()
    }

    #[test]
    fn the_reference_is_held_against_the_best_other_coder() {
        let mut all = points("wavelet", Input::Difference, 3.0);
        all.extend(points("wavelet", Input::Frame, 1.0));
        all.extend(points("webp", Input::Frame, 6.0));
        all.extend(points("webp", Input::Difference, 4.0));
        let curves = Curve::all(&all);
        let rows = rows(&curves);
        let rates: Vec<_> = rows.iter().map(|row| row.bd_rate).collect();
        assert_eq!(rates[0], None);
        assert!(rates[2].is_some_and(|rate| (rate + 0.5).abs() < 1e-9), "{rates:?}");
        let best = best_others(&rows, &[Mode::Intra]);
        assert!(best_others(&rows, &[Mode::Stream]).is_empty());
        assert_eq!(best.len(), 4, "33.5 dB is the most");
        for best in best {
            assert_eq!(best.curve.name(), "webp, difference, intra");
            assert!((best.share - 0.75).abs() < 1e-9);
        }
    }
}
