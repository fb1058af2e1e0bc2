//! How a workgroup counts the items of its block by column, leaves the counts in a [`BlockTable`], and finds from such
//! a table where its items begin.

use crate::block_table::BlockTable;
use crate::lanes::{Lanes, Table};
use crate::memory::{at, at_mut};
use spirv_std::arch::atomic_i_add;
use spirv_std::memory::{Scope, Semantics};

// Limits of the indices below. Columns: below the table's width, which is at most TABLE. Cells: those of the block or
// of its sum.

/// Sets the counters of a workgroup to zero.
pub fn clear<L: Lanes, const N: usize>(counters: &mut [u32; N], width: u32, lane: u32) {
    let mut column = lane;
    while column < width {
        *at_mut(counters, column) = 0;
        column += L::COUNT;
    }
    L::sync();
}

/// Leaves the counters of a workgroup in the table.
pub fn leave<L: Lanes>(
    counters: &Table,
    table: &BlockTable,
    block: u32,
    lane: u32,
    words: &mut [u32],
) {
    L::sync();
    let mut column = lane;
    while column < table.width {
        let count = at(counters, column);
        *at_mut(words, table.cell(block, column)) = count;
        if table.has_sums() & (count > 0) {
            add(at_mut(words, table.sum(block, column)), count);
        }
        column += L::COUNT;
    }
}

/// Adds to a sum of several workgroups.
fn add(sum: &mut u32, count: u32) {
    // SAFETY: an atomic on a word of a storage buffer. The sum of integers is the same in any order.
    unsafe {
        const SCOPE: u32 = Scope::QueueFamily as u32;
        atomic_i_add::<u32, SCOPE, { Semantics::NONE.bits() }>(sum, count);
    }
}

/// Sums over some rows of a column, of which `first` is the cell in the first: over those before row `end`, and all.
/// Eight rows are loaded at once: one after the other, a GPU would wait for each.
fn sums(words: &[u32], first: u32, width: u32, end: u32, rows: u32) -> [u32; 2] {
    let (mut before, mut all) = (0, 0);
    let mut row = 0;
    macro_rules! load {
        // Beyond the last row the last one is loaded, and not added.
        ($k:literal) => {
            at(words, first + (row + $k).min(rows - 1) * width)
        };
    }
    macro_rules! add {
        ($k:literal, $count:ident) => {
            before += if row + $k < end { $count } else { 0 };
            all += if row + $k < rows { $count } else { 0 };
        };
    }
    while row < rows {
        let (a, b, c, d) = (load!(0), load!(1), load!(2), load!(3));
        let (e, f, g, h) = (load!(4), load!(5), load!(6), load!(7));
        add!(0, a);
        add!(1, b);
        add!(2, c);
        add!(3, d);
        add!(4, e);
        add!(5, f);
        add!(6, g);
        add!(7, h);
        row += 8;
    }
    [before, all]
}

/// How many items of a column the blocks before one have, and how many all have.
pub fn before(words: &[u32], table: &BlockTable, block: u32, column: u32) -> [u32; 2] {
    let own = block >> table.log_each();
    let rows = 1 << table.log_sums();
    let [before, all] = sums(words, table.sums + column, table.width, own, rows);
    let first = own << table.log_each();
    let [beside, _] =
        sums(words, table.cell(first, column), table.width, block - first, block - first);
    [before + beside, all]
}

/// Sums over some rows of four columns, as [`sums`]. Four rows are loaded at once.
fn four_sums(words: &[u32], first: [u32; 4], width: u32, end: u32, rows: u32) -> [[u32; 2]; 4] {
    let [mut a, mut b, mut c, mut d] = [[0_u32; 2]; 4];
    let mut row = 0;
    macro_rules! load {
        // Beyond the last row the last one is loaded, and not added.
        ($column:literal) => {
            [
                at(words, first[$column] + row.min(rows - 1) * width),
                at(words, first[$column] + (row + 1).min(rows - 1) * width),
                at(words, first[$column] + (row + 2).min(rows - 1) * width),
                at(words, first[$column] + (row + 3).min(rows - 1) * width),
            ]
        };
    }
    macro_rules! add {
        ($sum:ident, $counts:ident, $k:literal) => {
            $sum[0] += if row + $k < end { $counts[$k] } else { 0 };
            $sum[1] += if row + $k < rows { $counts[$k] } else { 0 };
        };
        ($sum:ident, $counts:ident) => {
            add!($sum, $counts, 0);
            add!($sum, $counts, 1);
            add!($sum, $counts, 2);
            add!($sum, $counts, 3);
        };
    }
    while row < rows {
        let (e, f, g, h) = (load!(0), load!(1), load!(2), load!(3));
        add!(a, e);
        add!(b, f);
        add!(c, g);
        add!(d, h);
        row += 4;
    }
    [a, b, c, d]
}

/// As [`before`], of four columns. Those beyond the table's width count as the last one.
pub fn four_before(
    words: &[u32],
    table: &BlockTable,
    block: u32,
    columns: [u32; 4],
) -> [[u32; 2]; 4] {
    let last = table.width - 1;
    let [a, b, c, d] = columns;
    let [a, b, c, d] = [a.min(last), b.min(last), c.min(last), d.min(last)];
    let own = block >> table.log_each();
    let of = |start: u32| [start + a, start + b, start + c, start + d];
    let [e, f, g, h] = four_sums(words, of(table.sums), table.width, own, 1 << table.log_sums());
    let first = own << table.log_each();
    let count = block - first;
    let beside = of(table.cell(first, 0));
    let [i, j, k, l] = four_sums(words, beside, table.width, count, count);
    [[e[0] + i[0], e[1]], [f[0] + j[0], f[1]], [g[0] + k[0], g[1]], [h[0] + l[0], h[1]]]
}
