//! A coder at one setting.

use std::borrow::Cow;

use serde::Serialize;

use crate::bench::similarity::Similarity;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Input {
    Frame,
    /// The frame less the prior's render.
    Difference,
}

impl Input {
    pub fn name(self) -> &'static str {
        match self {
            Input::Frame => "frame",
            Input::Difference => "difference",
        }
    }
}

/// Whether a picture is predicted from those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    Intra,
    /// It does; nothing waits for pictures to come.
    Stream,
}

impl Mode {
    pub fn name(self) -> &'static str {
        match self {
            Mode::Intra => "intra",
            Mode::Stream => "stream",
        }
    }
}

/// Means per frame.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    pub coder: Cow<'static, str>,
    pub input: Input,
    pub mode: Mode,
    pub setting: f64,
    /// Of a difference picture, what a steady packet adds included.
    pub bytes: f64,
    /// Of what the topside shows, dB.
    pub psnr: f64,
    /// Of the same.
    #[serde(flatten)]
    pub similarity: Similarity,
    pub encode_ms: f64,
    pub decode_ms: f64,
}

/// How many more bytes one curve takes than another at the same PSNR, as a share, averaged over the PSNRs that both
/// reach (Bjøntegaard 2001, with straight lines between the points' logarithms); `None` if they share none.
pub fn bd_rate(curve: &[&Point], anchor: &[&Point]) -> Option<f64> {
    let (curve, anchor) = (line(curve), line(anchor));
    let low = curve.first()?.0.max(anchor.first()?.0);
    let high = curve.last()?.0.min(anchor.last()?.0);
    const STEPS: u32 = 200;
    let at = |i: u32| low + (high - low) * (f64::from(i) + 0.5) / f64::from(STEPS);
    let ratio = |i: u32| log_bytes(&curve, at(i)) - log_bytes(&anchor, at(i));
    let mean = (0..STEPS).map(ratio).sum::<f64>() / f64::from(STEPS);
    (high > low).then(|| mean.exp() - 1.0)
}

/// Bytes at a PSNR, on straight lines between the points' logarithms; `None` beyond the points.
pub fn bytes_at(curve: &[&Point], psnr: f64) -> Option<f64> {
    let line = line(curve);
    let (low, high) = (line.first()?.0, line.last()?.0);
    (line.len() > 1 && (low..=high).contains(&psnr)).then(|| log_bytes(&line, psnr).exp())
}

/// What a curve has `of` its points where they are `at`, on straight lines between the points; `None` beyond these.
pub fn value_at(
    curve: &[&Point],
    at: impl Fn(&Point) -> f64,
    of: impl Fn(&Point) -> Option<f64>,
    place: f64,
) -> Option<f64> {
    let mut line: Vec<_> = curve.iter().filter_map(|p| Some((at(p), of(p)?))).collect();
    line.retain(|(at, value)| at.is_finite() && value.is_finite());
    line.sort_by(|a, b| a.0.total_cmp(&b.0));
    let after = line.partition_point(|p| p.0 < place).max(1);
    let ((x0, y0), (x1, y1)) = (*line.get(after - 1)?, *line.get(after)?);
    (x0 <= place).then(|| y0 + (y1 - y0) * (place - x0) / (x1 - x0).max(1e-12))
}

/// PSNR and logarithm of bytes, in the order of PSNR.
fn line(points: &[&Point]) -> Vec<(f64, f64)> {
    let valid = points.iter().filter(|p| p.psnr.is_finite() && p.bytes > 0.0);
    let mut line: Vec<_> = valid.map(|p| (p.psnr, p.bytes.ln())).collect();
    line.sort_by(|a, b| a.0.total_cmp(&b.0));
    line
}

fn log_bytes(line: &[(f64, f64)], psnr: f64) -> f64 {
    let after = line.partition_point(|p| p.0 < psnr).clamp(1, line.len() - 1);
    let ((x0, y0), (x1, y1)) = (line[after - 1], line[after]);
    y0 + (y1 - y0) * (psnr - x0) / (x1 - x0).max(1e-12)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(factor: f64) -> Vec<Point> {
        let point = |psnr: f64| Point {
            coder: "test".into(),
            input: Input::Frame,
            mode: Mode::Intra,
            setting: psnr,
            bytes: factor * (0.2 * psnr).exp(),
            psnr,
            similarity: Similarity::default(),
            encode_ms: 0.0,
            decode_ms: 0.0,
        };
        [36.0, 28.0, 31.0, 33.5].map(point).to_vec()
    }

    #[test]
    fn half_the_bytes_are_minus_fifty_per_cent() {
        let (half, whole) = (curve(0.5), curve(1.0));
        let rate = bd_rate(&half.iter().collect::<Vec<_>>(), &whole.iter().collect::<Vec<_>>());
        assert!((rate.unwrap() + 0.5).abs() < 1e-9, "{rate:?}");
    }

    #[test]
    fn bytes_lie_between_the_points_and_nowhere_else() {
        let curve = curve(2.0);
        let curve: Vec<_> = curve.iter().collect();
        let bytes = bytes_at(&curve, 30.0).expect("28 to 36 dB");
        assert!((bytes - 2.0 * 6.0_f64.exp()).abs() < 1e-6, "{bytes}");
        assert_eq!(bytes_at(&curve, 27.9), None);
        assert_eq!(bytes_at(&curve, 36.1), None);
        assert_eq!(bytes_at(&[], 30.0), None);
    }

    #[test]
    fn curves_that_share_no_quality_have_none() {
        let (low, mut high) = (curve(1.0), curve(1.0));
        high.iter_mut().for_each(|p| p.psnr += 20.0);
        let refs = |curve: &[Point]| curve.to_vec();
        let (low, high) = (refs(&low), refs(&high));
        let rate = bd_rate(&low.iter().collect::<Vec<_>>(), &high.iter().collect::<Vec<_>>());
        assert_eq!(rate, None);
        assert_eq!(bd_rate(&[], &low.iter().collect::<Vec<_>>()), None);
    }
}
