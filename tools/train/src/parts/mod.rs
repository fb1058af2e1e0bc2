//! A mapping run in parts, each trained by itself, so that memory is that of one part.
//!
//! Block-wise training of large scenes (VastGaussian, CityGaussian, Hierarchical 3D Gaussians) divides space into cells
//! by the cameras, trains each on the pictures that show it, and keeps the splats inside. So does this:
//!
//! - A *cell* is what lies between planes across the run; it is never bounded on the outside, so each place is in one.
//! - A part is trained on the pictures that were taken in its cell, and on all others that show a share of it. So what
//!   lies beside the border is trained on as many pictures as in one training of the whole run.
//! - A splat is kept by the part whose cell it lies in, if that part's pictures have it in view. If none of them has,
//!   the part of the nearest picture that has it in view keeps it. That depends on the place alone, so no place is kept
//!   twice, and none that a picture shows is left out.

mod cells;
mod view;

use crate::trainer::SH_0;
use glam::DVec3;
use nvsprior::Pose;
use nvsprior::prior::Splats;
use rayon::prelude::*;

use crate::mapper::ColouredPoint;
pub use cells::{Cells, PartsError};
pub use view::View;

/// A picture trains each part that takes at least this share of what it shows.
const SHARE: f64 = 0.1;
/// Fields of a picture, by which shares are counted: across and down.
const FIELDS: [usize; 2] = [32, 18];
/// Fainter splats of a coarse prior are no points.
const FAINT: f64 = 0.1;

/// Which pictures a part is trained on, and which places it keeps.
#[derive(Clone, Debug)]
pub struct Parts {
    cells: Cells,
    views: Vec<View>,
    near: f64,
    /// By part: the pictures that it is trained on, by number.
    pictures: Vec<Vec<usize>>,
}

impl Parts {
    /// `views`: the run's pictures; `points`: of its scene, by which is told what pictures show; `near`: the least
    /// depth that they show.
    pub fn new(cells: Cells, parts: usize, views: Vec<View>, points: &[DVec3], near: f64) -> Parts {
        let mut own = Parts { cells, views, near, pictures: vec![Vec::new(); parts] };
        let of_points: Vec<usize> = points.iter().map(|point| own.cells.part(*point)).collect();
        let trains = |view: &View| own.trains(view, points, &of_points);
        let by_picture: Vec<Vec<usize>> = own.views.par_iter().map(trains).collect();
        for (picture, parts) in by_picture.iter().enumerate() {
            parts.iter().for_each(|part| own.pictures[*part].push(picture));
        }
        own
    }

    /// The parts that a picture trains: that which it was taken in, and those that take a share of it.
    fn trains(&self, view: &View, points: &[DVec3], of_points: &[usize]) -> Vec<usize> {
        let mut nearest = vec![None; FIELDS[0] * FIELDS[1]];
        for (point, part) in points.iter().zip(of_points) {
            let Some(shown) = view.of(*point, self.near) else { continue };
            let [across, down] = [0, 1].map(|i| (shown.at[i] * FIELDS[i] as f64) as usize);
            let field = &mut nearest[down * FIELDS[0] + across];
            if field.is_none_or(|(depth, _)| shown.depth < depth) {
                *field = Some((shown.depth, *part));
            }
        }
        let mut fields = vec![0; self.count()];
        nearest.iter().flatten().for_each(|(_, part)| fields[*part] += 1);
        let all: usize = fields.iter().sum();
        let (taken_in, least) = (self.taken_in(&view.pose), SHARE * all as f64);
        let shows = |part: &usize| fields[*part] > 0 && fields[*part] as f64 >= least;
        (0..self.count()).filter(|part| *part == taken_in || shows(part)).collect()
    }

    pub fn count(&self) -> usize {
        self.pictures.len()
    }

    /// The pictures that a part is trained on, by number, rising; never none.
    pub fn pictures(&self, part: usize) -> &[usize] {
        &self.pictures[part]
    }

    /// The part in whose cell a picture was taken.
    pub fn taken_in(&self, pose: &Pose) -> usize {
        self.cells.part(pose.centre())
    }

    /// The parts that a picture would train that is none of the run's. More than one: it shows a border.
    pub fn shown_by(&self, view: &View, points: &[DVec3]) -> Vec<usize> {
        let of_points: Vec<usize> = points.iter().map(|point| self.cells.part(*point)).collect();
        self.trains(view, points, &of_points)
    }

    /// Whether a picture that a part is trained on has a place in view.
    pub fn sees(&self, part: usize, place: DVec3) -> bool {
        let shows = |picture: &usize| self.views[*picture].of(place, self.near).is_some();
        self.pictures[part].iter().any(shows)
    }

    /// The part that keeps what lies at a place.
    pub fn keeper(&self, place: DVec3) -> usize {
        let inside = self.cells.part(place);
        if self.sees(inside, place) {
            return inside;
        }
        let depth = |picture: &usize| Some(self.views[*picture].of(place, self.near)?.depth);
        let nearest = |part: usize| {
            let depths = self.pictures[part].iter().filter_map(depth);
            Some((depths.min_by(f64::total_cmp)?, part))
        };
        let seen = (0..self.count()).filter_map(nearest);
        seen.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(inside, |(_, part)| part)
    }

    /// Which of the splats that a part was trained to it keeps.
    pub fn kept(&self, part: usize, splats: &Splats) -> Vec<bool> {
        let keeps = |position: &[f32; 3]| self.keeper(place_of(*position)) == part;
        splats.positions.par_iter().map(keeps).collect()
    }

    /// The points that a part's pictures have in view.
    pub fn points_of(&self, part: usize, points: &[ColouredPoint]) -> Vec<ColouredPoint> {
        let seen = |point: &&ColouredPoint| self.sees(part, place_of(point.position));
        points.par_iter().filter(seen).copied().collect()
    }
}

fn place_of(position: [f32; 3]) -> DVec3 {
    DVec3::from(position.map(f64::from))
}

/// The places of points.
pub fn places(points: &[ColouredPoint]) -> Vec<DVec3> {
    points.iter().map(|point| place_of(point.position)).collect()
}

/// The splats of a coarse prior as points, without the faint ones.
pub fn points_of_splats(splats: &Splats) -> Vec<ColouredPoint> {
    let stride = splats.sh_stride();
    let shown = (0..splats.len()).filter(|i| splats.opacity(*i) >= FAINT);
    let point = |i: usize| {
        let sh = &splats.sh[i * stride..][..3];
        let rgb = [0, 1, 2].map(|k| (0.5 + SH_0 * sh[k]).clamp(0.0, 1.0));
        ColouredPoint { position: splats.positions[i], rgb }
    };
    shown.map(point).collect()
}

#[cfg(test)]
mod tests;
