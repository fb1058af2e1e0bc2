//! Stages `radix_count`, `radix_scatter`: a stable radix sort of depth keys with their splats.

use std::mem::offset_of;

use crate::block_table::BlockTable;
use crate::shared::{DIGITS, Groups, TABLE};
use crate::vulkan::{Buffer, Error, Recorder};

use super::Kernels;
use super::levels::Pass;

/// How finely depths are told apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SortPrecision {
    /// As they are: the picture's definition.
    Exact,
    /// Coarse: depths closer than about 1 in 8,000 count as equal. Takes two passes in place of three. For evaluations
    /// whose picture nobody sees.
    #[default]
    Coarse,
}

impl SortPrecision {
    /// The digit that is sorted by first: the coarse order leaves out the lowest.
    pub fn first_digit(self) -> u32 {
        match self {
            SortPrecision::Exact => 0,
            SortPrecision::Coarse => 1,
        }
    }
}

/// Where the counts of each block's keys by digit lie in their buffer, if digits are as wide as they may be.
pub fn histogram(log_blocks: u32) -> BlockTable {
    BlockTable::new(TABLE, log_blocks, 0, DIGITS)
}

/// A sort of keys. Culled keys are left out of the order.
pub struct Sort<'a> {
    pub sort_precision: SortPrecision,
    /// How many keys; `None`: one for each splat that stage `project` projected. It has counted their first digits,
    /// too.
    pub count: Option<u32>,
    /// Logarithm of the number of workgroups that share them.
    pub log_blocks: u32,
    /// Which of `groups` say whether it is run.
    pub pass: Pass,
    pub groups: &'a Buffer,
    pub counters: &'a Buffer,
    pub histogram: &'a Buffer,
    pub keys: &'a Buffer,
    /// Keys and values of the passes but the last, in turn.
    pub between: &'a [[Buffer; 2]; 2],
    /// The splats in the order of their keys, equal ones by index.
    pub order: &'a Buffer,
}

impl Sort<'_> {
    /// Records the sort. The counters must hold the bits of a digit. The sort leaves the number of sorted keys in them.
    pub fn record(&self, r: &mut Recorder, kernels: &Kernels) -> Result<(), Error> {
        let Sort { sort_precision, count, log_blocks, counters, histogram, order, .. } = *self;
        let (groups, keys, between) = (self.groups, self.keys, self.between);
        let blocks = self.pass.at(offset_of!(Groups, sort_blocks));
        let first = sort_precision.first_digit();
        // In the first pass the place of a key is its value.
        let (mut keys, mut values) = (keys, &between[1][1]);
        for digit in first..DIGITS {
            let [keys_out, values_out] = &between[digit as usize % 2];
            let values_out = if digit + 1 < DIGITS { values_out } else { order };
            let constants = [digit, (digit == first).into(), log_blocks, count.unwrap_or(0)];
            if digit > first || count.is_some() {
                let buffers = [counters, keys, histogram];
                r.dispatch_indirect(&kernels.radix_count, &buffers, &constants, groups, blocks)?;
            }
            let buffers = [counters, histogram, keys, values, keys_out, values_out];
            r.dispatch_indirect(&kernels.radix_scatter, &buffers, &constants, groups, blocks)?;
            (keys, values) = (keys_out, values_out);
        }
        Ok(())
    }
}
