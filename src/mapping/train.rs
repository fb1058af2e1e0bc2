//! Gradient steps on everything a splat has: place, shape, opacity and colours.
//!
//! Adam (Kingma and Ba, 2015) on the squared error of a few views at a time. The steps of a
//! position are measured in the splat's own size, so that fine and coarse regions move alike.

use glam::{Quat, Vec3};
use rayon::prelude::*;

use super::harmonics;
use super::project::{Geometry, Projector};
use super::raster::Projection;
use super::{MappingOptions, View};
use crate::prior::Splats;

/// Views per step.
const BATCH: usize = 2;
/// Parameters of a splat: position, log-scales, turn, opacity logit, and up to four triples of
/// spherical harmonics.
const PARAMETERS: usize = 3 + 3 + 3 + 1 + 12;
const DECAY: [f32; 2] = [0.9, 0.99];
/// Keeps steps small where derivatives are in the noise.
const EPSILON: f32 = 1e-3;

type Parameters = [f32; PARAMETERS];

/// Rates at the first step: of position (shares of the splat's size), log-scales, turn (radians),
/// opacity logit and colours.
const RATES: [f32; 5] = [0.03, 0.015, 0.01, 0.04, 0.006];

/// The rate of a parameter at the first step.
fn rate_of(parameter: usize) -> f32 {
    RATES[(parameter / 3).min(3) + usize::from(parameter >= 10)]
}

/// Running means of the derivatives and of their squares.
#[derive(Clone, Copy)]
struct Moments {
    first: Parameters,
    second: Parameters,
    steps: i32,
}

/// Improves splats by `options.steps` steps; `done` is told after each.
pub fn train(
    splats: &mut Splats,
    views: &[View],
    options: &MappingOptions,
    done: &mut dyn FnMut(),
) {
    let count = splats.positions.len();
    let zero = Moments { first: [0.0; PARAMETERS], second: [0.0; PARAMETERS], steps: 0 };
    let mut moments = vec![zero; count];
    let stride = coprime_stride(views.len());
    for step in 0..options.steps {
        let geometry = Geometry::of(splats);
        let batch: Vec<&View> = (0..BATCH)
            .map(|i| &views[(step as usize * BATCH + i) * stride % views.len()])
            .collect();
        let derivatives: Vec<Vec<Parameters>> = batch
            .into_par_iter()
            .map(|view| derivatives(splats, &geometry, view, options))
            .collect();
        // From the full rate to a tenth of it, geometrically.
        let rate = 0.1f32.powf(step as f32 / options.steps as f32);
        for (index, moments) in moments.iter_mut().enumerate() {
            let mut sum = [0.0; PARAMETERS];
            for view in &derivatives {
                sum = std::array::from_fn(|k| sum[k] + view[index][k]);
            }
            // Splats out of view stay where they are.
            if sum.iter().any(|d| *d != 0.0) {
                let change = moments.step(&sum, rate);
                apply(splats, index, &change);
            }
        }
        done();
    }
}

impl Moments {
    fn step(&mut self, derivatives: &Parameters, rate: f32) -> Parameters {
        self.steps += 1;
        let unbias = DECAY.map(|d| 1.0 / (1.0 - d.powi(self.steps)));
        std::array::from_fn(|k| {
            let d = derivatives[k];
            self.first[k] += (1.0 - DECAY[0]) * (d - self.first[k]);
            self.second[k] += (1.0 - DECAY[1]) * (d * d - self.second[k]);
            let spread = (self.second[k] * unbias[1]).sqrt();
            -rate * rate_of(k) * self.first[k] * unbias[0] / (spread + EPSILON)
        })
    }
}

/// A splat's size: the mean of its two longest standard deviations, geometrically.
fn size(splats: &Splats, index: usize) -> f32 {
    let s = splats.log_scales[index];
    let shortest = s[0].min(s[1]).min(s[2]);
    ((s.iter().sum::<f32>() - shortest) / 2.0).exp()
}

fn apply(splats: &mut Splats, index: usize, change: &Parameters) {
    let size = size(splats, index);
    for k in 0..3 {
        splats.positions[index][k] += size * change[k];
        splats.log_scales[index][k] += change[3 + k];
    }
    let [w, x, y, z] = splats.rotations[index];
    let turn = Quat::from_scaled_axis(Vec3::from_slice(&change[6..9]));
    let q = (turn * Quat::from_xyzw(x, y, z, w)).normalize();
    splats.rotations[index] = [q.w, q.x, q.y, q.z];
    splats.opacity_logits[index] += change[9];
    let terms = 3 * harmonics::count(splats.sh_degree);
    let own = &mut splats.sh[index * terms..(index + 1) * terms];
    for (coefficient, change) in std::iter::zip(own, &change[10..]) {
        *coefficient += change;
    }
}

/// Derivatives of a view's squared error by all parameters of all splats.
fn derivatives(
    splats: &Splats,
    geometry: &Geometry,
    view: &View,
    options: &MappingOptions,
) -> Vec<Parameters> {
    let render = &options.render;
    let colours = harmonics::colours(splats, view.pose.centre().as_vec3());
    let projection = Projection::new(geometry, &view.camera, &view.pose, render);
    let projector = Projector::new(&view.camera, &view.pose, render);
    let pull = |pixel, value| 2.0 * (value - view.colour(pixel));
    let by_image = projection.backward(&colours, Vec3::from(render.background), pull);
    let mut all = vec![[0.0; PARAMETERS]; geometry.positions.len()];
    for (splat, g) in std::iter::zip(projection.splats(), &by_image) {
        let index = splat.index as usize;
        let shape = projector.pull_back(geometry, splat, g.mean, g.conic);
        let position = size(splats, index) * shape.position;
        let own = &mut all[index];
        own[..3].copy_from_slice(&position.to_array());
        own[3..6].copy_from_slice(&shape.log_scale.to_array());
        own[6..9].copy_from_slice(&shape.turn.to_array());
        own[9] = g.opacity_logit;
        let direction = geometry.positions[index] - view.pose.centre().as_vec3();
        let basis = harmonics::basis(direction.normalize_or_zero());
        for (term, b) in basis[..harmonics::count(splats.sh_degree)].iter().enumerate() {
            own[10 + 3 * term..13 + 3 * term].copy_from_slice(&(g.colour * *b).to_array());
        }
    }
    all
}

/// A stride that visits all of `count` views before it comes back, far from its neighbours: near
/// the golden section, with no common factor.
fn coprime_stride(count: usize) -> usize {
    let gcd = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let golden = (count as f64 * 0.618) as usize;
    (golden.max(1)..=count).find(|s| gcd(*s, count) == 1).unwrap_or(1)
}
