//! Twin of stage `project` (Zwicker et al. 2001; Kerbl et al. 2023).

use std::ops::Range;

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

use nvsprior::prior::Splats;
use nvsprior_kernels::shared::{ALPHA_MIN, FRUSTUM_MARGIN, RATIO_MIN, THIN, WIDE};

use super::{CUT_MARGIN, Channels, Viewpoint, harmonics};

/// Depths, lengths of projected axes in pixels, and means in pixels beyond which a splat is not drawn. These bounds are
/// part of the definition (docs/format/render.md): within them all of a device's results stay within f32.
const DEPTHS: Range<f64> = 1e-18..1e30;
const LONGEST: f64 = 1e30;
const FURTHEST: f64 = 1e15;

/// A splat of the prior, activated.
#[derive(Clone, Copy, Debug)]
pub struct Splat<'a> {
    /// Mean, world axes.
    pub position: DVec3,
    /// Covariance `R S Sᵀ Rᵀ`, world axes.
    pub covariance: DMat3,
    /// Its scaled axes `R S`, columns, world axes.
    pub axes: DMat3,
    /// Opacity, 0 to 1.
    pub opacity: f64,
    /// Spherical harmonics, RGB triples.
    pub sh: &'a [f32],
}

impl<'a> Splat<'a> {
    /// Splat `i` of a checked prior.
    pub fn new(splats: &'a Splats, i: usize) -> Splat<'a> {
        let [w, x, y, z] = splats.rotations[i].map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let deviations = DVec3::from(splats.log_scales[i].map(|s| f64::from(s).exp()));
        let variances = deviations * deviations;
        let stride = splats.sh_stride();
        Splat {
            position: DVec3::from(splats.positions[i].map(f64::from)),
            covariance: rotation * DMat3::from_diagonal(variances) * rotation.transpose(),
            axes: rotation * DMat3::from_diagonal(deviations),
            opacity: 1.0 / (1.0 + (-f64::from(splats.opacity_logits[i])).exp()),
            sh: &splats.sh[i * stride..][..stride],
        }
    }

    /// Unit direction from the camera's centre, and the distance.
    pub fn direction(&self, view: &Viewpoint) -> (DVec3, f64) {
        let towards = self.position - view.pose.centre();
        let distance = towards.length();
        (towards / distance, distance)
    }

    /// Covariance in camera axes, `W Σ Wᵀ`.
    pub fn camera_covariance(&self, view: &Viewpoint) -> DMat3 {
        let w = view.pose.matrix();
        w * self.covariance * w.transpose()
    }
}

/// The projection's linearisation at a splat.
#[derive(Clone, Copy, Debug)]
pub struct Linearisation {
    /// `(x/z, y/z)`, limited to the frustum and its margin.
    pub ray: DVec2,
    /// Whether each was within the limits.
    pub inside: [bool; 2],
    /// Rows of the Jacobian `J`.
    pub rows: [DVec3; 2],
}

impl Linearisation {
    /// Linearises at a point in camera coordinates.
    pub fn at(view: &Viewpoint, p: DVec3) -> Linearisation {
        let c = view.camera;
        let focal = DVec2::new(c.fx.into(), c.fy.into());
        let principal = DVec2::new(c.cx.into(), c.cy.into());
        let size = DVec2::new(c.width.into(), c.height.into());
        // The margin is 0.3 tan(fov/2), and tan(fov/2) is half the picture divided by the focal length.
        let margin = f64::from(FRUSTUM_MARGIN) * 0.5 * size / focal;
        let (low, high) = (-principal / focal - margin, (size - principal) / focal + margin);
        let free = DVec2::new(p.x, p.y) / p.z;
        let ray = free.clamp(low, high);
        Linearisation {
            ray,
            inside: [ray.x == free.x, ray.y == free.y],
            rows: [
                DVec3::new(focal.x / p.z, 0.0, -focal.x * ray.x / p.z),
                DVec3::new(0.0, focal.y / p.z, -focal.y * ray.y / p.z),
            ],
        }
    }

    /// Determinant of `J Σ Jᵀ + low_pass`, from the axes, `Σ = A Aᵀ` (Cauchy–Binet): for a long
    /// needle it would be lost in the rounding of its covariance.
    pub fn determinant(&self, axes: &DMat3, low_pass: f64) -> f64 {
        let [m0, m1] = self.rows.map(|row| axes.transpose() * row);
        let trace = m0.length_squared() + m1.length_squared();
        m0.cross(m1).length_squared() + low_pass * (trace + low_pass)
    }

    /// The greatest number in the projected axes, pixels.
    fn longest(&self, axes: &DMat3) -> f64 {
        let longest = |row: DVec3| (axes.transpose() * row).abs().max_element();
        longest(self.rows[0]).max(longest(self.rows[1]))
    }

    /// The least determinant of a splat that is drawn: see [`THIN`].
    fn min_determinant(&self, axes: &DMat3) -> f64 {
        let max = self.longest(axes);
        if max > WIDE.into() { f64::from(THIN) * max.powi(4) } else { 0.0 }
    }

    /// `J Σ Jᵀ`.
    pub fn covariance(&self, sigma: &DMat3) -> DMat2 {
        let [j0, j1] = self.rows;
        let (s0, s1) = (*sigma * j0, *sigma * j1);
        DMat2::from_cols(DVec2::new(j0.dot(s0), j1.dot(s0)), DVec2::new(j0.dot(s1), j1.dot(s1)))
    }
}

/// A splat as the camera sees it.
#[derive(Clone, Copy, Debug)]
pub struct Projected {
    /// Index in the prior.
    pub index: u32,
    /// Mean in camera coordinates.
    pub camera: DVec3,
    /// How much f32 arithmetic may miss the camera z.
    pub depth_error: f64,
    /// Mean, pixels.
    pub mean: DVec2,
    /// 2D covariance with the low-pass, pixels².
    pub covariance: DMat2,
    /// Its inverse.
    pub conic: DMat2,
    /// Factor `(l11, l21, l22)` of the conic: `dᵀ Q d = (l11 dx + l21 dy)² + (l22 dy)²`.
    pub factor: [f64; 3],
    /// Opacity, compensated for the low-pass if the prior is anti-aliased.
    pub opacity: f64,
    /// Colour, not below 0.
    pub rgb: [f64; 3],
    /// Half sides, pixels, of the box outside of which alpha is below the cut by more than
    /// `CUT_MARGIN`.
    pub extent: DVec2,
}

/// Projects a splat; `None` if it is culled.
pub fn project(view: &Viewpoint, index: u32, splat: &Splat) -> Option<Projected> {
    let rotated = view.pose.matrix() * splat.position;
    let p = rotated + view.pose.translation;
    if !(p.z > f64::from(view.options.near) && DEPTHS.contains(&p.z)) {
        return None;
    }
    let linear = Linearisation::at(view, p);
    let sharp = linear.covariance(&splat.camera_covariance(view));
    let [added, kept] = view.low_pass.map(f64::from);
    let covariance = sharp + DMat2::from_diagonal(DVec2::splat(added));
    let axes = view.pose.matrix() * splat.axes;
    let det = linear.determinant(&axes, added);
    let drawn = linear.longest(&axes) < LONGEST && det > linear.min_determinant(&axes);
    if !(drawn && det.is_finite()) {
        return None;
    }
    let opacity = splat.opacity * compensation(view, linear.determinant(&axes, kept) / det);
    let (rgb, _) = harmonics::evaluate(splat.sh, splat.direction(view).0);
    let c = view.camera;
    // How many standard deviations out the alpha passes the cut.
    let reach = 2.0 * (opacity * (1.0 + CUT_MARGIN) / f64::from(ALPHA_MIN)).ln();
    let factor = factor(&covariance, det);
    let deviations = DVec2::new(covariance.x_axis.x.sqrt(), covariance.y_axis.y.sqrt());
    let mean = DVec2::new(
        f64::from(c.fx) * p.x / p.z + f64::from(c.cx),
        f64::from(c.fy) * p.y / p.z + f64::from(c.cy),
    );
    (reach >= 0.0 && mean.abs().max_element() < FURTHEST).then(|| Projected {
        index,
        camera: p,
        depth_error: 4.0
            * f64::from(f32::EPSILON)
            * (splat.position.length() + view.pose.translation.length()),
        mean,
        covariance,
        conic: squared(factor),
        factor,
        opacity,
        rgb: rgb.map(|v| (v + 0.5).max(0.0)),
        extent: reach.sqrt() * deviations,
    })
}

/// The triangular factor of a covariance's inverse.
fn factor(covariance: &DMat2, det: f64) -> [f64; 3] {
    let (b, c) = (covariance.x_axis.y, covariance.y_axis.y);
    let l11 = (c / det).sqrt();
    [l11, -l11 * b / c, 1.0 / c.sqrt()]
}

/// `LᵀL`.
fn squared([l11, l21, l22]: [f64; 3]) -> DMat2 {
    let xy = l11 * l21;
    DMat2::from_cols(DVec2::new(l11 * l11, xy), DVec2::new(xy, l21 * l21 + l22 * l22))
}

/// The scale of opacity, from the ratio of two determinants: with the kept part of the low-pass,
/// and with all of it.
fn compensation(view: &Viewpoint, ratio: f64) -> f64 {
    let [added, kept] = view.low_pass;
    if kept < added { ratio.max(RATIO_MIN.into()).sqrt() } else { 1.0 }
}

impl Projected {
    /// What it adds to each channel at weight 1.
    pub fn payload(&self) -> Channels {
        let [r, g, b] = self.rgb;
        [r, g, b, self.camera.z, 0.0]
    }

    /// Columns of the picture whose pixel centres lie in its box.
    pub fn columns(&self, width: u32) -> Range<u32> {
        centres(self.mean.x, self.extent.x, width)
    }

    /// Rows of the picture whose pixel centres lie in its box.
    pub fn rows(&self, height: u32) -> Range<u32> {
        centres(self.mean.y, self.extent.y, height)
    }
}

/// Indices below `count` whose centres at +0.5 lie within `extent` of `mean`.
fn centres(mean: f64, extent: f64, count: u32) -> Range<u32> {
    let limit = |v: f64| v.clamp(0.0, count.into()) as u32;
    limit((mean - extent - 0.5).ceil())..limit((mean + extent - 0.5).floor() + 1.0)
}
