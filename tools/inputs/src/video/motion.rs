//! How a frame's picture has moved since another: a similarity, found on small pictures, and how much both have in
//! common.

use super::plane::Plane;

/// A similarity of the picture plane: z becomes m z + t, with complex numbers. Lengths are in widths of the picture,
/// from its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    pub m: [f64; 2],
    pub t: [f64; 2],
}

fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

impl Similarity {
    pub const IDENTITY: Similarity = Similarity { m: [1.0, 0.0], t: [0.0, 0.0] };

    pub fn apply(&self, z: [f64; 2]) -> [f64; 2] {
        let turned = times(self.m, z);
        [turned[0] + self.t[0], turned[1] + self.t[1]]
    }

    /// `self` after `first`.
    pub fn after(&self, first: &Similarity) -> Similarity {
        Similarity { m: times(self.m, first.m), t: self.apply(first.t) }
    }

    pub fn inverse(&self) -> Similarity {
        let square = self.m[0] * self.m[0] + self.m[1] * self.m[1];
        let m = [self.m[0] / square, -self.m[1] / square];
        let t = times(m, self.t);
        Similarity { m, t: [-t[0], -t[1]] }
    }

    /// The share of the larger of two pictures that both show, if the first one's points move so. `aspect`: height by
    /// width.
    pub fn overlap(&self, aspect: f64) -> f64 {
        let half = [0.5, 0.5 * aspect];
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let corner = |of: [f64; 2]| self.apply([of[0] * half[0], of[1] * half[1]]);
        let mut common: Vec<[f64; 2]> = corners.map(corner).into();
        for axis in 0..2 {
            for side in [-1.0, 1.0] {
                common = cut(&common, |p| half[axis] - side * p[axis]);
            }
        }
        let own = aspect * (self.m[0] * self.m[0] + self.m[1] * self.m[1]);
        let overlap = area(&common) / own.max(aspect);
        if overlap.is_finite() { overlap.clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// The part of a convex polygon where `within` is not negative.
fn cut(polygon: &[[f64; 2]], within: impl Fn(&[f64; 2]) -> f64) -> Vec<[f64; 2]> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, p) in polygon.iter().enumerate() {
        let next = &polygon[(i + 1) % polygon.len()];
        let (a, b) = (within(p), within(next));
        if a >= 0.0 {
            kept.push(*p);
        }
        if (a >= 0.0) != (b >= 0.0) {
            let share = a / (a - b);
            kept.push([0, 1].map(|axis| p[axis] + share * (next[axis] - p[axis])));
        }
    }
    kept
}

fn area(polygon: &[[f64; 2]]) -> f64 {
    let pairs = polygon.iter().zip(polygon.iter().cycle().skip(1));
    0.5 * pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>().abs()
}

/// A frame's texture at four sizes, coarse to fine.
#[derive(Clone, Debug)]
pub struct Texture {
    levels: [Plane; 4],
}

/// A motion that was found, and how well the pictures agree under it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aligned {
    pub motion: Similarity,
    /// Correlation of what both show, at most 1.
    pub correlation: f64,
}

/// Radius of the squares that brightness and contrast are levelled over, pixels at each size.
const LEVELLED: [usize; 4] = [4, 5, 7, 9];
/// The size at which two pictures are compared in the end.
const COMPARED: usize = 2;
/// The first search's farthest shift, as a share of each side.
const FARTHEST: f64 = 0.45;
/// Below this correlation a start is thought to be wrong, and all shifts are looked at.
const DOUBTFUL: f64 = 0.6;
/// Least share of the picture that two must have in common to be compared.
const LEAST_COMMON: f64 = 0.1;

impl Texture {
    /// Of a grey picture of about 160 pixels' width.
    pub fn of(plane: &Plane) -> Texture {
        let of = |size: usize| plane.reduced(8 >> size).levelled(LEVELLED[size]);
        Texture { levels: std::array::from_fn(of) }
    }

    /// How this picture's points lie in another, near `start`, else anywhere.
    pub fn align(&self, other: &Texture, start: &Similarity) -> Aligned {
        let near = self.refine(other, start);
        if near.correlation >= DOUBTFUL {
            return near;
        }
        let far = self.refine(other, &self.search(other, start));
        if far.correlation > near.correlation { far } else { near }
    }

    /// The best shift at the coarsest size, with some turns and scales about the start's.
    fn search(&self, other: &Texture, start: &Similarity) -> Similarity {
        const SCALES: [f64; 3] = [0.9, 1.0, 1.1];
        const TURNS: [f64; 3] = [-0.09, 0.0, 0.09];
        let [from, to] = [&self.levels[0], &other.levels[0]];
        let reach = |side: usize| (FARTHEST * side as f64) as i32;
        let pixel = 1.0 / from.width.max(1) as f64;
        let mut best = (f64::NEG_INFINITY, *start);
        let turned = SCALES.into_iter().flat_map(|scale| {
            TURNS.map(|turn: f64| times(start.m, [scale * turn.cos(), scale * turn.sin()]))
        });
        for m in turned {
            for dy in -reach(from.height)..=reach(from.height) {
                for dx in -reach(from.width)..=reach(from.width) {
                    let t = [f64::from(dx) * pixel, f64::from(dy) * pixel];
                    let motion = Similarity { m, t };
                    let (correlation, common) = correlation(from, to, &motion);
                    // Few common pixels agree by chance.
                    let worth = correlation * common.sqrt();
                    if worth > best.0 {
                        best = (worth, motion);
                    }
                }
            }
        }
        best.1
    }

    fn refine(&self, other: &Texture, start: &Similarity) -> Aligned {
        const STEPS: [usize; 4] = [8, 8, 6, 4];
        let mut motion = *start;
        for ((from, to), steps) in self.levels.iter().zip(&other.levels).zip(STEPS) {
            for _ in 0..steps {
                let Some((better, moved)) = step(from, to, &motion) else { break };
                motion = better;
                // A tenth of a pixel.
                if moved * (from.width as f64) < 0.1 {
                    break;
                }
            }
        }
        let (correlation, common) =
            correlation(&self.levels[COMPARED], &other.levels[COMPARED], &motion);
        let sane = (0.2..5.0).contains(&motion.m[0].hypot(motion.m[1]));
        let correlation = if common >= LEAST_COMMON && sane { correlation } else { 0.0 };
        Aligned { motion, correlation }
    }
}

/// A motion in a plane's pixels: x becomes a x − b y + u, y becomes b x + a y + v.
struct Pixels {
    a: f32,
    b: f32,
    u: f32,
    v: f32,
}

impl Pixels {
    fn of(motion: &Similarity, plane: &Plane) -> Pixels {
        // Pixel centres lie at whole numbers here.
        let (width, height) = (plane.width as f64, plane.height as f64);
        let middle = [0.5 * (width - 1.0), 0.5 * (height - 1.0)];
        let turned = times(motion.m, middle);
        let u = middle[0] + motion.t[0] * width - turned[0];
        let v = middle[1] + motion.t[1] * width - turned[1];
        Pixels { a: motion.m[0] as f32, b: motion.m[1] as f32, u: u as f32, v: v as f32 }
    }

    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        (self.a * x - self.b * y + self.u, self.b * x + self.a * y + self.v)
    }
}

/// The value between four pixels, and its slopes; `None` outside.
fn sample(plane: &Plane, x: f32, y: f32) -> Option<[f32; 3]> {
    let (right, low) = (plane.width as f32 - 1.0, plane.height as f32 - 1.0);
    // So that NaN is outside.
    if !(x >= 0.0 && x < right && y >= 0.0 && y < low) {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (fx, fy) = (x - column as f32, y - row as f32);
    let at = row * plane.width + column;
    let [a, b] = [plane.data[at], plane.data[at + 1]];
    let [c, d] = [plane.data[at + plane.width], plane.data[at + plane.width + 1]];
    let (above, below) = (a + fx * (b - a), c + fx * (d - c));
    let dx = (b - a) + fy * ((d - c) - (b - a));
    Some([above + fy * (below - above), dx, below - above])
}

/// Correlation of what both show, and its share of the picture.
fn correlation(from: &Plane, to: &Plane, motion: &Similarity) -> (f64, f64) {
    let pixels = Pixels::of(motion, from);
    let (mut ab, mut aa, mut bb, mut count) = (0.0f64, 0.0f64, 0.0f64, 0usize);
    for (y, row) in from.data.chunks_exact(from.width.max(1)).enumerate() {
        let (mut row_ab, mut row_aa, mut row_bb) = (0.0f32, 0.0f32, 0.0f32);
        for (x, a) in row.iter().enumerate() {
            let (px, py) = pixels.place(x as f32, y as f32);
            let Some([b, ..]) = sample(to, px, py) else { continue };
            row_ab += a * b;
            row_aa += a * a;
            row_bb += b * b;
            count += 1;
        }
        ab += f64::from(row_ab);
        aa += f64::from(row_aa);
        bb += f64::from(row_bb);
    }
    // Where there is no texture, nothing agrees.
    let correlation = ab / (aa * bb).sqrt().max(1e-9 + 1e-4 * count as f64);
    (correlation, count as f64 / from.data.len() as f64)
}

/// A step of Gauss and Newton, with weights that let what moves otherwise count little. The better motion, and how far
/// a corner of the picture moves by it, in widths. `None`: too little is common, or nothing to go by.
fn step(from: &Plane, to: &Plane, motion: &Similarity) -> Option<(Similarity, f64)> {
    /// The difference, in contrasts, that counts half.
    const OUTLIER: f32 = 0.7;
    let pixels = Pixels::of(motion, from);
    let scale = 1.0 / from.width as f32;
    let (middle_x, middle_y) = (0.5 * (from.width - 1) as f32, 0.5 * (from.height - 1) as f32);
    let mut normal = [[0.0f64; 5]; 4];
    let mut count = 0usize;
    for (y, row) in from.data.chunks_exact(from.width.max(1)).enumerate() {
        let mut sums = [[0.0f32; 5]; 4];
        for (x, value) in row.iter().enumerate() {
            let (px, py) = pixels.place(x as f32, y as f32);
            let Some([seen, dx, dy]) = sample(to, px, py) else { continue };
            let (zx, zy) = ((x as f32 - middle_x) * scale, (y as f32 - middle_y) * scale);
            let difference = value - seen;
            let ratio = difference / OUTLIER;
            let weight = 1.0 / (1.0 + ratio * ratio);
            // By m's real and imaginary part, and by t; slopes a width.
            let slopes = [dx * zx + dy * zy, dy * zx - dx * zy, dx, dy];
            for i in 0..4 {
                let weighted = weight * slopes[i];
                for j in i..4 {
                    sums[i][j] += weighted * slopes[j];
                }
                sums[i][4] += weighted * difference;
            }
            count += 1;
        }
        for (all, own) in normal.iter_mut().flatten().zip(sums.iter().flatten()) {
            *all += f64::from(*own);
        }
    }
    if (count as f64) < LEAST_COMMON * from.data.len() as f64 {
        return None;
    }
    let [m0, m1, t0, t1] = solve(normal)?.map(|value| value * f64::from(scale));
    let better = Similarity {
        m: [motion.m[0] + m0, motion.m[1] + m1],
        t: [motion.t[0] + t0, motion.t[1] + t1],
    };
    let moved = t0.hypot(t1) + 0.5 * m0.hypot(m1);
    (moved.is_finite() && moved < 0.5).then_some((better, moved))
}

/// Solves symmetric equations whose upper half and right side are given.
fn solve(mut rows: [[f64; 5]; 4]) -> Option<[f64; 4]> {
    let upper = rows;
    for (i, row) in rows.iter_mut().enumerate() {
        row.iter_mut().zip(&upper).take(i).for_each(|(value, above)| *value = above[i]);
    }
    let trace: f64 = (0..4).map(|i| rows[i][i]).sum();
    for (i, row) in rows.iter_mut().enumerate() {
        row[i] += 1e-6 * trace + 1e-9;
    }
    for i in 0..4 {
        let pivot = rows[i][i];
        // So that NaN fails.
        if !(pivot > 1e-12 * trace) {
            return None;
        }
        for k in i + 1..4 {
            let share = rows[k][i] / pivot;
            let (above, below) = rows.split_at_mut(k);
            below[0].iter_mut().zip(&above[i]).for_each(|(to, from)| *to -= share * from);
        }
    }
    let mut solution = [0.0; 4];
    for i in (0..4).rev() {
        let known: f64 = (i + 1..4).map(|j| rows[i][j] * solution[j]).sum();
        solution[i] = (rows[i][4] - known) / rows[i][i];
    }
    Some(solution)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A smooth random scene without end, in widths of a picture.
    pub fn scene(x: f64, y: f64) -> f64 {
        let hash = |i: i64, j: i64, k: i64| {
            let mut h = (i.wrapping_mul(0x9E37_79B9) ^ j.wrapping_mul(0x85EB_CA6B) ^ k) as u64;
            h = (h ^ (h >> 15)).wrapping_mul(0x2545_F491_4F6C_DD1D);
            (h >> 40) as f64 / (1u64 << 24) as f64
        };
        let mut value = 0.0;
        for (octave, cells) in [6.0, 14.0, 33.0, 75.0].into_iter().enumerate() {
            let (px, py) = (x * cells, y * cells);
            let (i, j) = (px.floor(), py.floor());
            let smooth = |f: f64| f * f * (3.0 - 2.0 * f);
            let (fx, fy) = (smooth(px - i), smooth(py - j));
            let at = |di: i64, dj: i64| hash(i as i64 + di, j as i64 + dj, octave as i64);
            let row = |dj| at(0, dj) + fx * (at(1, dj) - at(0, dj));
            value += row(0) + fy * (row(1) - row(0));
        }
        255.0 * value / 4.0
    }

    /// The scene as a camera shows it, whose picture's points lie at `view` of them.
    pub fn shown(view: &Similarity) -> Plane {
        let (width, height) = (160, 90);
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f64 - 79.5, (i / width) as f64 - 44.5);
            let [x, y] = view.apply([x / 160.0, y / 160.0]);
            scene(x, y) as f32
        };
        Plane { width, height, data: (0..width * height).map(pixel).collect() }
    }

    const ASPECT: f64 = 90.0 / 160.0;

    fn similarity(scale: f64, degrees: f64, t: [f64; 2]) -> Similarity {
        let (sin, cos) = f64::to_radians(degrees).sin_cos();
        Similarity { m: [scale * cos, scale * sin], t }
    }

    #[test]
    fn similarities_have_inverses() {
        let a = similarity(1.2, 30.0, [0.3, -0.1]);
        let Similarity { m, t } = a.inverse().after(&a);
        assert!((m[0] - 1.0).abs() < 1e-12 && m[1].abs() < 1e-12 && t[0].hypot(t[1]) < 1e-12);
    }

    #[test]
    fn overlap_is_the_common_share() {
        let of = |scale, degrees, t| similarity(scale, degrees, t).overlap(ASPECT);
        assert!((of(1.0, 0.0, [0.3, 0.0]) - 0.7).abs() < 1e-9);
        assert!((of(1.0, 0.0, [0.1, -0.1]) - 0.9 * (1.0 - 0.1 / ASPECT)).abs() < 1e-9);
        // Nearer or further: the smaller view lies within the larger one.
        assert!((of(1.25, 0.0, [0.0, 0.0]) - 0.64).abs() < 1e-9);
        assert!((of(0.8, 0.0, [0.0, 0.0]) - 0.64).abs() < 1e-9);
        assert!((of(1.0, 180.0, [0.0, 0.0]) - 1.0).abs() < 1e-9);
        assert!((of(1.0, 90.0, [0.0, 0.0]) - ASPECT).abs() < 1e-9);
        assert_eq!(of(1.0, 0.0, [2.0, 0.0]), 0.0);
        assert_eq!(of(f64::NAN, 0.0, [2.0, 0.0]), 0.0);
    }

    #[test]
    fn known_motions_are_found() {
        let start = similarity(1.0, 0.0, [0.2, 0.1]);
        let from = Texture::of(&shown(&start));
        for (scale, degrees, t) in [
            (1.0, 0.0, [0.0, 0.0]),
            (1.0, 0.0, [0.02, -0.01]),
            (1.0, 0.0, [0.31, 0.0]),
            (1.0, 3.0, [-0.12, 0.1]),
            (1.1, -4.0, [0.03, 0.04]),
            (0.9, 6.0, [0.1, 0.0]),
        ] {
            let motion = similarity(scale, degrees, t);
            // What lies at z in the first picture lies at motion(z) in the second.
            let to = Texture::of(&shown(&start.after(&motion.inverse())));
            let found = from.align(&to, &Similarity::IDENTITY);
            assert!(found.correlation > 0.8, "{motion:?}: {found:?}");
            let off = |z| {
                let ([a, b], [c, d]) = (found.motion.apply(z), motion.apply(z));
                (a - c).hypot(b - d)
            };
            let corner = [0.5, 0.5 * ASPECT];
            assert!(off([0.0, 0.0]) < 0.004 && off(corner) < 0.01, "{motion:?}: {found:?}");
        }
    }

    #[test]
    fn another_scene_does_not_agree() {
        let [a, b] =
            [[0.0, 0.0], [70.0, 30.0]].map(|t| Texture::of(&shown(&similarity(1.0, 0.0, t))));
        let found = a.align(&b, &Similarity::IDENTITY);
        assert!(found.correlation < 0.35, "{found:?}");
        let flat = Texture::of(&Plane { width: 160, height: 90, data: vec![90.0; 160 * 90] });
        assert!(flat.align(&b, &Similarity::IDENTITY).correlation.abs() < 0.2);
        assert!(flat.align(&flat, &Similarity::IDENTITY).correlation.abs() < 0.2);
    }
}
