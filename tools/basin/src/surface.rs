//! Points all over the surfaces that the mapping run sees. A mapping system would give them as its
//! point cloud; here they are sampled from the scene itself. Positions only, no colours.

use glam::{Vec2, Vec3};
use nvsprior::{Camera, Pose};
use nvsprior_train::mapping::SurfacePoint;
use rayon::prelude::*;

use super::CAMERA;
use super::scene::{BASIN, Scene};
use super::solid::{Ray, Shape, Solid};
use super::trajectory::mapping_poses;

/// Cells are never larger than this, metres.
const COARSEST: f32 = 0.6;
/// Cells are never split below this, metres.
const FINEST: f32 = 0.02;
/// A point is seen if its line of sight ends within this distance of it, metres.
const CONTACT: f32 = 0.01;

/// Points on the scene's surfaces. A camera of the mapping run sees each of them. They are at most
/// `pitch` pixels apart in the nearest view that may hold them.
pub fn surface_points(pitch: f32) -> Vec<SurfacePoint> {
    let scene = Scene::mapped();
    let views = mapping_poses();
    let faces: Vec<(&Solid, Face)> =
        scene.solids().flat_map(|s| Face::of(s).into_iter().map(move |f| (s, f))).collect();
    let candidates: Vec<SurfacePoint> = faces
        .par_iter()
        .flat_map_iter(|(solid, face)| sample_face(solid, face, &views, pitch))
        .collect();
    candidates.into_par_iter().filter(|p| seen(&scene, &views, p)).collect()
}

/// A piece of a solid's surface, flat or rolled out flat.
#[derive(Clone, Copy)]
enum Face {
    Side { radius: f32, half_length: f32 },
    Cap { radius: f32, z: f32 },
    Flat { axis: usize, side: f32, half: Vec3 },
}

impl Face {
    fn of(solid: &Solid) -> Vec<Face> {
        match solid.shape {
            Shape::Cylinder { radius, half_length } => vec![
                Face::Side { radius, half_length },
                Face::Cap { radius, z: half_length },
                Face::Cap { radius, z: -half_length },
            ],
            Shape::Block { half } => (0..3)
                .flat_map(|axis| [-1.0, 1.0].map(|side| Face::Flat { axis, side, half }))
                .collect(),
        }
    }

    /// Half sides of the face, rolled out.
    fn half(&self) -> Vec2 {
        match *self {
            Face::Side { radius, half_length } => {
                Vec2::new(std::f32::consts::PI * radius, half_length)
            }
            Face::Cap { radius, .. } => Vec2::splat(radius),
            Face::Flat { axis, half, .. } => Vec2::new(half[(axis + 1) % 3], half[(axis + 2) % 3]),
        }
    }

    /// Position and normal in the solid's axes; `None` beside a round cap.
    fn at(&self, p: Vec2) -> Option<(Vec3, Vec3)> {
        match *self {
            Face::Side { radius, .. } => {
                let normal = Vec2::from_angle(p.x / radius).extend(0.0);
                Some((normal * radius + Vec3::Z * p.y, normal))
            }
            Face::Cap { radius, z } => {
                (p.length() < radius).then_some((p.extend(z), Vec3::Z * z.signum()))
            }
            Face::Flat { axis, side, half } => {
                let mut position = Vec3::ZERO;
                position[axis] = side * half[axis];
                position[(axis + 1) % 3] = p.x;
                position[(axis + 2) % 3] = p.y;
                let mut normal = Vec3::ZERO;
                normal[axis] = side;
                Some((position, normal))
            }
        }
    }
}

/// Splits a face into cells until each is fine enough for its views. Returns the cells' centres.
fn sample_face(solid: &Solid, face: &Face, views: &[Pose], pitch: f32) -> Vec<SurfacePoint> {
    let size = 2.0 * face.half();
    let short = size.min_element().min(COARSEST);
    let count = (size / short).ceil();
    let cell = size / count;
    let mut open: Vec<(Vec2, Vec2)> = (0..count.y as u32)
        .flat_map(|j| (0..count.x as u32).map(move |i| Vec2::new(i as f32 + 0.5, j as f32 + 0.5)))
        .map(|index| (index * cell - face.half(), cell))
        .collect();
    let mut points = Vec::new();
    while let Some((centre, cell)) = open.pop() {
        let Some((local, normal)) = face.at(centre) else {
            // Beside a round cap: its cells may still reach in.
            if cell.x > FINEST * 2.0 {
                open.extend(quarters(centre, cell));
            }
            continue;
        };
        let position = solid.axes * local + solid.centre;
        let Some(spacing) = wanted_spacing(position, cell.max_element(), views, pitch) else {
            continue;
        };
        if cell.max_element() > spacing.max(FINEST) {
            open.extend(quarters(centre, cell));
        } else {
            let normal = (solid.axes * normal).to_array();
            let radius = 0.5 * (cell.x * cell.y).sqrt();
            points.push(SurfacePoint { position: position.to_array(), normal, radius });
        }
    }
    points
}

fn quarters(centre: Vec2, cell: Vec2) -> [(Vec2, Vec2); 4] {
    [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
        .map(|(x, y)| (centre + Vec2::new(x, y) * cell / 4.0, cell / 2.0))
}

/// The spacing that is `pitch` pixels in the nearest view whose frustum may hold a cell of `size`.
/// `None` if there is no such view, or outside the water.
fn wanted_spacing(position: Vec3, size: f32, views: &[Pose], pitch: f32) -> Option<f32> {
    let (low, high) = BASIN;
    let beyond = (low - position).max(position - high).max_element();
    if beyond > size {
        return None;
    }
    views
        .iter()
        .filter_map(|view| depth_in_view(view, position, size))
        .min_by(f32::total_cmp)
        .map(|depth| depth * pitch / CAMERA.fx)
}

/// Depth of a point, if its surroundings of `size` metres reach into the view.
fn depth_in_view(view: &Pose, position: Vec3, size: f32) -> Option<f32> {
    let p = (view.rotation * position.as_dvec3() + view.translation).as_vec3();
    let Camera { fx, fy, cx, cy, .. } = CAMERA;
    let inside = |across: f32, focal: f32, centre: f32| across.abs() < p.z * centre / focal + size;
    (p.z > 0.3 && inside(p.x, fx, cx) && inside(p.y, fy, cy)).then_some(p.z)
}

/// Whether a view holds the point with nothing before it.
fn seen(scene: &Scene, views: &[Pose], point: &SurfacePoint) -> bool {
    let position = Vec3::from(point.position);
    let normal = Vec3::from(point.normal);
    // No point if another solid touches this one here.
    let free = scene.distance(position + normal * CONTACT, CONTACT) > 0.0;
    let seen_from = |view: &Pose| {
        let origin = view.centre().as_vec3();
        let sight = position - origin;
        let range = sight.length();
        let direction = sight / range;
        direction.dot(normal) < -0.05
            && depth_in_view(view, position, 0.0).is_some()
            && scene.hit(&Ray { origin, direction }).is_some_and(|hit| hit.t > range - CONTACT)
    };
    free && views.iter().any(seen_from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_on_surfaces_and_face_the_water() {
        let scene = Scene::mapped();
        let points = surface_points(24.0);
        assert!(points.len() > 500, "{}", points.len());
        for point in &points {
            let (p, n) = (Vec3::from(point.position), Vec3::from(point.normal));
            assert!(scene.distance(p, 1.0).abs() < 1e-3, "{p}");
            assert!((n.length() - 1.0).abs() < 1e-5 && scene.distance(p + CONTACT * n, 1.0) > 0.0);
            assert!(point.radius > 0.0 && point.radius < COARSEST);
        }
    }

    #[test]
    fn a_finer_pitch_gives_more_points() {
        assert!(surface_points(16.0).len() > surface_points(24.0).len());
    }
}
