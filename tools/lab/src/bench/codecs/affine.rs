//! The paper's affine baseline: the render warped onto the frame, in place of a search for the pose.

use nvsprior::Picture;

use super::run::{Beside, Run};
use crate::bench::forward::timed_value;

/// Names of the baseline as the paper has it, at the poses of an estimator: with WebP, with JPEG XL.
pub const ESTIMATED: [&str; 2] = ["affine-webp", "affine-jpeg-xl"];
/// Its name at the poses found, with WebP.
pub const FOUND: &str = "found-affine-webp";

/// Bytes of a warp: six numbers as f32.
const BYTES: f64 = 24.0;
const N: usize = 6;
/// The coarsest picture of the fit has at least this many pixels on a side.
const MIN_SIDE: usize = 12;
/// Most steps of a level.
const MAX_STEPS: u32 = 30;
/// A step that gains less than this share of the error is the last.
const MIN_GAIN: f64 = 1e-5;
/// Damping at first, and at which a level ends.
const DAMPING: (f64, f64) = (1e-3, 1e4);

/// The run with each render warped onto its frame; the warp is counted beside what a frame took already.
pub fn warped(run: &Run) -> Run {
    let before = run.beside;
    let (mut renders, mut beside) = (Vec::new(), Beside { bytes: before.bytes + BYTES, ..before });
    let share = 1.0 / run.frames.len() as f64;
    for (frame, render) in run.frames.iter().zip(&run.renders) {
        let (warp, ms) = timed_value(|| Warp::fit(render, frame));
        beside.encode_ms += share * ms;
        let (warped, ms) = timed_value(|| warp.apply(render));
        beside.decode_ms += share * ms;
        renders.push(warped);
    }
    Run::new(run.frames.clone(), renders, beside)
}

/// The source of a pixel of the warped picture: `x' = a·x + b·y + c`, `y' = d·x + e·y + f`, from the picture's centre,
/// in units of its width.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Warp([f64; N]);

impl Warp {
    const IDENTITY: Warp = Warp([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);

    /// The warp, as it is sent, that brings a render's luma nearest to a frame's; the identity if none is nearer.
    fn fit(render: &Picture, frame: &Picture) -> Warp {
        let (renders, frames) = (Plane::pyramid(render), Plane::pyramid(frame));
        let levels = || renders.iter().zip(&frames);
        let mut warp = Warp::IDENTITY;
        for (render, frame) in levels().rev() {
            warp = descend(warp, render, frame);
        }
        let sent = Warp(warp.0.map(|value| f64::from(value as f32)));
        let better = levels().next().is_some_and(|(render, frame)| {
            error(&sent, render, frame) < error(&Warp::IDENTITY, render, frame)
        });
        if better { sent } else { Warp::IDENTITY }
    }

    /// Source of a point.
    fn source(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [a, b, c, d, e, f] = self.0;
        [a * x + b * y + c, d * x + e * y + f]
    }

    /// Warps a picture by bilinear interpolation. Outside it repeats its border.
    fn apply(&self, picture: &Picture) -> Picture {
        let planes: [Plane; 3] = std::array::from_fn(|channel| Plane::of(picture, |p| p[channel]));
        let mut warped = picture.clone();
        let into = warped.data.as_chunks_mut::<3>().0;
        for (to, at) in into.iter_mut().zip(planes[0].points()) {
            let source = planes[0].pixel(self.source(at));
            *to = std::array::from_fn(|channel| planes[channel].at(source).round() as u8);
        }
        warped
    }
}

/// One channel of a picture, or of a reduced one.
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f64>,
    /// Width of the full picture and its height, in this plane's pixels.
    full: [f64; 2],
}

impl Plane {
    fn of(picture: &Picture, value: impl Fn(&[f64; 3]) -> f64) -> Plane {
        let pixels = picture.data.as_chunks::<3>().0.iter();
        Plane {
            width: picture.width as usize,
            height: picture.height as usize,
            values: pixels.map(|rgb| value(&rgb.map(f64::from))).collect(),
            full: [f64::from(picture.width), f64::from(picture.height)],
        }
    }

    /// Luma (BT.601), and its reductions by two, finest first.
    fn pyramid(picture: &Picture) -> Vec<Plane> {
        let luma = Plane::of(picture, |[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b);
        let next = |plane: &Plane| {
            let enough = plane.width.min(plane.height) >= 2 * MIN_SIDE;
            enough.then(|| plane.half())
        };
        std::iter::successors(Some(luma), next).collect()
    }

    /// Means of 2×2 pixels; an odd row or column is left out.
    fn half(&self) -> Plane {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let mean =
            |x: usize, y: usize| (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) / 4.0;
        let values = (0..height * width).map(|i| mean(2 * (i % width), 2 * (i / width))).collect();
        Plane { width, height, values, full: self.full.map(|side| side / 2.0) }
    }

    /// The pixels' centres, row by row, as a warp has them.
    fn points(&self) -> impl Iterator<Item = [f64; 2]> {
        let [across, down] = self.full;
        (0..self.width * self.height).map(move |i| {
            let (x, y) = ((i % self.width) as f64 + 0.5, (i / self.width) as f64 + 0.5);
            [(x - across / 2.0) / across, (y - down / 2.0) / across]
        })
    }

    /// A warp's point in pixels; a pixel's centre has whole numbers.
    fn pixel(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [across, down] = self.full;
        [x * across + across / 2.0 - 0.5, y * across + down / 2.0 - 0.5]
    }

    /// The value between pixels.
    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        let (x, left) = split(x, self.width);
        let (y, top) = split(y, self.height);
        let (right, below) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let row = |row: usize| {
            let row = &self.values[row * self.width..][..self.width];
            row[left] + x * (row[right] - row[left])
        };
        row(top) + y * (row(below) - row(top))
    }

    /// How the value changes, per pixel across and down.
    fn slope(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let across = self.at([x + 0.5, y]) - self.at([x - 0.5, y]);
        [across, self.at([x, y + 0.5]) - self.at([x, y - 0.5])]
    }
}

/// A coordinate as a pixel and what is left, within the picture.
fn split(value: f64, length: usize) -> (f64, usize) {
    let within = value.max(0.0).min((length - 1) as f64);
    (within.fract(), within as usize)
}

/// Sum of squares of what is left after a warp.
fn error(warp: &Warp, render: &Plane, frame: &Plane) -> f64 {
    let values = frame.points().zip(&frame.values);
    values.map(|(at, value)| (render.at(render.pixel(warp.source(at))) - value).powi(2)).sum()
}

/// Damped Gauss–Newton on one level.
fn descend(mut warp: Warp, render: &Plane, frame: &Plane) -> Warp {
    let (mut damping, last) = DAMPING;
    let mut before = error(&warp, render, frame);
    for _ in 0..MAX_STEPS {
        let (normal, slope) = equations(&warp, render, frame);
        let mut gain = None;
        while gain.is_none() && damping < last {
            let next = solve(normal, slope, damping)
                .map(|step| Warp(std::array::from_fn(|i| warp.0[i] - step[i])));
            let after = next.map_or(f64::INFINITY, |next| error(&next, render, frame));
            match next.filter(|_| after < before) {
                Some(next) => {
                    gain = Some((before - after) / before);
                    (warp, before) = (next, after);
                    damping *= 0.2;
                }
                None => damping *= 5.0,
            }
        }
        if gain.is_none_or(|gain| gain < MIN_GAIN) {
            break;
        }
    }
    warp
}

/// JᵀJ and Jᵀr of a warp.
fn equations(warp: &Warp, render: &Plane, frame: &Plane) -> ([[f64; N]; N], [f64; N]) {
    let (mut normal, mut slope) = ([[0.0; N]; N], [0.0; N]);
    for (at @ [x, y], value) in frame.points().zip(&frame.values) {
        let source = render.pixel(warp.source(at));
        let left = render.at(source) - value;
        let [across, down] = render.slope(source).map(|v| v * render.full[0]);
        let row = [across * x, across * y, across, down * x, down * y, down];
        for i in 0..N {
            slope[i] += row[i] * left;
            for j in 0..N {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    (normal, slope)
}

/// Solves `(JᵀJ + damping · diag JᵀJ) step = Jᵀr` by elimination; `None` if the picture does not determine it.
fn solve(mut normal: [[f64; N]; N], mut right: [f64; N], damping: f64) -> Option<[f64; N]> {
    for (i, row) in normal.iter_mut().enumerate() {
        row[i] *= 1.0 + damping;
    }
    for i in 0..N {
        let (above, pivot) = (normal[i], normal[i][i]);
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        for row in i + 1..N {
            let factor = normal[row][i] / pivot;
            for (value, above) in normal[row].iter_mut().zip(above) {
                *value -= factor * above;
            }
            right[row] -= factor * right[i];
        }
    }
    for i in (0..N).rev() {
        let rest: f64 = (i + 1..N).map(|j| normal[i][j] * right[j]).sum();
        right[i] = (right[i] - rest) / normal[i][i];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Soft waves, in three colours.
    fn waves(width: u32, height: u32) -> Picture {
        let value = |x: f64, y: f64, c: f64| {
            128.0
                + 50.0 * (0.11 * x + c).sin() * (0.13 * y).cos()
                + 40.0 * (0.05 * (x + 2.0 * y)).sin()
        };
        let rgb = (0..width * height).flat_map(|i| {
            let (x, y) = (f64::from(i % width), f64::from(i / width));
            [0.0, 0.3, 0.6].map(|c| value(x, y, c) as u8)
        });
        Picture::from_rgb(width, height, rgb.collect()).expect("its size")
    }

    #[test]
    fn a_warp_is_found_again() {
        let render = waves(160, 90);
        let warp = Warp([1.03, 0.04, 0.03, -0.03, 0.98, -0.02]);
        let frame = warp.apply(&render);
        let found = Warp::fit(&render, &frame);
        for (found, made) in found.0.iter().zip(warp.0) {
            assert!((found - made).abs() < 2e-3, "{found} for {made}");
        }
        assert!(frame.psnr(&found.apply(&render)) > frame.psnr(&render) + 10.0);
    }

    #[test]
    fn where_nothing_helps_the_render_stays_as_it_is() {
        let mut flat = Picture::new(64, 48);
        flat.data.fill(90);
        let frame = waves(64, 48);
        assert_eq!(Warp::fit(&flat, &frame), Warp::IDENTITY);
        assert_eq!(Warp::fit(&frame, &frame), Warp::IDENTITY);
        assert_eq!(Warp::IDENTITY.apply(&frame), frame);
    }
}
