//! Stages `radix_count`, `radix_scan`, `radix_scatter`: a stable radix sort of keys with values.

use std::mem::offset_of;

use crate::shared::{Counters, Groups, RADIX};
use crate::vulkan::{Buffer, Error, Recorder};

use super::Kernels;
use super::view::Part;

/// What is sorted; an index into [`Counters::sort`].
#[derive(Clone, Copy)]
pub(crate) enum Keys {
    /// Splats by depth.
    Depth(Part),
    /// Pairs by tile; their number is known on the device alone.
    Tile(Part),
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
    pub groups: &'a Buffer,
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
    let Sort { what, passes, counters, groups, histogram, keys, values } = *sort;
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
            [counters, groups],
        )?;
        let one = what.part().at(offset_of!(Groups, one));
        let buffers = [counters, histogram];
        r.dispatch_indirect(&k.radix_scan, &buffers, &constants, groups, one)?;
        let buffers = [counters, histogram, &keys[from], &values[from], &keys[to], &values[to]];
        what.dispatch(r, &k.radix_scatter, &buffers, &constants, [counters, groups])?;
        from = to;
    }
    Ok(from)
}

impl Keys {
    fn index(self) -> u32 {
        match self {
            Keys::Depth(_) => 0,
            Keys::Tile(_) => 1,
        }
    }

    fn part(self) -> Part {
        let (Keys::Depth(part) | Keys::Tile(part)) = self;
        part
    }

    /// One workgroup a block of keys.
    fn dispatch(
        self,
        recorder: &mut Recorder,
        kernel: &crate::vulkan::Kernel,
        buffers: &[&Buffer],
        constants: &[u32],
        [counters, groups]: [&Buffer; 2],
    ) -> Result<(), Error> {
        match self {
            Keys::Depth(part) => {
                let at = part.at(offset_of!(Groups, radix_blocks));
                recorder.dispatch_indirect(kernel, buffers, constants, groups, at)
            }
            Keys::Tile(_) => {
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
