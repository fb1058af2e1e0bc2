//! Twin of the stages of `ssim`: the loss of training.

use nvsprior::Picture;
use nvsprior_kernels::training::{SSIM_REACH, SSIM_WEIGHTS};

const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// One channel of a picture, row-major.
struct Plane {
    width: usize,
    values: Vec<f64>,
}

impl Plane {
    fn of(width: u32, values: impl Iterator<Item = f64>) -> Plane {
        Plane { width: width as usize, values: values.collect() }
    }

    fn times(&self, other: &Plane) -> Plane {
        let products = self.values.iter().zip(&other.values).map(|(a, b)| a * b);
        Plane { width: self.width, values: products.collect() }
    }

    /// Blurred by SSIM's window; beyond the picture all is zero.
    fn blurred(&self) -> Vec<f64> {
        let (width, height) = (self.width as isize, (self.values.len() / self.width) as isize);
        let reach = SSIM_REACH as isize;
        let weight = |tap: isize| f64::from(SSIM_WEIGHTS[tap.unsigned_abs()]);
        let at = |x: isize, y: isize| {
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            if inside { self.values[(y * width + x) as usize] } else { 0.0 }
        };
        let sum = |x: isize, y: isize| -> f64 {
            let row = |dy: isize| -> f64 {
                (-reach..=reach).map(|dx| weight(dx) * at(x + dx, y + dy)).sum()
            };
            (-reach..=reach).map(|dy| weight(dy) * row(dy)).sum()
        };
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| sum(x, y)).collect()
    }
}

/// Mean SSIM of a channel (Wang et al. 2004).
fn ssim(render: &Plane, frame: &Plane) -> f64 {
    let (mean_x, mean_y) = (render.blurred(), frame.blurred());
    let squares = [render.times(render), frame.times(frame), render.times(frame)];
    let [xx, yy, xy] = squares.map(|plane| plane.blurred());
    let of = |i: usize| {
        let (x, y) = (mean_x[i], mean_y[i]);
        let (a, b) = (2.0 * x * y + C1, 2.0 * (xy[i] - x * y) + C2);
        let (c, d) = (x * x + y * y + C1, xx[i] - x * x + yy[i] - y * y + C2);
        a * b / (c * d)
    };
    (0..mean_x.len()).map(of).sum::<f64>() / mean_x.len() as f64
}

/// Huber's loss (1964): the absolute value less half the knee, below the knee the square over two knees.
fn huber(difference: f64, knee: f64) -> f64 {
    let size = difference.abs();
    if size < knee { size * size / (2.0 * knee) } else { size - knee / 2.0 }
}

/// `(1 − share) h(render − frame) + share (1 − SSIM)`, means over pixels and channels; values in [0, 1]
/// (Kerbl et al. 2023, eq. 7, with Huber's loss of this knee in the place of the absolute value). Pixels that do not
/// count are 0 in both.
pub fn loss(
    render: &[[f64; 3]],
    frame: &Picture,
    counts: impl Fn(usize) -> bool,
    share: f64,
    knee: f64,
) -> f64 {
    let counted = |(i, value): (usize, f64)| if counts(i) { value } else { 0.0 };
    let channel = |c: usize| {
        let x = render.iter().map(|pixel| pixel[c]);
        let x = Plane::of(frame.width, x.enumerate().map(counted));
        let y = frame.data.iter().skip(c).step_by(3).map(|byte| f64::from(*byte) / 255.0);
        let y = Plane::of(frame.width, y.enumerate().map(counted));
        let differences = x.values.iter().zip(&y.values).map(|(x, y)| huber(x - y, knee));
        let error = differences.sum::<f64>() / x.values.len() as f64;
        (1.0 - share) * error + share * (1.0 - ssim(&x, &y))
    };
    (0..3).map(channel).sum::<f64>() / 3.0
}
