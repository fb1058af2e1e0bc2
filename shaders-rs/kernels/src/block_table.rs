//! Tables of counters that the workgroups of one stage leave for those of the next: a row for each block of splats, a
//! column for each digit or tile. From such a table each block finds by itself where its items begin.

/// Logarithm, base 2, of the most rows that a block adds up one by one.
const LOG_ONE_BY_ONE: u32 = 4;

/// Where a table lies in its buffer. If it has many rows, rows of sums come before them, each of as many blocks: a
/// block then adds up these, and the rows of its own sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockTable {
    /// Columns.
    pub width: u32,
    /// Logarithm, base 2, of the number of rows.
    pub log_blocks: u32,
    /// The first word of the rows of sums, or of the rows if there are no sums.
    pub sums: u32,
    /// The first word of the rows.
    pub rows: u32,
}

impl BlockTable {
    /// Table `number` of `tables` in a buffer. Each has its own sums; they use the same rows in turn.
    pub fn new(width: u32, log_blocks: u32, number: u32, tables: u32) -> BlockTable {
        let table = BlockTable { width, log_blocks, sums: 0, rows: 0 };
        let sums = if table.has_sums() { width << table.log_sums() } else { 0 };
        BlockTable { sums: number * sums, rows: tables * sums, ..table }
    }

    /// Whether there are rows of sums. They must be zero before the blocks add to them.
    pub fn has_sums(&self) -> bool {
        self.log_blocks > LOG_ONE_BY_ONE
    }

    /// Logarithm, base 2, of the number of sums; of blocks, if there are no sums.
    pub fn log_sums(&self) -> u32 {
        if self.has_sums() { self.log_blocks.div_ceil(2) } else { self.log_blocks }
    }

    /// Logarithm, base 2, of the number of blocks of a sum.
    pub fn log_each(&self) -> u32 {
        self.log_blocks - self.log_sums()
    }

    /// The cell of a block.
    pub fn cell(&self, block: u32, column: u32) -> u32 {
        self.rows + block * self.width + column
    }

    /// The cell of the sum that a block belongs to.
    pub fn sum(&self, block: u32, column: u32) -> u32 {
        self.sums + (block >> self.log_each()) * self.width + column
    }

    /// Words of the buffer.
    pub fn words(&self) -> u32 {
        self.rows + (self.width << self.log_blocks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_do_not_overlap() {
        for log_blocks in 2..=14 {
            let [one, two] = [0, 1].map(|number| BlockTable::new(7, log_blocks, number, 2));
            let last = (1 << log_blocks) - 1;
            assert_eq!(one.rows, two.rows);
            assert_eq!(two.words() - 1, two.cell(last, 6));
            if one.has_sums() {
                assert_eq!(one.sum(last, 6) + 1, two.sums);
                assert_eq!(two.sum(last, 6) + 1, two.rows);
                assert!(one.log_each() >= 2, "sums of less than four rows save nothing");
            } else {
                assert_eq!([one.sums, one.words()], [0, 7 << log_blocks]);
            }
        }
    }
}
