//! Directions all around, evenly spread.

use glam::DVec3;

/// How many: they lie about 13° apart.
pub const DIRECTIONS: usize = 256;

/// Half the angle of the cone that a view sees, radians: 25°.
const CONE: f64 = 0.436;

/// Angle within which matter looks as it did to a camera, radians: 60°.
const SAME_SIDE: f64 = 1.047;

/// Bins of a side of the cube onto which [`bin`] projects.
const SIDE: u32 = 3;

/// [`DIRECTIONS`] directions, and which are near which.
pub struct Directions {
    all: Vec<DVec3>,
    /// Those a camera sees that looks along a direction, itself among them.
    pub cone: Vec<Vec<usize>>,
    /// Those that differ little, itself among them.
    pub near: Vec<Vec<usize>>,
    /// The [`bin`]s of directions on the same side of a surface.
    pub same_side: Vec<u64>,
}

impl Directions {
    /// Those that differ by less than `angle` (radians) are near.
    pub fn new(angle: f64) -> Directions {
        let all: Vec<DVec3> = (0..DIRECTIONS).map(spiral).collect();
        let within = |angle: f64| -> Vec<Vec<usize>> {
            all.iter().map(|direction| indices_within(&all, *direction, angle)).collect()
        };
        let bins: Vec<DVec3> = (0..6 * SIDE * SIDE).map(bin_centre).collect();
        let same_side = all.iter().map(|direction| {
            let own = indices_within(&bins, *direction, SAME_SIDE);
            own.into_iter().fold(0, |mask, bin| mask | 1 << bin)
        });
        Directions { same_side: same_side.collect(), cone: within(CONE), near: within(angle), all }
    }

    /// The directions, unit vectors.
    pub fn all(&self) -> &[DVec3] {
        &self.all
    }

    /// Indices of those that differ by less than `angle` (radians) from a direction.
    pub fn within(&self, direction: DVec3, angle: f64) -> Vec<usize> {
        indices_within(&self.all, direction, angle)
    }
}

fn indices_within(all: &[DVec3], direction: DVec3, angle: f64) -> Vec<usize> {
    let min = angle.cos();
    (0..all.len()).filter(|i| all[*i].dot(direction) > min).collect()
}

/// Direction `i` of a Fibonacci spiral.
fn spiral(i: usize) -> DVec3 {
    /// π (3 − √5).
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
    let (sin, cos) = (GOLDEN_ANGLE * i as f64).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// Which of 54 bins a direction is in: the side of a cube that it meets, and the place on that side.
pub fn bin(direction: DVec3) -> u32 {
    let [x, y, z] = direction.to_array();
    let (axis, along, u, v) = match direction.abs().to_array() {
        [a, b, c] if a >= b && a >= c => (0, x, y, z),
        [_, b, c] if b >= c => (1, y, z, x),
        _ => (2, z, x, y),
    };
    let third = |v: f64| (f64::from(SIDE) * 0.5 * (v / along.abs() + 1.0)).clamp(0.0, 2.0) as u32;
    ((2 * axis + u32::from(along < 0.0)) * SIDE + third(u)) * SIDE + third(v)
}

fn bin_centre(bin: u32) -> DVec3 {
    let (side, u, v) = (bin / (SIDE * SIDE), bin / SIDE % SIDE, bin % SIDE);
    let along = if side.is_multiple_of(2) { 1.0 } else { -1.0 };
    let middle = |at: u32| (2.0 * f64::from(at) + 1.0) / f64::from(SIDE) - 1.0;
    let (u, v) = (middle(u), middle(v));
    let direction = match side / 2 {
        0 => DVec3::new(along, u, v),
        1 => DVec3::new(v, along, u),
        _ => DVec3::new(u, v, along),
    };
    direction.normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_hold_the_directions_near_their_middles() {
        for own in 0..54 {
            assert_eq!(bin(bin_centre(own)), own);
        }
        let directions = Directions::new(0.35);
        for direction in directions.all() {
            let angle = bin_centre(bin(*direction)).angle_between(*direction);
            assert!(angle < 0.45, "{direction}: {angle}");
        }
    }

    #[test]
    fn directions_lie_all_around() {
        let directions = Directions::new(0.35);
        for (i, direction) in directions.all().iter().enumerate() {
            assert!((direction.length() - 1.0).abs() < 1e-12);
            assert!(directions.near[i].contains(&i) && directions.near[i].len() >= 5);
            assert!(directions.cone[i].len() >= directions.near[i].len());
            // A cap of 60° holds a quarter of all directions, 13.5 of the bins.
            assert!((9..=19).contains(&directions.same_side[i].count_ones()));
        }
    }
}
