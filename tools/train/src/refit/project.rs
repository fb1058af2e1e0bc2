//! Splats seen from a pose: mean, spread and reach in the picture, and the way back.

use glam::{Mat2, Mat3, Quat, Vec2, Vec3};

use nvsprior::prior::{RenderOptions, Splats};
use nvsprior::{Camera, Pose};
use nvsprior_kernels::shared::{DILATION, EXTENT_MAX};

/// What determines the weights: place, shape and opacity of the splats.
pub struct Geometry {
    pub positions: Vec<Vec3>,
    /// Columns: each splat's axes, as long as its standard deviations along them.
    axes: Vec<Mat3>,
    opacities: Vec<f32>,
}

impl Geometry {
    pub fn of(splats: &Splats) -> Geometry {
        let axes = |(q, s): (&[f32; 4], &[f32; 3])| {
            let turn = Mat3::from_quat(Quat::from_xyzw(q[1], q[2], q[3], q[0]).normalize());
            turn * Mat3::from_diagonal(Vec3::from(*s).exp())
        };
        let opacity = |logit: &f32| 1.0 / (1.0 + (-logit).exp());
        Geometry {
            positions: splats.positions.iter().copied().map(Vec3::from).collect(),
            axes: splats.rotations.iter().zip(&splats.log_scales).map(axes).collect(),
            opacities: splats.opacity_logits.iter().map(opacity).collect(),
        }
    }
}

/// A splat in the picture.
pub struct Projected {
    pub mean: Vec2,
    /// Inverse of the 2D covariance: xx, xy, yy.
    pub conic: [f32; 3],
    pub opacity: f32,
    pub depth: f32,
    /// First and last pixel that it may touch, columns then rows.
    pub low: [usize; 2],
    pub high: [usize; 2],
    /// Which splat of the geometry.
    pub index: u32,
}

/// Derivatives by what gives a splat its place and shape.
pub struct ShapeGradient {
    /// World axes.
    pub position: Vec3,
    /// Along the splat's own axes.
    pub log_scale: Vec3,
    /// A small rotation vector, world axes, applied from the left.
    pub turn: Vec3,
}

/// A view, ready to project splats.
pub struct Projector<'a> {
    camera: &'a Camera,
    options: &'a RenderOptions,
    rotation: Mat3,
    translation: Vec3,
    /// Bounds of x/z and y/z in the Jacobian: the frustum and 0.3 half-widths beyond.
    slopes: [(f32, f32); 2],
}

impl<'a> Projector<'a> {
    pub fn new(camera: &'a Camera, pose: &Pose, options: &'a RenderOptions) -> Projector<'a> {
        let bounds = |side: u32, focal: f32, centre: f32| {
            let side = side as f32;
            let margin = 0.15 * side / focal;
            (-centre / focal - margin, (side - centre) / focal + margin)
        };
        Projector {
            camera,
            options,
            rotation: pose.matrix().as_mat3(),
            translation: pose.translation.as_vec3(),
            slopes: [
                bounds(camera.width, camera.fx, camera.cx),
                bounds(camera.height, camera.fy, camera.cy),
            ],
        }
    }

    /// The splat in the picture; `None` if it cannot touch a pixel.
    pub fn project(&self, geometry: &Geometry, index: usize) -> Option<Projected> {
        let p = self.to_camera(geometry.positions[index]);
        if !(p.z > self.options.near) {
            return None;
        }
        let Camera { fx, fy, cx, cy, .. } = *self.camera;
        let mean = Vec2::new(fx * p.x / p.z + cx, fy * p.y / p.z + cy);
        let [xx, xy, yy] = self.covariance(&geometry.axes[index], p);
        let (wide, high) = (xx + DILATION, yy + DILATION);
        let determinant = wide * high - xy * xy;
        if !(determinant > 0.0) {
            return None;
        }
        let mut opacity = geometry.opacities[index];
        if self.options.antialiased {
            opacity *= ((xx * yy - xy * xy) / determinant).max(2.5e-5).sqrt();
        }
        let reach = EXTENT_MAX.min((2.0 * (255.0 * opacity).ln()).sqrt());
        let extent = reach * Vec2::new(wide.sqrt(), high.sqrt());
        let (low_x, high_x) = pixels(mean.x, extent.x, self.camera.width)?;
        let (low_y, high_y) = pixels(mean.y, extent.y, self.camera.height)?;
        Some(Projected {
            mean,
            conic: [high / determinant, -xy / determinant, wide / determinant],
            opacity,
            depth: p.z,
            low: [low_x, low_y],
            high: [high_x, high_y],
            index: index as u32,
        })
    }

    fn to_camera(&self, position: Vec3) -> Vec3 {
        self.rotation * position + self.translation
    }

    /// Turns derivatives by mean and conic (xx, xy, yy; xy stands for both places) into those by
    /// the splat's own place and shape. If the Jacobian is clamped, its change is left out.
    pub fn pull_back(
        &self,
        geometry: &Geometry,
        splat: &Projected,
        by_mean: Vec2,
        by_conic: [f32; 3],
    ) -> ShapeGradient {
        let index = splat.index as usize;
        let p = self.to_camera(geometry.positions[index]);
        let rows = self.rows(p);
        let [xx, xy, yy] = splat.conic;
        let conic = Mat2::from_cols(Vec2::new(xx, xy), Vec2::new(xy, yy));
        let [gxx, gxy, gyy] = by_conic;
        let by_conic = Mat2::from_cols(Vec2::new(gxx, gxy / 2.0), Vec2::new(gxy / 2.0, gyy));
        // d(Σ⁻¹) = −Σ⁻¹ dΣ Σ⁻¹.
        let by_covariance = -(conic * by_conic * conic);
        // The projected covariance is Σₖ (M aₖ)(M aₖ)ᵀ over the splat's axes aₖ, M the two rows.
        let axes = geometry.axes[index];
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis];
        let by_flat =
            axes.map(|a| 2.0 * (by_covariance * Vec2::new(rows[0].dot(a), rows[1].dot(a))));
        let by_axis = by_flat.map(|g| rows[0] * g.x + rows[1] * g.y);
        let by_row =
            |row: usize| -> Vec3 { std::iter::zip(axes, by_flat).map(|(a, g)| a * g[row]).sum() };
        let by_rows = [by_row(0), by_row(1)];
        ShapeGradient {
            position: rows[0] * by_mean.x + rows[1] * by_mean.y + self.by_jacobian(p, by_rows),
            log_scale: Vec3::from_array(std::array::from_fn(|k| by_axis[k].dot(axes[k]))),
            // Turning by ω moves aₖ by ω × aₖ.
            turn: std::iter::zip(axes, by_axis).map(|(a, g)| a.cross(g)).sum(),
        }
    }

    /// Turns the derivatives by the rows of `J R` into those by the position, through `J`.
    fn by_jacobian(&self, p: Vec3, by_rows: [Vec3; 2]) -> Vec3 {
        let Camera { fx, fy, .. } = *self.camera;
        let [x, y] = by_rows.map(|row| self.rotation * row);
        let z2 = p.z * p.z;
        let slope = Vec2::new(p.x, p.y) / p.z;
        let by_p = Vec3::new(
            -fx * x.z,
            -fy * y.z,
            fx * (2.0 * slope.x * x.z - x.x) + fy * (2.0 * slope.y * y.z - y.y),
        );
        self.rotation.transpose() * by_p / z2
    }

    /// `J R Σ Rᵀ Jᵀ` as xx, xy, yy (Zwicker et al., "EWA Splatting", 2002, eq. 31).
    fn covariance(&self, axes: &Mat3, p: Vec3) -> [f32; 3] {
        let [x, y] = self.rows(p).map(|row| axes.transpose() * row);
        [x.dot(x), x.dot(y), y.dot(y)]
    }

    /// Rows of `J R`: how the picture's x and y change with a world point that is `p` in camera axes.
    fn rows(&self, p: Vec3) -> [Vec3; 2] {
        let Camera { fx, fy, .. } = *self.camera;
        let [across, down] = self.slopes;
        let (u, v) = ((p.x / p.z).clamp(across.0, across.1), (p.y / p.z).clamp(down.0, down.1));
        let to_world = self.rotation.transpose();
        [
            to_world * Vec3::new(fx / p.z, 0.0, -fx * u / p.z),
            to_world * Vec3::new(0.0, fy / p.z, -fy * v / p.z),
        ]
    }
}

/// First and last pixel whose centre lies within `extent` of `mean`, cut to the picture.
fn pixels(mean: f32, extent: f32, side: u32) -> Option<(usize, usize)> {
    let low = (mean - extent - 0.5).ceil().max(0.0);
    let high = (mean + extent - 0.5).floor().min(side as f32 - 1.0);
    (low <= high).then_some((low as usize, high as usize))
}
