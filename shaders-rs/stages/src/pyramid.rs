//! Stage `pyramid`: the levels of the camera's frame, reduced by area averaging, as floats in [0, 1]. Its light is
//! brought to the prior's. Pixels of cells that do not count are masked, and those of which the frame's mask covers a
//! part.

use crate::shared::{CELL, GROUP, LIGHT, MASKED, PyramidLevel, PyramidLevels, max};
use spirv_std::glam::{UVec3, Vec3};
use spirv_std::spirv;

/// A byte of a buffer of words.
pub fn byte(words: &[u32], at: u32) -> u32 {
    (words[(at / 4) as usize] >> (8 * (at % 4))) & 0xff
}

/// Whether a pixel of the frame is masked: bit `pixel` of the words after the first.
fn masked(mask: &[u32], pixel: u32) -> bool {
    (mask[(1 + pixel / 32) as usize] >> (pixel % 32)) & 1 == 1
}

/// A pixel of a level.
#[derive(Clone, Copy)]
struct Place {
    level: PyramidLevel,
    /// Its number in the level; at the end of a level there may be no such pixel.
    pixel: u32,
    /// Where the level's floats begin.
    offset: u32,
}

impl Place {
    /// That of an invocation of workgroup `group`: the levels take whole workgroups, one after the other.
    fn new(levels: &PyramidLevels, group: u32, lane: u32) -> Place {
        let (mut number, mut first, mut offset) = (0, 0, 0);
        let mut level = levels.levels[0];
        let mut groups = level.pixels().div_ceil(GROUP);
        while (number + 1 < levels.count) & (group >= first + groups) {
            first += groups;
            offset += 3 * level.pixels();
            number += 1;
            level = levels.levels[number as usize];
            groups = level.pixels().div_ceil(GROUP);
        }
        Place { level, pixel: (group - first) * GROUP + lane, offset }
    }
}

/// One invocation per pixel. The first word of `mask` is 0 if it masks no pixel.
#[spirv(compute(threads(256)))]
pub fn pyramid(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(push_constant)] levels: &PyramidLevels,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] bytes: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] frame: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] light: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] mask: &[u32],
) {
    let Place { level, pixel, offset } = Place::new(levels, group.y * groups.x + group.x, lane);
    if pixel >= level.pixels() {
        return;
    }
    let factor = level.factor;
    let (x, y) = (pixel % level.width, pixel / level.width);
    let (mut red, mut green, mut blue) = (0, 0, 0);
    let (has_mask, mut counts) = (mask[0] != 0, true);
    let mut row = 0;
    while row < factor {
        let mut source = (y * factor + row) * levels.frame_width + x * factor;
        let end = source + factor;
        while source < end {
            let at = source * 3;
            red += byte(bytes, at);
            green += byte(bytes, at + 1);
            blue += byte(bytes, at + 2);
            if has_mask {
                counts &= !masked(mask, source);
            }
            source += 1;
        }
        row += 1;
    }
    let scale = 1.0 / (255.0 * (factor * factor) as f32);
    let to = (offset + pixel * 3) as usize;
    // Three factors, then three summands.
    let mut rgb = Vec3::new(
        red as f32 * scale * light[0] + light[3],
        green as f32 * scale * light[1] + light[4],
        blue as f32 * scale * light[2] + light[5],
    );
    let cells = Cells { columns: light[6] as u32, rows: light[7] as u32 };
    if cells.columns > 0 {
        let (u, v) = (cells_across(x, factor), cells_across(y, factor));
        rgb = cells.corrected(light, rgb, u, v);
    }
    if !counts {
        rgb = Vec3::splat(MASKED);
    }
    frame[to] = rgb.x;
    frame[to + 1] = rgb.y;
    frame[to + 2] = rgb.z;
}

/// The place of the middle of a level's pixel, in cells.
fn cells_across(pixel: u32, factor: u32) -> f32 {
    (pixel as f32 + 0.5) * factor as f32 / CELL as f32
}

/// The cells of a flat field, row by row: for each its factor, its summand and whether it counts.
#[derive(Clone, Copy)]
struct Cells {
    columns: u32,
    rows: u32,
}

impl Cells {
    /// A pixel at `(u, v)`, corrected by the cells around it; or masked.
    fn corrected(self, light: &[f32], rgb: Vec3, u: f32, v: f32) -> Vec3 {
        let own = self.at(v as u32, u as u32);
        if light[own + 2] == 0.0 {
            return Vec3::splat(MASKED);
        }
        let (u, v) = (max(u - 0.5, 0.0), max(v - 0.5, 0.0));
        let (column, row) = (u as u32, v as u32);
        let (across, down) = (u - column as f32, v - row as f32);
        let at = [
            self.at(row, column),
            self.at(row, column + 1),
            self.at(row + 1, column),
            self.at(row + 1, column + 1),
        ];
        let factor = between(light, at, 0, across, down);
        let summand = between(light, at, 1, across, down);
        rgb * factor + Vec3::splat(summand)
    }

    /// Index of a cell's first float. Beyond the last row or column the last one is used.
    fn at(self, row: u32, column: u32) -> usize {
        let row = if row < self.rows { row } else { self.rows - 1 };
        let column = if column < self.columns { column } else { self.columns - 1 };
        (LIGHT + (row * self.columns + column) * 3) as usize
    }
}

/// One of the floats of four cells, interpolated.
fn between(light: &[f32], at: [usize; 4], float: usize, across: f32, down: f32) -> f32 {
    let above = light[at[0] + float] * (1.0 - across) + light[at[1] + float] * across;
    let below = light[at[2] + float] * (1.0 - across) + light[at[3] + float] * across;
    above * (1.0 - down) + below * down
}
