//! Gradient steps on everything a splat has: place, shape, opacity and colours.
//!
//! Adam (Kingma and Ba, 2015) on the squared error of a few views at a time. The steps of a
//! position are measured in the splat's own size, so that fine and coarse regions move in the same
//! way.

use glam::{Quat, Vec3};
use rayon::prelude::*;

use super::RefitOptions;
use super::harmonics;
use super::project::{Geometry, Projector};
use super::raster::Projection;
use crate::PosedPicture;
use nvsprior::prior::Splats;

/// Views per step.
const BATCH: usize = 2;
/// Parameters of a splat: position, log-scales, turn, opacity logit, and up to four triples of
/// spherical harmonics.
const PARAMETERS: usize = 3 + 3 + 3 + 1 + 12;
const DECAY: [f32; 2] = [0.9, 0.99];
/// Keeps steps small if derivatives are only noise.
const EPSILON: f32 = 1e-3;

type Parameters = [f32; PARAMETERS];

/// Rates at the first step: position (shares of the splat's size), log-scales, turn (radians),
/// opacity logit and colours.
const RATES: [f32; 5] = [0.08, 0.09, 0.03, 0.15, 0.035];

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

/// Improves splats by `options.steps` steps. Calls `done` after each. Bands of spherical harmonics above the first stay
/// as they are.
pub fn train(
    splats: &mut Splats,
    views: &[PosedPicture],
    options: &RefitOptions,
    done: &mut dyn FnMut(),
) {
    let count = splats.positions.len();
    let zero = Moments { first: [0.0; PARAMETERS], second: [0.0; PARAMETERS], steps: 0 };
    let mut moments = vec![zero; count];
    let stride = coprime_stride(views.len());
    for step in 0..options.steps {
        let geometry = Geometry::of(splats);
        let batch: Vec<&PosedPicture> = (0..BATCH)
            .map(|i| &views[(step as usize * BATCH + i) * stride % views.len()])
            .collect();
        let derivatives: Vec<Vec<Parameters>> = batch
            .into_par_iter()
            .map(|view| derivatives(splats, &geometry, view, options))
            .collect();
        // From the full rate to a tenth of it, geometrically.
        let rate = options.pace * 0.1f32.powf(step as f32 / options.steps as f32);
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

/// A splat's size: the geometric mean of its two longest standard deviations.
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
    view: &PosedPicture,
    options: &RefitOptions,
) -> Vec<Parameters> {
    let render = &options.render;
    let colours = harmonics::colours(splats, view.pose.centre().as_vec3());
    let projection = Projection::new(geometry, &view.camera, &view.pose, render);
    let projector = Projector::new(&view.camera, &view.pose, render);
    let pull = |pixel, value| 2.0 * (value - Vec3::from(view.colour(pixel)));
    let by_image = projection.backward(&colours, Vec3::from(render.background), pull);
    let terms = harmonics::count(splats.sh_degree);
    let mut all = vec![[0.0; PARAMETERS]; geometry.positions.len()];
    for (splat, g) in std::iter::zip(projection.splats(), &by_image) {
        let index = splat.index as usize;
        let shape = projector.pull_back(geometry, splat, g.mean, g.conic);
        let offset = geometry.positions[index] - view.pose.centre().as_vec3();
        let sh = &splats.sh[3 * terms * index..3 * terms * (index + 1)];
        let position = shape.position + harmonics::by_position(sh, g.colour, offset);
        let own = &mut all[index];
        own[..3].copy_from_slice(&(size(splats, index) * position).to_array());
        own[3..6].copy_from_slice(&shape.log_scale.to_array());
        own[6..9].copy_from_slice(&shape.turn.to_array());
        own[9] = g.opacity_logit;
        let basis = harmonics::basis(offset.normalize_or_zero());
        for (term, b) in basis[..terms.min(4)].iter().enumerate() {
            own[10 + 3 * term..13 + 3 * term].copy_from_slice(&(g.colour * *b).to_array());
        }
    }
    all
}

/// A stride that visits all of `count` views before it repeats, and jumps far from neighbours: near
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

#[cfg(test)]
mod tests {
    use super::*;
    use nvsprior::{Camera, Picture, Pose, RenderOptions};

    const CAMERA: Camera = Camera { width: 80, height: 64, fx: 80.0, fy: 80.0, cx: 40.0, cy: 32.0 };

    fn cloud(count: usize) -> Splats {
        let wave = |i: usize, f: f32| (i as f32 * f + 0.4).sin();
        let each = |f: &dyn Fn(usize) -> [f32; 3]| (0..count).map(f).collect::<Vec<_>>();
        Splats {
            positions: each(&|i| [0.8 * wave(i, 1.7), 0.6 * wave(i, 2.9), 2.5 + wave(i, 0.3)]),
            log_scales: each(&|i| [-2.6 + 0.4 * wave(i, 0.7), -2.8, -3.4]),
            rotations: (0..count).map(|i| [1.0, wave(i, 0.2), wave(i, 0.9), 0.3]).collect(),
            opacity_logits: (0..count).map(|i| wave(i, 1.3)).collect(),
            sh: (0..12 * count).map(|i| 0.6 * wave(i, 0.77)).collect(),
            sh_degree: 1,
        }
    }

    fn loss(splats: &Splats, view: &PosedPicture, options: &RefitOptions) -> f64 {
        let geometry = Geometry::of(splats);
        let colours = harmonics::colours(splats, view.pose.centre().as_vec3());
        let projection = Projection::new(&geometry, &view.camera, &view.pose, &options.render);
        let mut sum = 0.0;
        projection.render(&colours, Vec3::from(options.render.background), |pixel, value| {
            sum += (value - Vec3::from(view.colour(pixel))).as_dvec3().length_squared();
        });
        sum
    }

    /// Medians, since the 1/255 cut makes jumps that no derivative sees.
    #[test]
    fn derivatives_agree_with_differences_of_the_loss() {
        let splats = cloud(24);
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        picture.data.iter_mut().enumerate().for_each(|(i, byte)| *byte = (i * 7 % 251) as u8);
        let view = PosedPicture::new(CAMERA, Pose::IDENTITY, picture);
        let options = RefitOptions { render: RenderOptions::INRIA, steps: 1, pace: 1.0, sweeps: 0 };
        let analytic = derivatives(&splats, &Geometry::of(&splats), &view, &options);
        for k in 0..PARAMETERS {
            let step = 1e-3;
            let mut errors: Vec<f64> = (0..24)
                .map(|index| {
                    let moved = |by: f32| {
                        let mut splats = splats.clone();
                        let mut change = [0.0; PARAMETERS];
                        change[k] = by;
                        apply(&mut splats, index, &change);
                        loss(&splats, &view, &options)
                    };
                    let difference = (moved(step) - moved(-step)) / (2.0 * f64::from(step));
                    (f64::from(analytic[index][k]) - difference).abs() / difference.abs().max(0.1)
                })
                .collect();
            errors.sort_by(f64::total_cmp);
            assert!(errors[12] < 0.01, "parameter {k}: {}", errors[12]);
        }
    }

    #[test]
    fn strides_visit_every_view() {
        for count in 1..200 {
            let stride = coprime_stride(count);
            let mut visited: Vec<usize> = (0..count).map(|i| i * stride % count).collect();
            visited.sort_unstable();
            assert!(visited.iter().copied().eq(0..count), "{count}: stride {stride}");
        }
    }
}
