//! Where a prior's matter is: a grid of cells, and rays through it.

use glam::{DMat3, DQuat, DVec3};

use nvsprior::prior::Splats;

/// A splat counts as matter in points at which its own alpha is above this.
const SOLID: f64 = 0.3;

/// Cells along the longest side of the box that holds most of the splats.
const CELLS: f64 = 64.0;

/// Most cells along a side of the grid, with room for cameras that stand outside of that box.
const MAX_CELLS: f64 = 96.0;

/// Share of the splats left out at either end of an axis.
const STRAYS: f64 = 0.01;

/// How far the grid goes beyond that box at either end, as a share of the box's longest side: walls
/// lie in the share that the box leaves out.
const MARGIN: f64 = 0.1;

/// Most points at which extents of splats are tested. After that only the centre of a splat counts.
const MAX_POINTS: usize = 30_000_000;

/// Cells that hold matter or do not.
pub struct Grid {
    low: DVec3,
    /// Side of a cell, the prior's unit.
    pub cell: f64,
    size: [usize; 3],
    occupied: Vec<bool>,
    /// Least and greatest coordinates of most splats.
    bounds: [DVec3; 2],
}

/// Where a ray meets matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub cell: usize,
    /// Distance from the ray's origin to the cell, the prior's unit.
    pub distance: f64,
}

impl Grid {
    /// Makes a grid of a prior's splats. It is large enough for all `cameras` that are no farther from most of the
    /// splats than the splats' own extent. `None` if the splats have no extent, or none is opaque enough.
    pub fn of(splats: &Splats, cameras: &[DVec3]) -> Option<Grid> {
        let solid = |i: &usize| splats.opacity(*i) > SOLID;
        let solid: Vec<usize> = (0..splats.len()).filter(solid).collect();
        let [low, high] = bounds(splats, &solid)?;
        let longest = (high - low).max_element();
        if !(longest > 0.0) {
            return None;
        }
        let near = |c: &&DVec3| c.cmpge(low - longest).all() && c.cmple(high + longest).all();
        let (mut min, mut max) = (low - MARGIN * longest, high + MARGIN * longest);
        for camera in cameras.iter().filter(near) {
            min = min.min(*camera - MARGIN * longest);
            max = max.max(*camera + MARGIN * longest);
        }
        let cell = (longest / CELLS).max((max - min).max_element() / MAX_CELLS);
        let size = ((max - min) / cell).to_array().map(|v| v.ceil().max(1.0) as usize);
        let occupied = vec![false; size.iter().product()];
        let mut grid = Grid { low: min, cell, size, occupied, bounds: [low, high] };
        grid.fill(splats, &solid);
        Some(grid)
    }

    /// Marks the cells that hold matter of the splats: all centres first, then extents.
    fn fill(&mut self, splats: &Splats, solid: &[usize]) {
        for i in solid {
            self.occupy(DVec3::from(splats.positions[*i].map(f64::from)));
        }
        let mut left = MAX_POINTS;
        for i in solid {
            left = left.saturating_sub(self.fill_extent(splats, *i, left));
            if left == 0 {
                break;
            }
        }
    }

    /// Marks the cells within a splat's ellipsoid of alpha above [`SOLID`], unless that takes more than `max` points.
    /// Returns how many points it took.
    fn fill_extent(&mut self, splats: &Splats, i: usize, max: usize) -> usize {
        let radius = (2.0 * (splats.opacity(i) / SOLID).ln()).sqrt();
        let [w, x, y, z] = splats.unit_rotation(i).map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let radii = splats.log_scales[i].map(|s| radius * f64::from(s).exp());
        // Points are less than a cell apart. A splat larger than the grid has its points all over it.
        let steps = radii.map(|r| match r / self.cell {
            r if r < 0.5 => 0,
            r => r.min(MAX_CELLS).ceil() as i32,
        });
        let points: usize = steps.iter().map(|n| 2 * *n as usize + 1).product();
        if points == 1 || points > max {
            return 1;
        }
        let reach = radii.map(|r| r.min(MAX_CELLS * self.cell));
        let share = |k: usize, at: i32| reach[k] * f64::from(at) / f64::from(steps[k].max(1));
        let centre = DVec3::from(splats.positions[i].map(f64::from));
        for a in -steps[0]..=steps[0] {
            for b in -steps[1]..=steps[1] {
                for c in -steps[2]..=steps[2] {
                    let own = DVec3::new(share(0, a), share(1, b), share(2, c));
                    if (own / DVec3::from(radii)).length_squared() <= 1.0 {
                        self.occupy(centre + rotation * own);
                    }
                }
            }
        }
        points
    }

    fn occupy(&mut self, place: DVec3) {
        if let Some(cell) = self.cell_at(place) {
            self.occupied[cell] = true;
        }
    }

    pub fn len(&self) -> usize {
        self.occupied.len()
    }

    /// Cells along each axis.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    fn cell_at(&self, place: DVec3) -> Option<usize> {
        let at = ((place - self.low) / self.cell).floor();
        let size = DVec3::from(self.size.map(|n| n as f64));
        let within = at.cmpge(DVec3::ZERO).all() && at.cmplt(size).all();
        within.then(|| self.index(at.to_array().map(|v| v as usize)))
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Where a cell is along each axis.
    pub fn at(&self, cell: usize) -> [usize; 3] {
        let [x, y, _] = self.size;
        [cell % x, cell / x % y, cell / (x * y)]
    }

    pub fn centre(&self, cell: usize) -> DVec3 {
        self.low + self.cell * (DVec3::from(self.at(cell).map(|v| v as f64)) + 0.5)
    }

    /// Whether most splats reach as far as a cell.
    pub fn within_bounds(&self, cell: usize) -> bool {
        let (centre, [low, high]) = (self.centre(cell), self.bounds);
        centre.cmpge(low).all() && centre.cmple(high).all()
    }

    /// Whether there is no matter in the cell and its 26 neighbours.
    pub fn clear(&self) -> Vec<bool> {
        let mut near = self.occupied.clone();
        // Along one axis after the other.
        let strides = [1, self.size[0], self.size[0] * self.size[1]];
        for (axis, stride) in strides.into_iter().enumerate() {
            let before = near.clone();
            for (cell, near) in near.iter_mut().enumerate() {
                let place = cell / stride % self.size[axis];
                *near |= place > 0 && before[cell - stride];
                *near |= place + 1 < self.size[axis] && before[cell + stride];
            }
        }
        near.iter().map(|near| !near).collect()
    }

    /// Leaves only the largest connected part of the cells marked in `kept`.
    pub fn keep_largest_part(&self, kept: &mut [bool]) {
        let mut part = vec![0_u32; self.len()];
        let (mut largest, mut count) = ((0, 0), 0);
        let strides = [1, self.size[0], self.size[0] * self.size[1]];
        for first in 0..self.len() {
            if !kept[first] || part[first] != 0 {
                continue;
            }
            count += 1;
            part[first] = count;
            let (mut open, mut cells) = (vec![first], 0_usize);
            while let Some(cell) = open.pop() {
                cells += 1;
                let at = self.at(cell);
                for axis in 0..3 {
                    let back = (at[axis] > 0).then(|| cell - strides[axis]);
                    let on = (at[axis] + 1 < self.size[axis]).then(|| cell + strides[axis]);
                    for next in back.into_iter().chain(on) {
                        if kept[next] && part[next] == 0 {
                            part[next] = count;
                            open.push(next);
                        }
                    }
                }
            }
            if cells > largest.0 {
                largest = (cells, count);
            }
        }
        kept.iter_mut().zip(part).for_each(|(kept, part)| *kept &= part == largest.1);
    }

    /// Finds the first matter on a ray, no farther than `reach`, and gives every cell before it to
    /// `passed`. A ray that begins in matter leaves it first. `along` has length 1.
    ///
    /// Visits every cell that the ray meets (Amanatides and Woo, A Fast Voxel Traversal Algorithm for
    /// Ray Tracing, 1987).
    pub fn march(
        &self,
        from: DVec3,
        along: DVec3,
        reach: f64,
        mut passed: impl FnMut(usize),
    ) -> Option<Hit> {
        let origin = (from - self.low) / self.cell;
        let size = DVec3::from(self.size.map(|n| n as f64));
        let (begin, end) = within_box(origin, along, size)?;
        let end = end.min(reach / self.cell);
        let mut at = (origin + begin * along).floor().clamp(DVec3::ZERO, size - 1.0).to_array();
        let ahead = |k: usize, at: f64| {
            let next = at + if along[k] > 0.0 { 1.0 } else { 0.0 };
            if along[k] == 0.0 { f64::INFINITY } else { (next - origin[k]) / along[k] }
        };
        let (mut t, mut free) = (begin, false);
        while t <= end {
            let cell = self.index(at.map(|v| v as usize));
            if self.occupied[cell] && free {
                return Some(Hit { cell, distance: t * self.cell });
            }
            if !self.occupied[cell] {
                free = true;
                passed(cell);
            }
            let next = [0, 1, 2].map(|k| ahead(k, at[k]));
            let axis = (0..3).min_by(|a, b| next[*a].total_cmp(&next[*b]))?;
            t = next[axis];
            at[axis] += along[axis].signum();
            if !(at[axis] >= 0.0 && at[axis] < size[axis]) {
                return None;
            }
        }
        None
    }
}

/// The two distances at which a ray enters and leaves the box from 0 to `size`; `None` if it misses the box.
fn within_box(origin: DVec3, along: DVec3, size: DVec3) -> Option<(f64, f64)> {
    let (mut begin, mut end) = (0.0_f64, f64::INFINITY);
    for k in 0..3 {
        if along[k] == 0.0 {
            if !(0.0..size[k]).contains(&origin[k]) {
                return None;
            }
            continue;
        }
        let (a, b) = (-origin[k] / along[k], (size[k] - origin[k]) / along[k]);
        begin = begin.max(a.min(b));
        end = end.min(a.max(b));
    }
    (begin < end && end.is_finite()).then_some((begin, end))
}

/// Least and greatest coordinates of the named splats, without strays.
fn bounds(splats: &Splats, named: &[usize]) -> Option<[DVec3; 2]> {
    let last = named.len().checked_sub(1)?;
    let strays = (STRAYS * last as f64) as usize;
    let mut ends = [DVec3::ZERO; 2];
    for axis in 0..3 {
        let mut values: Vec<f32> = named.iter().map(|i| splats.positions[*i][axis]).collect();
        for (end, nth) in ends.iter_mut().zip([strays, last - strays]) {
            end[axis] = f64::from(*values.select_nth_unstable_by(nth, f32::total_cmp).1);
        }
    }
    Some(ends)
}
