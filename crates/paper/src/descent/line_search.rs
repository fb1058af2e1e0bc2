//! Line search for the strong Wolfe conditions: bracketing and zooming with cubic interpolation
//! (Nocedal & Wright, Numerical Optimization, algorithms 3.5 and 3.6; the constants and safeguards of
//! PyTorch's L-BFGS, which the paper's optimiser calls).

use nvsprior::vulkan::Error;

/// Sufficient decrease.
const C1: f64 = 1e-4;
/// Curvature.
const C2: f64 = 0.9;
const MAX_EVALUATIONS: usize = 25;
/// If a bracket is narrower than this, in the direction's largest component, the search ends.
const BRACKET_TOLERANCE: f64 = 1e-9;

/// A point on the line, with what the caller knows of it.
#[derive(Clone, Copy)]
pub(super) struct Point<P> {
    pub t: f64,
    pub f: f64,
    /// Slope along the line.
    pub slope: f64,
    /// The caller's own.
    pub payload: P,
}

/// Finds a step from `start` (t = 0) that meets the strong Wolfe conditions; tries `t` first. If it finds none, returns
/// the lowest point seen. `extent`: largest component of the direction.
pub(super) fn strong_wolfe<P: Copy>(
    start: Point<P>,
    t: f64,
    extent: f64,
    mut evaluate: impl FnMut(f64) -> Result<Point<P>, Error>,
) -> Result<Point<P>, Error> {
    let mut previous = start;
    let mut point = evaluate(t)?;
    let mut evaluations = 1;
    let bracket = loop {
        let too_high = point.f > start.f + C1 * point.t * start.slope
            || (evaluations > 1 && point.f >= previous.f)
            || !point.f.is_finite();
        if too_high {
            break (previous, point);
        }
        if point.slope.abs() <= -C2 * start.slope {
            return Ok(point);
        }
        if point.slope >= 0.0 {
            break (previous, point);
        }
        if evaluations == MAX_EVALUATIONS {
            return Ok(if point.f < start.f { point } else { start });
        }
        // Extrapolate, at least a little and at most tenfold.
        let (low, high) = (point.t + 0.01 * (point.t - previous.t), point.t * 10.0);
        let next = cubic_minimum(&previous, &point, low, high);
        previous = point;
        point = evaluate(next)?;
        evaluations += 1;
    };
    zoom(start, bracket, extent, evaluations, evaluate)
}

fn zoom<P: Copy>(
    start: Point<P>,
    (a, b): (Point<P>, Point<P>),
    extent: f64,
    mut evaluations: usize,
    mut evaluate: impl FnMut(f64) -> Result<Point<P>, Error>,
) -> Result<Point<P>, Error> {
    let (mut low, mut high) = if a.f <= b.f || b.f.is_nan() { (a, b) } else { (b, a) };
    let mut slow = false;
    while evaluations < MAX_EVALUATIONS {
        let width = (high.t - low.t).abs();
        if !(width * extent >= BRACKET_TOLERANCE) {
            break;
        }
        let (left, right) = (low.t.min(high.t), low.t.max(high.t));
        let mut t = cubic_minimum(&low, &high, left, right);
        // Too near an end twice, or at an end: step inside by a tenth.
        let margin = 0.1 * width;
        if (right - t).min(t - left) < margin {
            if slow || t >= right || t <= left {
                t = if (t - right).abs() < (t - left).abs() {
                    right - margin
                } else {
                    left + margin
                };
                slow = false;
            } else {
                slow = true;
            }
        } else {
            slow = false;
        }
        let point = evaluate(t)?;
        evaluations += 1;
        let too_high = point.f > start.f + C1 * t * start.slope || !(point.f < low.f);
        if too_high {
            high = point;
            if high.f < low.f {
                std::mem::swap(&mut low, &mut high);
            }
            continue;
        }
        if point.slope.abs() <= -C2 * start.slope {
            return Ok(point);
        }
        if point.slope * (high.t - low.t) >= 0.0 {
            high = low;
        }
        low = point;
    }
    Ok(low)
}

/// Minimum of the cubic through two points with slopes, limited to `[low, high]` (Nocedal & Wright,
/// eq. 3.59); the middle if there is no minimum.
fn cubic_minimum<P>(p: &Point<P>, q: &Point<P>, low: f64, high: f64) -> f64 {
    let (a, b) = if p.t <= q.t { (p, q) } else { (q, p) };
    let d1 = a.slope + b.slope - 3.0 * (a.f - b.f) / (a.t - b.t);
    let square = d1 * d1 - a.slope * b.slope;
    if !(square >= 0.0) {
        return 0.5 * (low + high);
    }
    let d2 = square.sqrt();
    let t = b.t - (b.t - a.t) * ((b.slope + d2 - d1) / (b.slope - a.slope + 2.0 * d2));
    if t.is_finite() { t.clamp(low, high) } else { 0.5 * (low + high) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(f: impl Fn(f64) -> f64, d: impl Fn(f64) -> f64, t: f64) -> Point<()> {
        let at = |t: f64| Point { t, f: f(t), slope: d(t), payload: () };
        strong_wolfe(at(0.0), t, 1.0, |t| Ok(at(t))).unwrap()
    }

    #[test]
    fn meets_the_wolfe_conditions() {
        for first in [1e-3, 0.1, 1.0, 50.0] {
            let p = search(
                |t| (t - 2.0).powi(2) + 0.3 * t.sin(),
                |t| 2.0 * (t - 2.0) + 0.3 * t.cos(),
                first,
            );
            let slope = -4.0 + 0.3;
            assert!(p.f <= 4.0 + C1 * p.t * slope && p.slope.abs() <= -C2 * slope, "from {first}");
        }
    }

    #[test]
    fn ends_on_what_has_no_minimum_and_on_nan() {
        assert!(search(|t| -t, |_| -1.0, 1.0).f < 0.0);
        let p = search(|t| if t > 0.0 { f64::NAN } else { 1.0 }, |_| -1.0, 1.0);
        assert_eq!((p.t, p.f), (0.0, 1.0));
    }
}
