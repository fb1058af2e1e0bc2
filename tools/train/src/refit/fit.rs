//! Colours that fit the views: linear least squares by preconditioned conjugate gradients.
//!
//! With geometry and opacity fixed a picture is linear in the spherical-harmonic coefficients `x`:
//! it is `A x`. The entries of `A` are a splat's weight in a pixel times the basis functions in the
//! splat's direction. The solver takes the damped normal equations `(AᵀA + D) x = Aᵀ b` (Björck,
//! "Numerical Methods for Least Squares Problems", 1996, §7.4), with Jacobi preconditioning. `A` is
//! never stored: every sweep rasterises every view again.

use glam::Vec3;
use rayon::prelude::*;

use super::RefitOptions;
use super::harmonics;
use super::project::Geometry;
use super::raster::Projection;
use crate::PosedPicture;
use nvsprior::prior::Splats;

/// Views are summed in this many groups, each in its own order, and then group by group. So the sum
/// does not depend on the number of threads.
const GROUPS: usize = 8;

/// The pull of a splat's first coefficient towards what it is, in squared weights of pixels.
const DAMPING: f32 = 0.02;
/// The pull of the other coefficients.
const VIEW_DAMPING: f32 = 1.0;

/// Corrects the colours of splats in `options.sweeps` steps, and calls `done` after each. What the views do not
/// determine stays as it is.
pub fn correct_colours(
    splats: &mut Splats,
    views: &[PosedPicture],
    options: &RefitOptions,
    done: &mut dyn FnMut(),
) {
    let (system, x) = System::of(splats, views, options);
    let mut change = vec![Vec3::ZERO; x.len()];
    system.solve(&mut change, system.pulled(&x, true), done);
    splats.sh = std::iter::zip(x, change).flat_map(|(x, c)| (x + c).to_array()).collect();
}

/// The linear system of one geometry and its views.
struct System<'a> {
    geometry: Geometry,
    views: &'a [PosedPicture],
    options: &'a RefitOptions,
    /// Coefficients per splat.
    terms: usize,
}

impl<'a> System<'a> {
    /// That of splats, and the coefficients that they have.
    fn of(
        splats: &Splats,
        views: &'a [PosedPicture],
        options: &'a RefitOptions,
    ) -> (System<'a>, Vec<Vec3>) {
        let terms = harmonics::count(splats.sh_degree);
        let system = System { geometry: Geometry::of(splats), views, options, terms };
        (system, splats.sh.chunks_exact(3).map(Vec3::from_slice).collect())
    }

    /// Improves coefficients, `terms` per splat, from the residual of the normal equations there.
    fn solve(&self, x: &mut [Vec3], mut residual: Vec<Vec3>, done: &mut dyn FnMut()) {
        let inverse_diagonal = self.inverse_diagonal();
        let precondition = |r: &[Vec3]| -> Vec<Vec3> {
            std::iter::zip(r, &inverse_diagonal).map(|(r, d)| *r * *d).collect()
        };
        let mut z = precondition(&residual);
        let mut direction = z.clone();
        let mut rz = dot(&residual, &z);
        for _ in 0..self.options.sweeps {
            let mut image = self.pulled(&direction, false);
            self.damp(&direction, &mut image, 1.0);
            let step = rz / dot(&direction, &image);
            // Not if the residual is zero, which makes the step 0/0.
            if step > 0.0 {
                add_scaled(x, step, &direction);
                add_scaled(&mut residual, -step, &image);
                z = precondition(&residual);
                let next = dot(&residual, &z);
                for (d, z) in std::iter::zip(&mut direction, &z) {
                    *d = *z + *d * (next / rz) as f32;
                }
                rz = next;
            }
            done();
        }
    }

    /// `Aᵀ (b − A x)` if `against_pictures`, else `AᵀA x`.
    fn pulled(&self, x: &[Vec3], against_pictures: bool) -> Vec<Vec3> {
        let background = Vec3::from(self.options.render.background);
        self.summed(vec![Vec3::ZERO; x.len()], |view, projection, sum: &mut [Vec3]| {
            let directions = self.directions(view);
            let mut colours =
                self.colours(x, &directions, if against_pictures { 0.5 } else { 0.0 });
            if against_pictures {
                colours.iter_mut().for_each(|c| *c = c.max(Vec3::ZERO));
            }
            let mut gradient = vec![Vec3::ZERO; colours.len()];
            projection.sweep(&colours, &mut gradient, |pixel, value, transmittance| {
                if against_pictures {
                    Vec3::from(view.colour(pixel)) - value - transmittance * background
                } else {
                    value
                }
            });
            for (i, (g, d)) in std::iter::zip(&gradient, &directions).enumerate() {
                let basis = harmonics::basis(*d);
                let own = &mut sum[i * self.terms..(i + 1) * self.terms];
                for (s, b) in std::iter::zip(own, basis) {
                    *s += *g * b;
                }
            }
        })
    }

    /// Reciprocal of the diagonal of `AᵀA + D`, per coefficient.
    fn inverse_diagonal(&self) -> Vec<f32> {
        let count = self.geometry.positions.len();
        let sums = self.summed(vec![0.0; count * self.terms], |view, projection, sum| {
            let mut squares = vec![0.0; count];
            projection.add_squared_weights(&mut squares);
            for (i, (s, d)) in std::iter::zip(&squares, self.directions(view)).enumerate() {
                let own = &mut sum[i * self.terms..(i + 1) * self.terms];
                for (o, b) in std::iter::zip(own, harmonics::basis(d)) {
                    *o += s * b * b;
                }
            }
        });
        sums.iter().enumerate().map(|(k, s)| 1.0 / (s + self.damping(k))).collect()
    }

    /// Adds up what `add` makes of every view and its projection.
    fn summed<T>(
        &self,
        zero: Vec<T>,
        add: impl Fn(&PosedPicture, &Projection, &mut [T]) + Sync,
    ) -> Vec<T>
    where
        T: Copy + Send + Sync + std::ops::AddAssign,
    {
        sum_over(self.views, zero, |view, sum| {
            let options = &self.options.render;
            let projection = Projection::new(&self.geometry, &view.camera, &view.pose, options);
            add(view, &projection, sum);
        })
    }

    /// Unit directions from a view's camera to every splat.
    fn directions(&self, view: &PosedPicture) -> Vec<Vec3> {
        let centre = view.pose.centre().as_vec3();
        self.geometry.positions.iter().map(|p| (*p - centre).normalize_or_zero()).collect()
    }

    /// Every splat's colour in its direction, without the clamp at zero.
    fn colours(&self, x: &[Vec3], directions: &[Vec3], offset: f32) -> Vec<Vec3> {
        std::iter::zip(x.chunks_exact(self.terms), directions)
            .map(|(own, d)| {
                let basis = harmonics::basis(*d);
                std::iter::zip(own, basis).fold(Vec3::splat(offset), |sum, (c, b)| sum + *c * b)
            })
            .collect()
    }

    /// The entry of `D` for a coefficient.
    fn damping(&self, k: usize) -> f32 {
        if k.is_multiple_of(self.terms) { DAMPING } else { VIEW_DAMPING }
    }

    /// `sum += sign · D x`.
    fn damp(&self, x: &[Vec3], sum: &mut [Vec3], sign: f32) {
        for (k, (s, x)) in std::iter::zip(sum, x).enumerate() {
            *s += *x * (sign * self.damping(k));
        }
    }
}

/// Sums what `add` gives for every view, in an order that does not depend on the number of threads.
pub fn sum_over<V, T>(views: &[V], zero: Vec<T>, add: impl Fn(&V, &mut [T]) + Sync) -> Vec<T>
where
    V: Sync,
    T: Copy + Send + Sync + std::ops::AddAssign,
{
    let size = views.len().div_ceil(GROUPS).max(1);
    let sums: Vec<Vec<T>> = views
        .par_chunks(size)
        .map(|group| {
            let mut sum = zero.clone();
            group.iter().for_each(|view| add(view, &mut sum));
            sum
        })
        .collect();
    let mut total = zero;
    for sum in sums {
        for (t, s) in std::iter::zip(&mut total, sum) {
            *t += s;
        }
    }
    total
}

/// Summed in f64: the sums run over 10⁵ terms and steer every step.
fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    std::iter::zip(a, b).map(|(a, b)| f64::from(a.dot(*b))).sum()
}

fn add_scaled(to: &mut [Vec3], scale: f64, of: &[Vec3]) {
    for (t, o) in std::iter::zip(to, of) {
        *t += *o * scale as f32;
    }
}
