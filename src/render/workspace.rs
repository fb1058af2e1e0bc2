//! Buffers that all views of a renderer use in turn.

use crate::shared::{BIN_BLOCK, CULLED, Counters, DERIVATIVES, RADIX, RADIX_BLOCK, RECORD};
use crate::vulkan::{Buffer, Device, Error, Memory};

use super::Scene;

/// Splat-sized and pair-sized buffers. Sorts swap between the two of a pair of buffers.
pub(crate) struct Workspace {
    pub records: Buffer,
    pub tile_counts: Buffer,
    pub depth_keys: [Buffer; 2],
    pub depth_order: [Buffer; 2],
    pub block_sums: Buffer,
    pub histogram: Buffer,
    pub pair_tiles: [Buffer; 2],
    pub pair_splats: [Buffer; 2],
    pub counters: Buffer,
    pub counters_read: Buffer,
    /// Only where the exact Jacobian is wanted.
    pub derivatives: Option<Buffer>,
    pub pair_capacity: u32,
}

const _: () = assert!(CULLED == u32::MAX, "culled splats must sort behind all depths");

impl Workspace {
    pub fn new(
        device: &Device,
        scene: &Scene,
        pair_capacity: u32,
        exact: bool,
    ) -> Result<Workspace, Error> {
        let splats = scene.splats as usize;
        let pairs = pair_capacity as usize;
        let own = |name, count| Buffer::new::<u32>(device, name, count, Memory::Device);
        let two = |name, count| Ok::<_, Error>([own(name, count)?, own(name, count)?]);
        let blocks = splats.max(pairs).div_ceil(RADIX_BLOCK as usize).max(1);
        let derivatives = exact
            .then(|| own("pose derivatives", splats * 4 * DERIVATIVES as usize))
            .transpose()?;
        // All splats are sorted by depth, always.
        let counters = Counters { sort: [scene.splats, 0], ..Counters::default() };
        let counters_read =
            Buffer::new::<Counters>(device, "counters read back", 1, Memory::Readback)?;
        Ok(Workspace {
            records: own("projected splats", splats * 4 * RECORD as usize)?,
            tile_counts: own("tile counts", splats)?,
            depth_keys: two("depth keys", splats)?,
            depth_order: two("depth order", splats)?,
            block_sums: own("block sums", splats.div_ceil(BIN_BLOCK as usize))?,
            histogram: own("digit histogram", blocks * RADIX as usize)?,
            pair_tiles: two("pair tiles", pairs)?,
            pair_splats: two("pair splats", pairs)?,
            counters: Buffer::from_slice(device, "counters", &[counters])?,
            counters_read,
            derivatives,
            pair_capacity,
        })
    }
}
