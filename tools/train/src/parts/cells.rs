//! Places of the world, each of which belongs to one part.

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// A run that has fewer places than it should have parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{pictures} pictures cannot be divided into {parts} parts with one place each that a picture was taken from: \
        take fewer parts"
)]
pub struct PartsError {
    pub parts: usize,
    pub pictures: usize,
}

/// A division of all places among parts, by planes between cameras.
#[derive(Clone, Debug)]
pub enum Cells {
    /// All places belong to this part.
    Part(usize),
    /// Places before a plane, and all others.
    Divided(Box<Plane>),
}

/// A plane, and what lies on either side.
#[derive(Clone, Debug)]
pub struct Plane {
    normal: DVec3,
    at: f64,
    before: Cells,
    behind: Cells,
}

impl Cells {
    /// Divides cameras into parts of about as many, across the direction in which they lie farthest apart. Each part
    /// has one camera at least.
    pub fn of(cameras: &[DVec3], parts: usize) -> Result<Cells, PartsError> {
        let error = PartsError { parts, pictures: cameras.len() };
        if parts == 0 {
            return Err(error);
        }
        Cells::divide(cameras.to_vec(), 0..parts).ok_or(error)
    }

    /// `None`: a part would have no camera.
    fn divide(mut cameras: Vec<DVec3>, parts: std::ops::Range<usize>) -> Option<Cells> {
        if parts.len() == 1 {
            return (!cameras.is_empty()).then_some(Cells::Part(parts.start));
        }
        if cameras.len() < parts.len() {
            return None;
        }
        let normal = longest_direction(&cameras);
        let along = |camera: &DVec3| camera.dot(normal);
        cameras.sort_by(|a, b| along(a).total_cmp(&along(b)));
        let middle = parts.start + parts.len() / 2;
        let first = cameras.len() * (parts.len() / 2) / parts.len();
        let at = 0.5 * (along(&cameras[first - 1]) + along(&cameras[first]));
        let (before, behind): (Vec<_>, Vec<_>) = cameras.iter().partition(|c| along(c) < at);
        let before = Cells::divide(before, parts.start..middle)?;
        let behind = Cells::divide(behind, middle..parts.end)?;
        Some(Cells::Divided(Box::new(Plane { normal, at, before, behind })))
    }

    /// The part that a place belongs to.
    pub fn part(&self, place: DVec3) -> usize {
        let mut cells = self;
        loop {
            match cells {
                Cells::Part(part) => return *part,
                Cells::Divided(plane) if place.dot(plane.normal) < plane.at => {
                    cells = &plane.before
                }
                Cells::Divided(plane) => cells = &plane.behind,
            }
        }
    }
}

/// The direction in which places lie farthest apart, by their variance.
fn longest_direction(places: &[DVec3]) -> DVec3 {
    let middle = places.iter().sum::<DVec3>() / places.len() as f64;
    let mut spread = Matrix3::zeros();
    for place in places {
        let away = Vector3::from((*place - middle).to_array());
        spread += away * away.transpose();
    }
    let eigen = SymmetricEigen::new(spread);
    let direction = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    DVec3::new(direction[0], direction[1], direction[2])
}
