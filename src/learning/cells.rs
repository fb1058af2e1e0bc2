//! Where a frame differs from the render: cells of the picture, and the splats that begin there.

use glam::DVec3;

use crate::Picture;

use super::blur::blurred;
use super::key_frame::KeyFrame;
use super::sweep::sweep;

/// Side of a cell, pixels of a picture 320 wide.
const CELL: usize = 8;
/// Mean difference of a cell from which on it gets a splat, of 255.
const DIFFERENT: f32 = 14.0;
/// More than this counts as this: one bright line is no object.
const MOST: f32 = 60.0;
/// Standard deviation of a first splat across the ray, in sides of its cell.
const SPREAD: f64 = 0.45;

/// How much longer a first splat is along the ray than across. What is new has a depth: its sides show once the camera
/// has moved.
const DEPTH: f64 = 2.0;

/// A splat as it begins: of one colour, longer along the ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    pub position: DVec3,
    /// Red, green, blue, 0 to 1.
    pub colour: [f32; 3],
    /// Standard deviations across the ray and along it, the prior's unit.
    pub sizes: [f64; 2],
    /// Direction of the ray, a unit vector.
    pub ray: DVec3,
}

impl Start {
    /// Of a surface at a point that is seen from `eye`: what it shows lies at the splat's near end.
    fn behind(surface: DVec3, eye: DVec3, colour: [f32; 3], across: f64) -> Start {
        let (ray, along) = ((surface - eye).normalize(), DEPTH * across);
        Start { position: surface + (along - across) * ray, colour, sizes: [across, along], ray }
    }
}

/// What the scene shows at a key frame's pose.
pub struct Shown {
    pub render: Picture,
    /// Depths of the render's pixels.
    pub depths: Vec<f32>,
}

/// Adds a splat to `starts` for each cell in which a frame differs from its render, unless one shows there already.
/// There will be `most` of them at most.
pub fn add_starts(
    key: &KeyFrame,
    shown: &Shown,
    others: &[&KeyFrame],
    most: usize,
    starts: &mut Vec<Start>,
) {
    let camera = &key.camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let cell = (CELL * width / 320).max(4);
    let across = width.div_ceil(cell);
    let mut covered = vec![false; across * height.div_ceil(cell)];
    for start in starts.iter() {
        if let Some([x, y]) = key.pixel_of(start.position) {
            covered[y / cell * across + x / cell] = true;
        }
    }
    let difference = differences(key, shown);
    for (index, _) in covered.iter().enumerate().filter(|(_, covered)| !**covered) {
        if starts.len() >= most {
            return;
        }
        let (left, top) = (index % across * cell, index / across * cell);
        let (columns, rows) = (left..(left + cell).min(width), top..(top + cell).min(height));
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| [x, y]));
        if let Some([x, y]) = middle(pixels, |[x, y]| difference[y * width + x]) {
            let depth = f64::from(shown.depths[y * width + x]);
            let found = (depth > 0.0).then(|| sweep(key, [x, y], depth, others)).flatten();
            let colour = key.blurred[y * width + x].map(|value| value / 255.0);
            starts.extend(found.map(|(surface, z)| {
                let across = SPREAD * cell as f64 * z / f64::from(camera.fx);
                Start::behind(surface, key.pose.centre(), colour, across)
            }));
        }
    }
}

/// How much each pixel differs, in the channel that differs most; 0 if it does not count.
fn differences(key: &KeyFrame, shown: &Shown) -> Vec<f32> {
    let render = blurred(&shown.render);
    let pairs = key.blurred.iter().zip(&render).enumerate();
    pairs
        .map(|(pixel, (a, b))| {
            let off = |c: usize| (a[c] - b[c]).abs();
            let most = off(0).max(off(1)).max(off(2));
            if key.counts(pixel) { most.min(MOST) } else { 0.0 }
        })
        .collect()
}

/// The middle of what differs in a cell; `None` if that is too little.
fn middle(
    pixels: impl Iterator<Item = [usize; 2]>,
    difference: impl Fn([usize; 2]) -> f32,
) -> Option<[usize; 2]> {
    let (mut sum, mut along, mut count) = (0.0, [0.0; 2], 0.0);
    for [x, y] in pixels {
        let weight = difference([x, y]);
        sum += weight;
        along = [along[0] + weight * x as f32, along[1] + weight * y as f32];
        count += 1.0;
    }
    (sum >= DIFFERENT * count).then(|| along.map(|v| (v / sum).round() as usize))
}
