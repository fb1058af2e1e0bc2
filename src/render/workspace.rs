//! Buffers that all views of a renderer use in turn.

use crate::shared::{Counters, DERIVATIVES, RECORD};
use crate::vulkan::{Buffer, Device, Error, Memory};

use super::splat_buffers::SplatBuffers;
use super::{kernels, radix};

/// Splat-sized and pair-sized buffers.
pub struct Workspace {
    /// One more than there are splats: the last shows nothing.
    pub records: Buffer,
    /// Depth keys by splat.
    pub keys: Buffer,
    /// Keys and splats between the passes of the sort.
    pub between: [[Buffer; 2]; 2],
    /// The visible splats in depth order.
    pub order: Buffer,
    pub histogram: Buffer,
    /// First words of the histogram, which must be zero before blocks add to them.
    pub sum_words: u32,
    /// Each tile's splats in depth order, at the tile's range.
    pub pair_splats: Buffer,
    pub counters: Buffer,
    pub counters_read: Buffer,
    /// Only if the exact Jacobian is wanted.
    pub derivatives: Option<Buffer>,
    pub pair_capacity: u32,
}

impl Workspace {
    pub fn new(
        device: &Device,
        splats: &SplatBuffers,
        pair_capacity: u32,
        exact: bool,
    ) -> Result<Workspace, Error> {
        let count = splats.room;
        let splats = count as usize;
        let pairs = pair_capacity as usize;
        let own = |name, count| Buffer::new::<u32>(device, name, count, Memory::Device);
        let limit = device.info().storage_range;
        let room_for = |of, each: u64| Error::with_room_for(limit / each - 1, of);
        let histogram = radix::histogram(kernels::log_sort_blocks(device.info(), count));
        let between = || {
            let keys = own("keys half sorted", splats)?;
            Ok::<_, Error>([keys, own("splats half sorted", splats)?])
        };
        let derivatives = exact
            .then(|| own("pose derivatives", (splats + 1) * 4 * DERIVATIVES as usize))
            .transpose()
            .map_err(room_for("splats", 16 * u64::from(DERIVATIVES)))?;
        let counters_read =
            Buffer::new::<Counters>(device, "counters read back", 1, Memory::Readback)?;
        Ok(Workspace {
            records: own("projected splats", (splats + 1) * 4 * RECORD as usize)?,
            keys: own("depth keys", splats)?,
            between: [between()?, between()?],
            order: own("depth order", splats)?,
            histogram: own("digit histogram", histogram.words() as usize)?,
            sum_words: histogram.rows,
            pair_splats: own("pair splats", pairs).map_err(room_for("pairs", 4))?,
            counters: Buffer::new::<Counters>(device, "counters", 1, Memory::Device)?,
            counters_read,
            derivatives,
            pair_capacity,
        })
    }
}
