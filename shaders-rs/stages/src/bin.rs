//! Stages `bin_count`, `bin_scan`, `bin_emit`: each tile's splats in depth order. The visible splats, sorted by depth,
//! are split evenly over a fixed number of blocks. Each block counts its splats by tile. The sum over the blocks before
//! it is the place in the tile's list at which its own begin. Then the block writes them there, in order. No pair is
//! sorted or stored more than once.
//!
//! A workgroup walks the rows of tiles that its splats touch as one sequence, one row per invocation. So no invocation
//! waits for a neighbour's larger splat. To count, each row of a splat adds one to its first tile, and takes one from
//! the tile after its last: the counts are the sums along the picture's rows. To write, the workgroup walks the tiles
//! of those rows as it walks the rows.

use crate::counters::clear;
use crate::lanes::{Lanes, LargeTable, Lockstep, Plain, Scan, Scratch, Table, Wave, Waves, Wide};
use crate::list::{need_pairs, tell_cut};
use crate::memory::{Pairs, at, at_mut};
use crate::shared::{self, Counters, Outline, Params, Projected};
use spirv_std::glam::{UVec2, UVec3};
use spirv_std::spirv;

/// The parameters of binning.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Split {
    /// Logarithm, base 2, of the number of blocks that share the splats.
    pub log_blocks: u32,
}

// Limits of the indices below. Places of splats: below the number of splats. Splats: at most that number, which is the
// index of the splat that shows nothing. Tiles of a band: below the size of the table of counters. Rows of the table of
// starts: at most the number of blocks. Pairs: below the room.

/// Loads the part of a splat's record that binning needs.
fn load<B: Pairs + ?Sized>(records: &B, splat: u32) -> Projected {
    let first = splat * shared::RECORD * 2;
    let [u, v] = records.pair(first);
    let [l11, l21] = records.pair(first + 1);
    let [l22, log_opacity] = records.pair(first + 2);
    Projected { mean: [u, v], conic: [l11, l21, l22], log_opacity, ..Projected::CULLED }
}

/// The part of the picture and of the splats that a workgroup works on. Tables in shared memory hold few tiles, so
/// large pictures are cut into bands of whole rows.
#[derive(Clone, Copy)]
struct Share {
    /// Rows of tiles `[top, bottom)`.
    top: u32,
    bottom: u32,
    /// Splats `[first, end)` of the depth order.
    first: u32,
    end: u32,
}

impl Share {
    fn new<L: Lanes>(params: &Params, visible: u32, split: &Split, group: UVec3) -> Share {
        let top = group.y * params.band_rows;
        let bottom = (top + params.band_rows).min(params.tiles_y);
        let [first, end] = shared::block(visible, split.log_blocks, group.x, L::COUNT);
        Share { top, bottom, first, end }
    }

    /// First tile of the band, and the number of them.
    fn tiles(&self, params: &Params) -> [u32; 2] {
        [self.top * params.tiles_x, (self.bottom - self.top) * params.tiles_x]
    }
}

/// The items of all invocations in one sequence. This invocation's are `[start, end)` of `total`.
#[derive(Clone, Copy)]
struct Sequence {
    start: u32,
    end: u32,
    total: u32,
}

impl Sequence {
    fn new<L: Lanes>(count: u32, lane: u32, scratch: &mut Scratch) -> Sequence {
        let (start, total) = L::sum(count, lane, scratch);
        Sequence { start, end: start + count, total }
    }

    /// The invocation that owns the item at a place: the first one whose items end after it. The
    /// ends are published in `slot`.
    fn owner<L: Lanes>(&self, place: u32, slot: u32, scratch: &Scratch) -> u32 {
        // Written out: llvmpipe would count the rounds of a loop, see `for_rows`.
        let owner = self.beyond::<L>(place, 0, 32, slot, scratch);
        let owner = self.beyond::<L>(place, owner, 16, slot, scratch);
        let owner = self.beyond::<L>(place, owner, 8, slot, scratch);
        let owner = self.beyond::<L>(place, owner, 4, slot, scratch);
        let owner = self.beyond::<L>(place, owner, 2, slot, scratch);
        self.beyond::<L>(place, owner, 1, slot, scratch)
    }

    /// `owner`, or the invocation `step` after it if all items before that one end before the place.
    fn beyond<L: Lanes>(
        &self,
        place: u32,
        owner: u32,
        step: u32,
        slot: u32,
        scratch: &Scratch,
    ) -> u32 {
        if step >= L::COUNT {
            return owner;
        }
        let ends_before = L::get(self.end, slot, owner + step - 1, scratch) <= place;
        owner + if ends_before { step } else { 0 }
    }
}

/// One splat of each invocation, and the rows of tiles that all of them touch.
struct Chunk {
    outline: Outline,
    splat: u32,
    top: u32,
    rows: Sequence,
}

/// Tiles of one row that a splat touches.
#[derive(Clone, Copy)]
struct Row {
    splat: u32,
    /// The first of them, and their number. Tiles are counted from the band's first.
    first_tile: u32,
    count: u32,
    /// Whether the picture's row goes on after them.
    goes_on: bool,
}

/// A row of tiles of each invocation, and the tiles that all of them touch.
struct Rows {
    row: Row,
    tiles: Sequence,
}

/// Slots in which chunks and rows are published.
const OUTLINE: u32 = 1;
const SPLAT: u32 = 8;
const TOP: u32 = 9;
const ROWS_START: u32 = 10;
const ROWS_END: u32 = 11;
const ROW_SPLAT: u32 = 12;
const ROW_TILE: u32 = 13;
const TILES_START: u32 = 14;
const TILES_END: u32 = 15;

impl Chunk {
    /// Loads the splat at a place of the order and publishes it.
    fn load<L: Lanes, B: Pairs + ?Sized>(
        params: &Params,
        share: &Share,
        order: &[u32],
        records: &B,
        place: u32,
        lane: u32,
        scratch: &mut Scratch,
    ) -> Chunk {
        let mut splat = params.splats;
        if place < share.end {
            splat = at(order, place);
        }
        let outline = Outline::new(params, &load(records, splat));
        let [top, bottom] = outline.rows(params);
        let (top, bottom) = (top.max(share.top), bottom.min(share.bottom));
        let count = if (place < share.end) & (top < bottom) { bottom - top } else { 0 };
        let rows = Sequence::new::<L>(count, lane, scratch);
        L::put(outline.mean[0].to_bits(), OUTLINE, lane, scratch);
        L::put(outline.mean[1].to_bits(), OUTLINE + 1, lane, scratch);
        L::put(outline.slope.to_bits(), OUTLINE + 2, lane, scratch);
        L::put(outline.rise.to_bits(), OUTLINE + 3, lane, scratch);
        L::put(outline.width.to_bits(), OUTLINE + 4, lane, scratch);
        L::put(outline.cut.to_bits(), OUTLINE + 5, lane, scratch);
        L::put(outline.tip.to_bits(), OUTLINE + 6, lane, scratch);
        L::put(splat, SPLAT, lane, scratch);
        L::put(top, TOP, lane, scratch);
        L::put(rows.start, ROWS_START, lane, scratch);
        L::put(rows.end, ROWS_END, lane, scratch);
        L::sync();
        Chunk { outline, splat, top, rows }
    }

    /// The outline of the splat of invocation `from`.
    fn outline<L: Lanes>(&self, from: u32, scratch: &Scratch) -> Outline {
        let float =
            |own: f32, k: u32| f32::from_bits(L::get(own.to_bits(), OUTLINE + k, from, scratch));
        let o = &self.outline;
        Outline {
            mean: [float(o.mean[0], 0), float(o.mean[1], 1)],
            slope: float(o.slope, 2),
            rise: float(o.rise, 3),
            width: float(o.width, 4),
            cut: float(o.cut, 5),
            tip: float(o.tip, 6),
        }
    }

    /// The row at a place of the sequence. `first_tile`: the band's.
    fn row<L: Lanes>(
        &self,
        params: &Params,
        first_tile: u32,
        place: u32,
        scratch: &Scratch,
    ) -> Row {
        let owner = self.rows.owner::<L>(place, ROWS_END, scratch);
        let outline = self.outline::<L>(owner, scratch);
        let splat = L::get(self.splat, SPLAT, owner, scratch);
        let start = L::get(self.rows.start, ROWS_START, owner, scratch);
        let y = L::get(self.top, TOP, owner, scratch) + place - start;
        let [left, right] = outline.columns(params.tile_row(y), params.tiles_x);
        Row {
            splat,
            first_tile: y * params.tiles_x + left - first_tile,
            count: if place < self.rows.total { right - left } else { 0 },
            goes_on: right < params.tiles_x,
        }
    }
}

/// A tile of the band, and a splat that touches it.
struct Pair {
    tile: u32,
    splat: u32,
    /// Whether there is one.
    any: bool,
}

impl Rows {
    /// Publishes the rows.
    fn new<L: Lanes>(row: Row, lane: u32, scratch: &mut Scratch) -> Rows {
        let tiles = Sequence::new::<L>(row.count, lane, scratch);
        L::put(row.splat, ROW_SPLAT, lane, scratch);
        L::put(row.first_tile, ROW_TILE, lane, scratch);
        L::put(tiles.start, TILES_START, lane, scratch);
        L::put(tiles.end, TILES_END, lane, scratch);
        L::sync();
        Rows { row, tiles }
    }

    /// The pair at a place of the sequence.
    fn pair<L: Lanes>(&self, place: u32, scratch: &Scratch) -> Pair {
        let owner = self.tiles.owner::<L>(place, TILES_END, scratch);
        let start = L::get(self.tiles.start, TILES_START, owner, scratch);
        let any = place < self.tiles.total;
        let tile = L::get(self.row.first_tile, ROW_TILE, owner, scratch) + place - start;
        let splat = L::get(self.row.splat, ROW_SPLAT, owner, scratch);
        Pair { tile: if any { tile } else { 0 }, splat, any }
    }
}

/// Runs the block for the rows of tiles that a share's splats touch, in depth order, one row per invocation at once. (A
/// closure would hold buffers, which shaders cannot do.) Llvmpipe ends all loops of an invocation after 65,535 rounds
/// in all. The name before the block tells whether that happened.
macro_rules! for_rows {
    ($params:ident, $share:ident, $order:ident, $records:ident, $lane:ident, $scratch:ident,
        $cut:ident, |$row:ident| $body:block) => {
        let [first_tile, _] = $share.tiles($params);
        let mut $cut = false;
        let mut place = $share.first + $lane;
        while place - $lane < $share.end {
            let chunk =
                Chunk::load::<L, _>($params, &$share, $order, $records, place, $lane, $scratch);
            // Runs at least once: with the condition at the end no round is wasted.
            let mut row = $lane;
            loop {
                let $row = chunk.row::<L>($params, first_tile, row, $scratch);
                $body
                row += L::COUNT;
                if row - $lane >= chunk.rows.total {
                    break;
                }
            }
            L::sync();
            $cut |= row - $lane < chunk.rows.total;
            place += L::COUNT;
        }
        $cut |= place - $lane < $share.end;
    };
}

#[allow(clippy::too_many_arguments)]
fn count<L: Lanes, const TABLE: usize, B: Pairs + ?Sized>(
    group: UVec3,
    lane: u32,
    table: &mut [u32; TABLE],
    scratch: &mut Scratch,
    split: &Split,
    params: &Params,
    counters: &mut Counters,
    order: &[u32],
    records: &B,
    starts: &mut [u32],
) {
    let share = Share::new::<L>(params, counters.visible, split, group);
    let [first_tile, tiles] = share.tiles(params);
    let start = group.x * params.tiles_x * params.tiles_y + first_tile;
    clear::<L, TABLE>(table, tiles, lane);
    for_rows!(params, share, order, records, lane, scratch, cut, |row| {
        let any = row.count > 0;
        L::tally(table, row.first_tile, 1, any, lane, scratch);
        let after = row.first_tile + row.count;
        L::tally(table, after, LESS, any & row.goes_on, lane, scratch);
    });
    L::sync();
    let mut first = 0;
    while first < tiles {
        let mut before = 0_u32;
        let mut column = lane;
        while column - lane < params.tiles_x {
            let inside = column < params.tiles_x;
            let tile = first + if inside { column } else { 0 };
            let (prefix, all) = L::sum(if inside { at(table, tile) } else { 0 }, lane, scratch);
            if inside {
                let count = before.wrapping_add(prefix).wrapping_add(at(table, tile));
                *at_mut(starts, start + tile) = count;
            }
            before = before.wrapping_add(all);
            column += L::COUNT;
        }
        cut |= column - lane < params.tiles_x;
        first += params.tiles_x;
    }
    if cut | (first < tiles) {
        tell_cut(counters);
    }
}

/// Takes one from a counter.
const LESS: u32 = 1_u32.wrapping_neg();

/// Cells of a table that are loaded together: four, and whether they are there.
#[derive(Clone, Copy)]
struct Four {
    cells: [u32; 4],
    counts: [u32; 4],
    there: bool,
}

impl Four {
    /// Cells from `first` on, `step` apart. From `end` on the table has no cells; then `other` is loaded, which no
    /// other invocation writes.
    fn load(table: &[u32], first: u32, step: u32, end: u32, other: u32) -> Four {
        let there = first < end;
        let cell = |k: u32| if there { first + k * step } else { other };
        let cells = [cell(0), cell(1), cell(2), cell(3)];
        let [a, b, c, d] = cells;
        let counts = [at(table, a), at(table, b), at(table, c), at(table, d)];
        Four { cells, counts, there }
    }

    fn sum(&self) -> u32 {
        let [a, b, c, d] = self.counts;
        let sum = shared::saturating(shared::saturating(a, b), shared::saturating(c, d));
        if self.there { sum } else { 0 }
    }

    /// Replaces each count by the place of its first item. Returns the place after the last item.
    fn replace(&self, table: &mut [u32], place: u32) -> u32 {
        let [a, b, c, d] = self.counts;
        let second = shared::saturating(place, a);
        let third = shared::saturating(second, b);
        let fourth = shared::saturating(third, c);
        if self.there {
            *at_mut(table, self.cells[0]) = place;
            *at_mut(table, self.cells[1]) = second;
            *at_mut(table, self.cells[2]) = third;
            *at_mut(table, self.cells[3]) = fourth;
        }
        if self.there { shared::saturating(fourth, d) } else { place }
    }
}

/// Finds the place at which each block's part of each tile's list begins, counted from the band's first pair. The last
/// row holds the ends of the lists. One workgroup per band. The number of blocks is a multiple of four. Each round
/// loads those of 16: one after the other, a GPU would wait for each.
fn scan<L: Scan>(
    band: u32,
    lane: u32,
    scratch: &mut Scratch,
    split: &Split,
    params: &Params,
    starts: &mut [u32],
    bands: &mut [u32],
) {
    let row = params.tiles_x * params.tiles_y;
    let last_row = row << (split.log_blocks & 31);
    let tiles = params.band_rows * params.tiles_x;
    let first = band * tiles;
    let end = (first + tiles).min(row);
    let mut before = 0;
    let mut tile = first + lane;
    while tile - lane < end {
        let mut sum = 0;
        let mut cell = tile;
        while (tile < end) & (cell < last_row) {
            let [a, b, c, d] = sixteen(starts, cell, row, last_row);
            let ab = shared::saturating(a.sum(), b.sum());
            let cd = shared::saturating(c.sum(), d.sum());
            sum = shared::saturating(sum, shared::saturating(ab, cd));
            cell += 16 * row;
        }
        let (prefix, total) = L::scan(sum, lane, scratch);
        let mut next = shared::saturating(before, prefix);
        cell = tile;
        while (tile < end) & (cell < last_row) {
            let [a, b, c, d] = sixteen(starts, cell, row, last_row);
            next = a.replace(starts, next);
            next = b.replace(starts, next);
            next = c.replace(starts, next);
            next = d.replace(starts, next);
            cell += 16 * row;
        }
        if tile < end {
            *at_mut(starts, last_row + tile) = next;
        }
        before = shared::saturating(before, total);
        tile += L::COUNT;
    }
    if lane == 0 {
        *at_mut(bands, band) = before;
    }
}

/// Sixteen cells of a table, as [`Four::load`].
fn sixteen(table: &[u32], first: u32, step: u32, end: u32) -> [Four; 4] {
    [
        Four::load(table, first, step, end, first),
        Four::load(table, first + 4 * step, step, end, first),
        Four::load(table, first + 8 * step, step, end, first),
        Four::load(table, first + 12 * step, step, end, first),
    ]
}

/// Pairs of the bands before, and of all up to this one.
fn pairs_before(bands: &[u32], band: u32) -> [u32; 2] {
    let mut before = 0;
    let mut other = 0;
    while other < band {
        before = shared::saturating(before, at(bands, other));
        other += 1;
    }
    [before, shared::saturating(before, at(bands, band))]
}

#[allow(clippy::too_many_arguments)]
fn emit<L: Lanes, const TABLE: usize, B: Pairs + ?Sized>(
    group: UVec3,
    lane: u32,
    next: &mut [u32; TABLE],
    scratch: &mut Scratch,
    split: &Split,
    params: &Params,
    counters: &mut Counters,
    order: &[u32],
    records: &B,
    starts: &[u32],
    bands: &[u32],
    ranges: &mut [UVec2],
    pair_splats: &mut [u32],
) {
    let share = Share::new::<L>(params, counters.visible, split, group);
    let [first_tile, tiles] = share.tiles(params);
    let [before, needed] = pairs_before(bands, group.y);
    if (group.x == 0) & (share.bottom == params.tiles_y) & (lane == 0) {
        need_pairs(counters, needed);
    }
    let room = params.pair_capacity;
    let all = params.tiles_x * params.tiles_y;
    let own = group.x * all + first_tile;
    let row_below = own + all;
    let last_row = (all << (split.log_blocks & 31)) + first_tile;
    let mut tile = lane;
    while tile < tiles {
        let start = shared::saturating(before, at(starts, own + tile));
        *at_mut(next, tile) = start;
        if !L::REPEATS {
            // The ends of the block's lists, behind the places.
            let end = shared::saturating(before, at(starts, row_below + tile)).min(room);
            *at_mut(next, tiles + tile) = end;
        }
        if group.x == 0 {
            let end = shared::saturating(before, at(starts, last_row + tile));
            *at_mut(ranges, first_tile + tile) = UVec2::new(start.min(room), end.min(room));
        }
        tile += L::COUNT;
    }
    L::sync();
    let bits = u32::BITS - tiles.leading_zeros();
    // A pair whose store is put off: its place, or `room` if there is none, and its splat.
    let (mut kept_to, mut kept_splat) = (room, 0);
    for_rows!(params, share, order, records, lane, scratch, cut, |row| {
        let rows = Rows::new::<L>(row, lane, scratch);
        let mut place = lane;
        loop {
            let pair = rows.pair::<L>(place, scratch);
            let rank =
                L::rank(if pair.any { pair.tile } else { tiles }, bits, lane, scratch);
            let to = at(next, pair.tile) + rank.before;
            // Never more than were counted, should this stage's rounding differ.
            let end = if L::REPEATS { room } else { at(next, tiles + pair.tile) };
            L::sync();
            if pair.any & rank.last {
                *at_mut(next, pair.tile) = to + 1;
            }
            L::sync();
            let there = pair.any & (to < end);
            if L::REPEATS {
                if there {
                    *at_mut(pair_splats, to) = pair.splat;
                }
            } else {
                // A GPU may wait at a barrier for the stores before it, so that of the round before comes behind.
                if kept_to < room {
                    *at_mut(pair_splats, kept_to) = kept_splat;
                }
                (kept_to, kept_splat) = (if there { to } else { room }, pair.splat);
            }
            place += L::COUNT;
            if place - lane >= rows.tiles.total {
                break;
            }
        }
        L::sync();
        cut |= place - lane < rows.tiles.total;
    });
    if kept_to < room {
        *at_mut(pair_splats, kept_to) = kept_splat;
    }
    L::sync();
    if cut {
        tell_cut(counters);
    }
    // What was counted but not written gets the splat that shows nothing.
    tile = lane;
    while tile < tiles {
        let mut to = at(next, tile);
        let end = if L::REPEATS {
            shared::saturating(before, at(starts, row_below + tile)).min(room)
        } else {
            at(next, tiles + tile)
        };
        while to < end {
            *at_mut(pair_splats, to) = params.splats;
            to += 1;
        }
        tile += L::COUNT;
    }
}

/// Makes a form of the two passes over splats: entry points, invocations of a workgroup, its counters, the built-in
/// number of an invocation, and how records are loaded. Workgroups: blocks × bands.
macro_rules! form {
    ($count:ident, $emit:ident, $threads:tt, $lanes:ty, $table:ty, $lane:ident, $record:ty) => {
        /// Each block's pairs by tile.
        #[spirv(compute(threads($threads)))]
        pub fn $count(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv($lane)] lane: u32,
            #[spirv(workgroup)] table: &mut $table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] split: &Split,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] counters: &mut Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] order: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[$record],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] starts: &mut [u32],
        ) {
            let p = *params;
            count::<$lanes, _, _>(
                group, lane, table, scratch, split, &p, counters, order, records, starts,
            );
        }

        /// Writes each block's part of each tile's list, each tile's range, and the pairs needed.
        #[spirv(compute(threads($threads)))]
        pub fn $emit(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv($lane)] lane: u32,
            #[spirv(workgroup)] table: &mut $table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] split: &Split,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] counters: &mut Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] order: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[$record],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] starts: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] bands: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] ranges: &mut [UVec2],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] pairs: &mut [u32],
        ) {
            let p = *params;
            emit::<$lanes, _, _>(
                group, lane, table, scratch, split, &p, counters, order, records, starts, bands,
                ranges, pairs,
            );
        }
    };
}

form!(bin_count, bin_emit, 32, Plain, Table, local_invocation_index, f32);
form!(bin_count_lockstep, bin_emit_lockstep, 8, Lockstep, LargeTable, local_invocation_index, u64);
form!(bin_count_wave16, bin_emit_wave16, 16, Wave<16>, Table, subgroup_local_invocation_id, f32);
form!(bin_count_wave32, bin_emit_wave32, 32, Wave<32>, Table, subgroup_local_invocation_id, f32);
form!(bin_count_wave64, bin_emit_wave64, 64, Wave<64>, Table, subgroup_local_invocation_id, f32);

/// Makes a form of the pass over the table of starts. What follows the type are built-in numbers from which the
/// invocation's is made.
macro_rules! scan_form {
    ($scan:ident, $threads:tt, $lanes:ty, $lane:ident $(, $subgroup:ident)?) => {
        /// Finds the place at which each block's part of each tile's list begins, and counts the pairs of each band.
        /// One workgroup per band.
        #[spirv(compute(threads($threads)))]
        pub fn $scan(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv($lane)] lane: u32,
            $(#[spirv($subgroup)] $subgroup: u32,)?
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] split: &Split,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] starts: &mut [u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] bands: &mut [u32],
        ) {
            $(let lane = <$lanes>::lane($subgroup, lane);)?
            let params = *params;
            scan::<$lanes>(group.x, lane, scratch, split, &params, starts, bands);
        }
    };
}

scan_form!(bin_scan, 256, Wide, local_invocation_index);
scan_form!(bin_scan_lockstep, 8, Lockstep, local_invocation_index);
scan_form!(bin_scan_wave16, 256, Waves<16>, subgroup_local_invocation_id, subgroup_id);
scan_form!(bin_scan_wave32, 256, Waves<32>, subgroup_local_invocation_id, subgroup_id);
scan_form!(bin_scan_wave64, 256, Waves<64>, subgroup_local_invocation_id, subgroup_id);
