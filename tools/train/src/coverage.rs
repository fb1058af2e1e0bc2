//! Key frames that cover the free volume of a prior: wherever a camera is lost, a key frame is near that looks in the
//! same direction at the same matter.
//!
//! The free volume is divided into views: places times directions. Each place stands for a block of cells. Each view
//! has a depth, that of the matter in the middle of its picture. A key frame covers the views around it. The next key
//! frame is always the one that covers most of the views that are left, weighted by the detail in which they were seen
//! (the greedy method for maximum coverage, Nemhauser, Wolsey and Fisher 1978).

mod directions;
mod grid;
mod seen;

use std::collections::BinaryHeap;

use glam::{DMat3, DQuat, DVec3};

use nvsprior::prior::{KeyFrames, PriorError};
use nvsprior::{Pose, Prior};

use directions::{DIRECTIONS, Directions};
use grid::{Grid, Hit};
use seen::SeenMatter;
pub(crate) use seen::median;

/// Largest distance between a view and a key frame that covers it, as a share of the lesser of their depths.
const DISTANCE: f64 = 0.35;

/// Largest angle between their directions, radians: 20°.
const ANGLE: f64 = 0.349;

/// Most places that stand for the free volume.
const MAX_PLACES: usize = 4000;

/// Most views that are candidates for key frames in one round.
const MAX_CANDIDATES: usize = 16_384;

/// Share of the middle of a picture that must show known matter.
const ENOUGH: f64 = 0.6;

/// Share of all directions in which a place must see matter, if no camera vouches for it.
const ENOUGH_AROUND: f64 = 0.3;

/// Least distance of a view's matter, cells. The grid does not resolve nearer matter.
const NEAREST: f64 = 2.0;

/// Key frames that cover a free volume, and how well.
#[derive(Clone, Debug, PartialEq)]
pub struct Covering {
    /// The seeds, then those that were added.
    pub key_frames: KeyFrames,
    pub added: usize,
    /// Views that stand for the free volume.
    pub views: usize,
    /// How many of them have a key frame near.
    pub covered: usize,
}

impl Covering {
    /// Share of the views that have a key frame near; `None` if there are no views.
    pub fn share(&self) -> Option<f64> {
        (self.views > 0).then(|| self.covered as f64 / self.views as f64)
    }
}

/// Chooses key frames so that each view of the free volume has one within 0.35 of its depth and 20° of its
/// direction. Chooses at most `max` in all, the most useful first. Keeps all `seeds`, in front.
///
/// Seeds are poses, world to camera, from which the prior was made. If there are seeds, a view counts only if a
/// seed saw through its place or stood near, and if a seed saw most of what it looks at from the same side and not
/// from much farther away. What the seeds saw in most detail is covered first. Seeds are assumed to see 70° by 44°.
/// If there are no seeds, views count in the largest connected part of the free volume within the splats' 1 to 99 %
/// of each axis, unless they see little. That is wrong for a hollow object with nothing around it: there the
/// largest part is the inside.
///
/// The same input gives the same key frames. A prior without extent, or with faint splats only, has no views. Fails
/// if [`KeyFrames::new`] refuses the seeds.
pub fn covering(prior: &Prior, seeds: &[Pose], max: usize) -> Result<Covering, PriorError> {
    let seeds = KeyFrames::new(seeds.to_vec())?;
    let max = max.min(KeyFrames::MAX);
    let centres: Vec<DVec3> = seeds.poses().iter().map(Pose::centre).collect();
    let Some(grid) = Grid::of(prior.splats(), &centres) else {
        return Ok(Covering { key_frames: seeds, added: 0, views: 0, covered: 0 });
    };
    let mut views = Views::of(&grid, seeds.poses());
    for pose in seeds.poses() {
        if let Some(depth) = seen::depth(&grid, pose) {
            views.cover_from(pose.centre(), viewing_direction(pose), depth);
        }
    }
    let added = views.choose(max.saturating_sub(seeds.len()), up(seeds.poses()));
    let poses = seeds.poses().iter().copied().chain(added.iter().copied());
    let key_frames = KeyFrames::new(poses.collect())?;
    let (count, left) = (views.count, views.left());
    Ok(Covering { key_frames, added: added.len(), views: count, covered: count - left })
}

/// The direction that is up in most poses' pictures; +z if there are none.
fn up(poses: &[Pose]) -> DVec3 {
    let sum: DVec3 = poses.iter().map(|pose| pose.rotation.conjugate() * DVec3::NEG_Y).sum();
    sum.try_normalize().unwrap_or(DVec3::Z)
}

/// The camera's optical axis in the world, `Rᵀ (0, 0, 1)`.
fn viewing_direction(pose: &Pose) -> DVec3 {
    pose.rotation.conjugate() * DVec3::Z
}

/// The pose of a camera that stands at `centre` and looks along a direction.
fn looking(centre: DVec3, forward: DVec3, up: DVec3) -> Pose {
    let right = forward.cross(up);
    let right = match right.length() > 1e-3 {
        true => right.normalize(),
        false => forward.any_orthonormal_vector(),
    };
    let to_world = DMat3::from_cols(right, forward.cross(right), forward);
    Pose::from_centre(DQuat::from_mat3(&to_world.transpose()).normalize(), centre)
}

/// What a camera may see from the free volume.
struct Views {
    places: Vec<DVec3>,
    directions: Directions,
    /// By place, then direction; 0 if the view does not count or is covered.
    open: Vec<f32>,
    /// By place, then direction; 0 if the view does not count.
    depths: Vec<f32>,
    /// By place, then direction: how many rays of seeds met a cell that the view shows, the median over its cells; 1 if
    /// there are no seeds.
    weights: Vec<u32>,
    count: usize,
    blocks: Blocks,
}

impl Views {
    fn of(grid: &Grid, seeds: &[Pose]) -> Views {
        let directions = Directions::new(ANGLE);
        let seen = (!seeds.is_empty()).then(|| SeenMatter::of(grid, seeds, &directions));
        let mut free = grid.clear();
        match &seen {
            Some(seen) => free.iter_mut().zip(&seen.through).for_each(|(a, b)| *a &= b),
            None => {
                free.iter_mut().enumerate().for_each(|(i, free)| *free &= grid.within_bounds(i));
                grid.keep_largest_part(&mut free);
            }
        }
        let blocks = Blocks::of(grid, &free);
        let places: Vec<DVec3> = blocks.chosen.iter().map(|cell| grid.centre(*cell)).collect();
        let look = |place: &DVec3| views_from(grid, *place, seen.as_ref(), &directions);
        let (depths, weights): (Vec<f32>, Vec<u32>) = places.iter().flat_map(look).unzip();
        let count = depths.iter().filter(|depth| **depth > 0.0).count();
        Views { places, directions, open: depths.clone(), depths, weights, count, blocks }
    }

    /// How many views have no key frame near.
    fn left(&self) -> usize {
        self.open.iter().filter(|depth| **depth > 0.0).count()
    }

    /// Chooses up to `max` key frames, and covers what is near them.
    fn choose(&mut self, max: usize, up: DVec3) -> Vec<Pose> {
        let mut chosen = Vec::new();
        while chosen.len() < max {
            let left = self.left();
            let every = left.div_ceil(MAX_CANDIDATES).max(1);
            let open = (0..self.open.len()).filter(|view| self.open[*view] > 0.0);
            let candidates: Vec<usize> = open.step_by(every).collect();
            if candidates.is_empty() {
                break;
            }
            self.choose_of(&candidates, max, up, &mut chosen);
        }
        chosen
    }

    /// Chooses among candidates until all of them are covered. A candidate's gain only falls as
    /// others are chosen, so only the greatest gain is computed again (Minoux 1978).
    fn choose_of(&mut self, candidates: &[usize], max: usize, up: DVec3, chosen: &mut Vec<Pose>) {
        let key = |gain: u64, view: usize| (gain, std::cmp::Reverse(view));
        let mut heap: BinaryHeap<_> =
            candidates.iter().map(|view| key(self.gain(*view), *view)).collect();
        while let Some((_, std::cmp::Reverse(view))) = heap.pop() {
            if chosen.len() >= max {
                return;
            }
            if self.open[view] == 0.0 {
                continue;
            }
            let gain = self.gain(view);
            if heap.peek().is_some_and(|next| *next > key(gain, view)) {
                heap.push(key(gain, view));
                continue;
            }
            let (place, direction) = (view / DIRECTIONS, view % DIRECTIONS);
            let (centre, forward) = (self.places[place], self.directions.all()[direction]);
            let pose = looking(centre, forward, up);
            let depth = self.depths[view].into();
            self.cover_from(centre, forward, depth);
            // A view that f32 does not reach stays without.
            self.open[view] = 0.0;
            if KeyFrames::new(vec![pose]).is_ok() {
                chosen.push(pose);
            }
        }
    }

    /// Weight of the open views that a key frame at a view would cover.
    fn gain(&self, view: usize) -> u64 {
        let (place, direction) = (self.places[view / DIRECTIONS], view % DIRECTIONS);
        let mut gain = 0;
        self.near(place, self.depths[view].into(), |other, distance| {
            let own = &self.open[other * DIRECTIONS..][..DIRECTIONS];
            let weights = &self.weights[other * DIRECTIONS..][..DIRECTIONS];
            let covered = |d: &&usize| distance < DISTANCE * f64::from(own[**d]);
            let near = self.directions.near[direction].iter().filter(covered);
            gain += near.map(|d| u64::from(weights[*d])).sum::<u64>();
        });
        gain
    }

    /// Covers the views near a key frame that looks at matter at a depth.
    fn cover_from(&mut self, centre: DVec3, forward: DVec3, depth: f64) {
        let directions = self.directions.within(forward, ANGLE);
        let mut near = Vec::new();
        self.near(centre, depth, |place, distance| near.push((place, distance)));
        for (place, distance) in near {
            let own = &mut self.open[place * DIRECTIONS..][..DIRECTIONS];
            for direction in &directions {
                if distance < DISTANCE * f64::from(own[*direction]) {
                    own[*direction] = 0.0;
                }
            }
        }
    }

    /// Visits the places that a key frame covers by its own depth, with their distances.
    fn near(&self, centre: DVec3, depth: f64, mut visit: impl FnMut(usize, f64)) {
        let reach = DISTANCE * depth;
        self.blocks.within(centre, reach, |place| {
            let distance = centre.distance(self.places[place]);
            if distance < reach {
                visit(place, distance);
            }
        });
    }
}

/// Depths and weights of the views from a place, by direction: medians over the middle of the
/// picture; 0 if the matter there is too little, unknown or too near.
fn views_from(
    grid: &Grid,
    place: DVec3,
    seen: Option<&SeenMatter>,
    directions: &Directions,
) -> Vec<(f32, u32)> {
    let look = |(i, along): (usize, &DVec3)| {
        let hit = grid.march(place, *along, f64::INFINITY, |_| ())?;
        let known = seen.is_none_or(|seen| seen.knows(&hit, directions.same_side[i]));
        known.then_some(hit)
    };
    let hits: Vec<Option<Hit>> = directions.all().iter().enumerate().map(look).collect();
    let around = hits.iter().flatten().count();
    if seen.is_none() && (around as f64) < ENOUGH_AROUND * hits.len() as f64 {
        return vec![(0.0, 0); hits.len()];
    }
    let view = |cone: &Vec<usize>| {
        let shown: Vec<Hit> = cone.iter().filter_map(|i| hits[*i]).collect();
        let enough = shown.len() as f64 >= ENOUGH * cone.len() as f64;
        let depth = median(shown.iter().map(|hit| hit.distance).collect());
        let Some(depth) = depth.filter(|depth| enough && *depth >= NEAREST * grid.cell) else {
            return (0.0, 0);
        };
        let detail = |seen: &SeenMatter| {
            let rays = shown.iter().map(|hit| f64::from(seen.rays(hit.cell))).collect();
            median(rays).map_or(1, |rays| rays as u32)
        };
        (depth as f32, seen.map_or(1, detail))
    };
    directions.cone.iter().map(view).collect()
}

/// Blocks of cells, one free cell of each its place.
struct Blocks {
    /// Blocks along each axis.
    size: [usize; 3],
    /// Index of each block's place, if it has one.
    place: Vec<Option<u32>>,
    chosen: Vec<usize>,
    /// Centre of block 0, and a block's side, the prior's unit.
    low: DVec3,
    length: f64,
}

impl Blocks {
    /// The smallest blocks with which no more than [`MAX_PLACES`] have a free cell.
    fn of(grid: &Grid, free: &[bool]) -> Blocks {
        let mut side = 1;
        loop {
            let blocks = Blocks::of_side(grid, free, side);
            if blocks.chosen.len() <= MAX_PLACES {
                return blocks;
            }
            side += 1;
        }
    }

    fn of_side(grid: &Grid, free: &[bool], side: usize) -> Blocks {
        let size = grid.size().map(|n| n.div_ceil(side));
        // The free cell nearest the middle: by its distance in half cells, squared.
        let mut best: Vec<Option<(usize, usize)>> = vec![None; size.iter().product()];
        for cell in (0..free.len()).filter(|cell| free[*cell]) {
            let at = grid.at(cell);
            let off = at.map(|v| (2 * (v % side) + 1).abs_diff(side).pow(2)).iter().sum();
            let [x, y, z] = at.map(|v| v / side);
            let best = &mut best[(z * size[1] + y) * size[0] + x];
            if best.is_none_or(|(other, _)| off < other) {
                *best = Some((off, cell));
            }
        }
        let mut chosen = Vec::new();
        let mut number = |(_, cell)| {
            chosen.push(cell);
            chosen.len() as u32 - 1
        };
        let place = best.into_iter().map(|best| best.map(&mut number)).collect();
        let length = side as f64 * grid.cell;
        let low = grid.centre(0) + 0.5 * (length - grid.cell);
        Blocks { size, place, chosen, low, length }
    }

    /// Visits the places of the blocks that come within `reach` of a point.
    fn within(&self, point: DVec3, reach: f64, mut visit: impl FnMut(usize)) {
        let at = ((point - self.low) / self.length).to_array();
        let blocks = reach / self.length + 0.5;
        let range = |k: usize| {
            let end = self.size[k] as f64;
            let first = (at[k] - blocks).ceil().clamp(0.0, end) as usize;
            let last = ((at[k] + blocks).floor() + 1.0).clamp(0.0, end) as usize;
            first..last
        };
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    if let Some(place) = self.place[(z * self.size[1] + y) * self.size[0] + x] {
                        visit(place as usize);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
