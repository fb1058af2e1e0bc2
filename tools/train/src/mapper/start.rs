//! The splats that training starts from.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::trainer::{SH_0, UNUSED};
use nvsprior::random::Random;
use nvsprior_kernels::training::{LOG_SCALE, OPACITY, POSITION, ROTATION, SH, planes};

use super::MapOptions;
use super::splats::Planes;
use crate::PosedPicture;

/// A point of the scene, as structure from motion gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredPoint {
    /// World axes, the prior's unit.
    pub position: [f32; 3],
    /// Red, green, blue, in [0, 1].
    pub rgb: [f32; 3],
}

/// Standard deviation of a first splat, in mean distances to its three nearest neighbours.
const SPREAD: f32 = 0.5;
/// Share of random points among the first ones if there are no points.
const RANDOM_SHARE: f64 = 0.5;
/// Share of the splats that there are at first, if there are fewer points: others are put between these.
const LEAST_SHARE: f64 = 0.5;
/// Depth of the nearest random points, in extents of the scene.
const NEAREST: f64 = 0.3;
/// Depth of the farthest ones, in depths of the nearest.
const FARTHEST: f32 = 50.0;

/// The parameters' planes, and how many splats are in use.
pub fn start(
    views: &[PosedPicture],
    points: &[ColouredPoint],
    options: &MapOptions,
    centre: DVec3,
    extent: f64,
) -> (Vec<f32>, u32) {
    let n = options.splats as usize;
    let mut random = Random::new(options.seed ^ 0x0073_7461_7274);
    let made;
    let points = if points.is_empty() {
        let count = (n as f64 * RANDOM_SHARE).ceil() as usize;
        made = in_front(views, count, extent, options.render.near.into(), &mut random);
        &made
    } else {
        points
    };
    let chosen = choose(points, n, centre, &mut random);
    let least = (n as f64 * LEAST_SHARE) as usize;
    let chosen = denser(chosen, least, &mut random);
    let spreads = spreads(&chosen);
    let mut numbers = vec![0.0; n * planes(options.sh_degree) as usize];
    let mut planes = Planes { numbers: &mut numbers, splats: n };
    for i in 0..n {
        *planes.at(OPACITY, i) = UNUSED;
        *planes.at(ROTATION, i) = 1.0;
    }
    for (i, (point, spread)) in chosen.iter().zip(&spreads).enumerate() {
        for k in 0..3 {
            *planes.at(POSITION + k, i) = point.position[k as usize];
            *planes.at(LOG_SCALE + k, i) = (SPREAD * spread).ln();
            *planes.at(SH + k, i) = (point.rgb[k as usize] - 0.5) / SH_0;
        }
        for k in 0..4 {
            *planes.at(ROTATION + k, i) = random.within(-1.0, 1.0);
        }
        // A length of zero has no direction.
        *planes.at(ROTATION, i) += 1.5;
        *planes.at(OPACITY, i) = 0.0;
    }
    (numbers, chosen.len() as u32)
}

/// As many points as there may be splats, relative to the centre.
fn choose(
    points: &[ColouredPoint],
    max: usize,
    centre: DVec3,
    random: &mut Random,
) -> Vec<ColouredPoint> {
    let relative = |point: &ColouredPoint| {
        let position = DVec3::from(point.position.map(f64::from)) - centre;
        ColouredPoint { position: position.as_vec3().to_array(), ..*point }
    };
    let valid = |point: &&ColouredPoint| {
        point.position.iter().chain(&point.rgb).all(|value| value.is_finite())
    };
    let mut all: Vec<_> = points.iter().filter(valid).map(relative).collect();
    for i in 0..max.min(all.len()) {
        let left = (all.len() - i) as u64;
        // Points of a file may lie in an order: those left out come from everywhere.
        if all.len() > max {
            all.swap(i, i + (random.bits() % left) as usize);
        }
    }
    all.truncate(max);
    all
}

/// At least so many points: those that are missing lie between a point and one of its three nearest neighbours.
fn denser(mut points: Vec<ColouredPoint>, least: usize, random: &mut Random) -> Vec<ColouredPoint> {
    let count = points.len();
    let missing = least.saturating_sub(count);
    if count < 4 || missing == 0 {
        return points;
    }
    let neighbours: Vec<_> = {
        let grid = Grid::new(&points);
        (0..count).into_par_iter().map(|i| grid.nearest(i)).collect()
    };
    for _ in 0..missing {
        let from = (random.bits() % count as u64) as usize;
        let (_, to) = neighbours[from][(random.bits() % NEIGHBOURS as u64) as usize];
        let share = random.within(0.0, 1.0);
        // A point without neighbours nearby stays alone.
        let Some(to) = to.map(|to| points[to as usize]) else { continue };
        let from = points[from];
        let between =
            |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|k| a[k] + share * (b[k] - a[k]));
        points.push(ColouredPoint {
            position: between(from.position, to.position),
            rgb: between(from.rgb, to.rgb),
        });
    }
    points
}

/// Neighbours by which a point's spread is measured.
const NEIGHBOURS: usize = 3;

/// Mean distance of each point to its three nearest neighbours.
fn spreads(points: &[ColouredPoint]) -> Vec<f32> {
    let grid = Grid::new(points);
    (0..points.len()).into_par_iter().map(|i| grid.spread(i)).collect()
}

/// Points in cubes.
struct Grid<'a> {
    points: &'a [ColouredPoint],
    /// Points in the order of their cubes.
    order: Vec<(u64, u32)>,
    low: Vec3,
    side: f32,
}

/// Cubes along an axis, at most.
const CUBES: u64 = 1 << 20;

impl Grid<'_> {
    fn new(points: &[ColouredPoint]) -> Grid<'_> {
        let positions = || points.iter().map(|point| Vec3::from(point.position));
        let low = positions().fold(Vec3::INFINITY, Vec3::min);
        // A few points per cube, if half of them lie near each other.
        let mut distances: Vec<f32> = {
            let middle = positions().sum::<Vec3>() / points.len().max(1) as f32;
            positions().map(|p| p.distance(middle)).collect()
        };
        distances.sort_by(f32::total_cmp);
        let half = distances.get(distances.len() / 2).copied().unwrap_or(1.0);
        let side = (half * 4.0 / (points.len().max(1) as f32).cbrt()).max(1e-6);
        let mut grid = Grid { points, order: Vec::new(), low, side };
        let key = |i: usize| (grid.key(grid.cube(Vec3::from(points[i].position))), i as u32);
        let mut order: Vec<_> = (0..points.len()).map(key).collect();
        order.sort_unstable();
        grid.order = order;
        grid
    }

    fn cube(&self, position: Vec3) -> [i64; 3] {
        let scaled = (position - self.low) / self.side;
        scaled.to_array().map(|v| (v as i64).clamp(0, CUBES as i64 - 1))
    }

    fn key(&self, cube: [i64; 3]) -> u64 {
        cube.into_iter().fold(0, |key, v| key * CUBES + v as u64)
    }

    fn points_in(&self, cube: [i64; 3]) -> &[(u64, u32)] {
        if cube.iter().any(|v| !(0..CUBES as i64).contains(v)) {
            return &[];
        }
        let key = self.key(cube);
        let first = self.order.partition_point(|(other, _)| *other < key);
        let count = self.order[first..].partition_point(|(other, _)| *other == key);
        &self.order[first..first + count]
    }

    /// Distances and numbers of the three nearest within some cubes.
    fn nearest(&self, i: usize) -> [(f32, Option<u32>); NEIGHBOURS] {
        let own = Vec3::from(self.points[i].position);
        let [x, y, z] = self.cube(own);
        let mut nearest = [(f32::INFINITY, None); NEIGHBOURS];
        for reach in 1..=4 {
            nearest = [(f32::INFINITY, None); NEIGHBOURS];
            for cube in cubes_around(reach).map(|[a, b, c]| [x + a, y + b, z + c]) {
                for (_, other) in self.points_in(cube) {
                    let distance = own.distance(Vec3::from(self.points[*other as usize].position));
                    // Points that lie in the same place say nothing of the distance to others.
                    if distance > 1e-7 * self.side && distance < nearest[NEIGHBOURS - 1].0 {
                        nearest[NEIGHBOURS - 1] = (distance, Some(*other));
                        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
                    }
                }
            }
            if nearest[NEIGHBOURS - 1].0 <= reach as f32 * self.side {
                break;
            }
        }
        nearest
    }

    /// Mean distance to the nearest; a cube's side if there are none.
    fn spread(&self, i: usize) -> f32 {
        let nearest = self.nearest(i).map(|(distance, _)| distance);
        let found: Vec<f32> = nearest.into_iter().filter(|v| v.is_finite()).collect();
        let sum: f32 = found.iter().sum();
        if found.is_empty() { self.side } else { sum / found.len() as f32 }
    }
}

fn cubes_around(reach: i64) -> impl Iterator<Item = [i64; 3]> {
    let along = move || -reach..=reach;
    along().flat_map(move |x| along().flat_map(move |y| along().map(move |z| [x, y, z])))
}

/// Random points in front of the cameras, grey.
fn in_front(
    views: &[PosedPicture],
    count: usize,
    extent: f64,
    near: f64,
    random: &mut Random,
) -> Vec<ColouredPoint> {
    let nearest = (NEAREST * extent).max(2.0 * near);
    let point = |_| {
        let view = &views[(random.bits() % views.len() as u64) as usize];
        let camera = &view.camera;
        let (u, v) = (f64::from(random.within(0.0, 1.0)), f64::from(random.within(0.0, 1.0)));
        // Even in one over the depth: how deep the scene is nobody has said.
        let depth = nearest / f64::from(random.within(1.0 / FARTHEST, 1.0));
        let x = (u * f64::from(camera.width) - f64::from(camera.cx)) / f64::from(camera.fx);
        let y = (v * f64::from(camera.height) - f64::from(camera.cy)) / f64::from(camera.fy);
        let back = view.pose.inverse();
        let position = back.rotation * (DVec3::new(x, y, 1.0) * depth) + back.translation;
        ColouredPoint { position: position.as_vec3().to_array(), rgb: [0.5; 3] }
    };
    (0..count).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_distances_to_the_nearest() {
        let mut random = Random::new(3);
        let points: Vec<_> = (0..400)
            .map(|_| ColouredPoint { position: random.triple(-2.0, 5.0), rgb: [0.5; 3] })
            .collect();
        let spreads = spreads(&points);
        for (i, spread) in spreads.iter().enumerate() {
            let own = Vec3::from(points[i].position);
            let mut all: Vec<f32> =
                points.iter().map(|p| own.distance(Vec3::from(p.position))).collect();
            all.sort_by(f32::total_cmp);
            let expected = all[1..4].iter().sum::<f32>() / 3.0;
            assert!((spread - expected).abs() < 1e-4 * expected, "{i}: {spread}, {expected}");
        }
    }

    #[test]
    fn few_points_become_more_between_them() {
        let mut random = Random::new(7);
        // Two patches, far apart.
        let point = |i: usize, random: &mut Random| {
            let [x, y, z] = random.triple(0.0, 1.0);
            let rgb = [if i < 20 { 0.2 } else { 0.9 }; 3];
            ColouredPoint { position: [x + if i < 20 { 0.0 } else { 50.0 }, y, z], rgb }
        };
        let points: Vec<_> = (0..40).map(|i| point(i, &mut random)).collect();
        let more = denser(points.clone(), 500, &mut random);
        assert!(more.len() > 450 && more.len() <= 500, "{}", more.len());
        assert_eq!(more[..40], points);
        for ColouredPoint { position: [x, ..], rgb } in &more {
            let expected = if *x < 10.0 { 0.2 } else { 0.9 };
            assert!((0.0..=1.0).contains(x) || (50.0..=51.0).contains(x), "{x}");
            assert!((rgb[0] - expected).abs() < 1e-6, "{x} {rgb:?}");
        }
        assert_eq!(denser(points.clone(), 10, &mut random), points);
        assert_eq!(denser(points[..3].to_vec(), 500, &mut random).len(), 3);
    }

    #[test]
    fn points_in_one_place_have_a_spread() {
        let points = [ColouredPoint { position: [1.0; 3], rgb: [0.5; 3] }; 5];
        assert!(spreads(&points).iter().all(|spread| *spread > 0.0));
    }
}
