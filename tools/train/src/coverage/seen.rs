//! What the cameras of a mapping run saw of a prior, and the free cells that they saw through.

use glam::DVec3;

use nvsprior::Pose;

use super::directions::{Directions, bin};
use super::grid::{Grid, Hit};

/// Half the width and height of the view that cameras are assumed to have, as tangents: ±35° and ±22°.
const FRUSTUM: [f64; 2] = [0.700, 0.404];

/// Rays across and down that stand for a picture.
const RAYS: [u32; 2] = [64, 40];

/// Fewer rays, for the depth of a picture only.
const FEW_RAYS: [u32; 2] = [16, 10];

/// Most cameras that are used, evenly spaced in their list.
const MAX_CAMERAS: usize = 1000;

/// Free cells this near to a camera count even if it looks elsewhere; as a share of the depth of its picture.
const NEIGHBOURHOOD: f64 = 0.35;

/// How near to matter a view may be, as a share of the distance of the nearest camera that saw the
/// matter: the prior has no finer detail than that camera's picture.
const NEARER: f64 = 0.4;

/// What cameras saw, by cell.
pub struct SeenMatter {
    /// Whether a camera saw through the cell, or stood near.
    pub through: Vec<bool>,
    /// The [`bin`]s of the directions in which the matter in the cell was seen.
    directions: Vec<u64>,
    /// Least distance of a camera that saw the matter in the cell.
    nearest: Vec<f32>,
    /// How many rays of cameras met the matter in the cell: the detail in which it was seen.
    rays: Vec<u32>,
}

impl SeenMatter {
    /// What the poses' cameras saw; `directions` for what is beside them.
    pub fn of(grid: &Grid, poses: &[Pose], directions: &Directions) -> SeenMatter {
        let cells = grid.len();
        let mut seen = SeenMatter {
            through: vec![false; cells],
            directions: vec![0; cells],
            nearest: vec![f32::INFINITY; cells],
            rays: vec![0; cells],
        };
        for pose in poses.iter().step_by(poses.len().div_ceil(MAX_CAMERAS).max(1)) {
            let Some(depth) = seen.look(grid, pose) else { continue };
            for along in directions.all() {
                let reach = NEIGHBOURHOOD * depth;
                grid.march(pose.centre(), *along, reach, |cell| seen.through[cell] = true);
            }
        }
        seen
    }

    /// Takes in what a camera sees; the median distance to it.
    fn look(&mut self, grid: &Grid, pose: &Pose) -> Option<f64> {
        let hits = picture(grid, pose, RAYS, |cell| self.through[cell] = true);
        for (along, hit) in &hits {
            self.directions[hit.cell] |= 1 << bin(*along);
            self.nearest[hit.cell] = self.nearest[hit.cell].min(hit.distance as f32);
            self.rays[hit.cell] += 1;
        }
        median(hits.iter().map(|(_, hit)| hit.distance).collect())
    }

    /// How many rays of cameras met the matter in a cell.
    pub fn rays(&self, cell: usize) -> u32 {
        self.rays[cell]
    }

    /// Whether a camera saw what a ray meets, in a direction that is one of `bins`, and not from much
    /// farther away.
    pub fn knows(&self, hit: &Hit, bins: u64) -> bool {
        let near = NEARER * f64::from(self.nearest[hit.cell]);
        self.directions[hit.cell] & bins != 0 && hit.distance >= near
    }
}

/// Median distance to the matter that a camera sees; `None` if there is none.
pub fn depth(grid: &Grid, pose: &Pose) -> Option<f64> {
    median(picture(grid, pose, FEW_RAYS, |_| ()).iter().map(|(_, hit)| hit.distance).collect())
}

/// The upper median.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Finds where the rays of a camera's picture meet matter, with their directions. There are `width` by `height` rays.
/// Gives the cells before the matter to `passed`.
fn picture(
    grid: &Grid,
    pose: &Pose,
    [width, height]: [u32; 2],
    mut passed: impl FnMut(usize),
) -> Vec<(DVec3, Hit)> {
    let (centre, to_world) = (pose.centre(), pose.rotation.conjugate());
    let middle = |i: u32, count: u32| (2.0 * f64::from(i) + 1.0) / f64::from(count) - 1.0;
    let mut hits = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let [right, down] = [FRUSTUM[0] * middle(x, width), FRUSTUM[1] * middle(y, height)];
            let along = to_world * DVec3::new(right, down, 1.0).normalize();
            let hit = grid.march(centre, along, f64::INFINITY, &mut passed);
            hits.extend(hit.map(|hit| (along, hit)));
        }
    }
    hits
}
