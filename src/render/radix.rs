//! Stages `radix_count`, `radix_scan`, `radix_scatter`: a stable radix sort of keys with values.

use std::mem::offset_of;

use crate::shared::{Counters, RADIX, RADIX_BLOCK};
use crate::vulkan::{Buffer, Error, Recorder};

use super::Kernels;

/// What is sorted; an index into [`Counters::sort`].
#[derive(Clone, Copy)]
pub(crate) enum Keys {
    /// Splats by depth, `count` of them.
    Depth { count: u32 },
    /// Pairs by tile; their number is known on the device alone.
    Tile,
}

/// Number of 8-bit passes for keys below `limit`.
pub(crate) fn passes(limit: u32) -> u32 {
    (u32::BITS - limit.saturating_sub(1).leading_zeros()).div_ceil(RADIX.ilog2()).max(1)
}

/// A sort of `keys[0]` with `values[0]` in passes of 8 bits, which swap between the buffers.
pub(crate) struct Sort<'a> {
    pub what: Keys,
    pub passes: u32,
    pub counters: &'a Buffer,
    pub histogram: &'a Buffer,
    pub keys: &'a [Buffer; 2],
    pub values: &'a [Buffer; 2],
}

/// Records a sort; returns which of the two buffers holds the result.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    sort: &Sort,
) -> Result<usize, Error> {
    let Sort { what, passes, counters, histogram, keys, values } = *sort;
    let mut from = 0;
    for pass in 0..passes {
        let to = 1 - from;
        let constants = [what.index(), pass * RADIX.ilog2()];
        let (k, r) = (kernels, &mut *recorder);
        what.dispatch(
            r,
            &k.radix_count,
            &[counters, &keys[from], histogram],
            &constants,
            counters,
        )?;
        r.dispatch(&k.radix_scan, &[counters, histogram], &constants, [1, 1, 1])?;
        let buffers = [counters, histogram, &keys[from], &values[from], &keys[to], &values[to]];
        what.dispatch(r, &k.radix_scatter, &buffers, &constants, counters)?;
        from = to;
    }
    Ok(from)
}

impl Keys {
    fn index(self) -> u32 {
        match self {
            Keys::Depth { .. } => 0,
            Keys::Tile => 1,
        }
    }

    /// One workgroup a block of keys.
    fn dispatch(
        self,
        recorder: &mut Recorder,
        kernel: &crate::vulkan::Kernel,
        buffers: &[&Buffer],
        constants: &[u32],
        counters: &Buffer,
    ) -> Result<(), Error> {
        match self {
            Keys::Depth { count } => {
                let groups = [count.div_ceil(RADIX_BLOCK), 1, 1];
                recorder.dispatch(kernel, buffers, constants, groups)
            }
            Keys::Tile => {
                let offset = offset_of!(Counters, radix_groups) as u64;
                recorder.dispatch_indirect(kernel, buffers, constants, counters, offset)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::passes;

    #[test]
    fn passes_cover_the_keys() {
        assert_eq!(passes(1), 1);
        assert_eq!(passes(256), 1);
        assert_eq!(passes(257), 2);
        assert_eq!(passes(65_536), 2);
        assert_eq!(passes(65_537), 3);
        assert_eq!(passes(u32::MAX), 4);
    }
}
