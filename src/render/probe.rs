//! Single stages run on their own, for the tests that hold them against their twins.

use bytemuck::AnyBitPattern;

use crate::shared::{Counters, DERIVATIVES, RADIX, RADIX_BLOCK, RECORD};
use crate::vulkan::{Buffer, Device, Error, Memory, Recorder};
use crate::{Camera, Engine, Pose};

use super::radix::Keys;
use super::view::View;
use super::workspace::Workspace;
use super::{Scene, bin, derive, project, radix, ranges};

/// Sorts keys with values in four passes, as the splats by depth are.
///
/// # Panics
/// Where the numbers of keys and values differ.
pub fn sort(engine: &Engine, keys: &[u32], values: &[u32]) -> Result<(Vec<u32>, Vec<u32>), Error> {
    assert_eq!(keys.len(), values.len(), "keys and values");
    let device = &engine.device;
    let count = keys.len() as u32;
    let blocks = count.div_ceil(RADIX_BLOCK) * RADIX;
    let own = |name| Buffer::new::<u32>(device, name, keys.len(), Memory::Device);
    let keys = [Buffer::from_slice(device, "keys", keys)?, own("sorted keys")?];
    let values = [Buffer::from_slice(device, "values", values)?, own("sorted values")?];
    let counters = Buffer::new::<Counters>(device, "counters", 1, Memory::Device)?;
    let histogram = Buffer::new::<u32>(device, "digit histogram", blocks as usize, Memory::Device)?;
    let mut recorder = Recorder::new(device)?;
    recorder.fill(&counters, count);
    let depth = Keys::Depth { count };
    let r = &mut recorder;
    let kernels = &engine.kernels;
    let sorted = radix::record(r, kernels, &counters, &histogram, depth, 4, &keys, &values)?;
    recorder.finish()?.run()?;
    let read = |buffer| read::<u32>(device, buffer, count as usize);
    Ok((read(&keys[sorted])?, read(&values[sorted])?))
}

/// What every stage before the blending left, up to the pairs that there was room for.
#[derive(Clone, Debug)]
pub struct Stages {
    /// Stage `project`, twelve floats a splat; not written where the splat touches no tile.
    pub records: Vec<[f32; 4 * RECORD as usize]>,
    /// Stage `project`.
    pub tile_counts: Vec<u32>,
    /// Stage `derive`; not written where the splat touches no tile.
    pub derivatives: Vec<[f32; 4 * DERIVATIVES as usize]>,
    /// Depth keys, sorted.
    pub depth_keys: Vec<u32>,
    /// Splats in the order of the keys.
    pub order: Vec<u32>,
    /// Pairs that the picture needs.
    pub pairs_needed: u32,
    /// Stage `bin_emit`: tile of each pair.
    pub pair_tiles: Vec<u32>,
    /// Stage `bin_emit`: splat of each pair.
    pub pair_splats: Vec<u32>,
    /// Tiles of the pairs, sorted.
    pub sorted_tiles: Vec<u32>,
    /// Splats of the pairs, sorted by tile.
    pub sorted_splats: Vec<u32>,
    /// Stage `ranges`.
    pub ranges: Vec<[u32; 2]>,
}

/// Runs the stages before the blending at a pose, with room for `pair_capacity` pairs.
pub fn stages(
    engine: &Engine,
    scene: &Scene,
    camera: &Camera,
    pose: &Pose,
    pair_capacity: u32,
) -> Result<Stages, Error> {
    let (device, kernels) = (&engine.device, &*engine.kernels);
    let work = Workspace::new(device, scene, pair_capacity, true)?;
    let mut view = View::new(device, camera)?;
    view.set_pose(scene, pair_capacity, pose);

    let mut recorder = Recorder::new(device)?;
    let r = &mut recorder;
    project::record(r, kernels, scene, &view, &work)?;
    derive::record(r, kernels, scene, &view, &work)?;
    r.fill(&work.counters, scene.splats);
    let (counters, histogram) = (&work.counters, &work.histogram);
    let depth = Keys::Depth { count: scene.splats };
    let (keys, order) = (&work.depth_keys, &work.depth_order);
    let by_depth = radix::record(r, kernels, counters, histogram, depth, 4, keys, order)?;
    bin::record(r, kernels, scene, &view, &work, by_depth)?;
    recorder.finish()?.run()?;
    // The sort by tile writes over the pairs as emitted: they are read before it.
    let splats = scene.splats as usize;
    let counts = read::<Counters>(device, counters, 1)?[0];
    let pairs = counts.sort[1] as usize;
    let emitted_tiles = read(device, &work.pair_tiles[0], pairs)?;
    let emitted_splats = read(device, &work.pair_splats[0], pairs)?;

    let mut recorder = Recorder::new(device)?;
    let r = &mut recorder;
    let passes = radix::passes(view.tile_count() + 1);
    let (tiles, values) = (&work.pair_tiles, &work.pair_splats);
    let by_tile =
        radix::record(r, kernels, counters, histogram, Keys::Tile, passes, tiles, values)?;
    ranges::record(r, kernels, &view, &work, by_tile)?;
    recorder.finish()?.run()?;
    let derivatives = work.derivatives.as_ref().map(|d| read(device, d, splats));
    Ok(Stages {
        records: read(device, &work.records, splats)?,
        tile_counts: read(device, &work.tile_counts, splats)?,
        derivatives: derivatives.transpose()?.unwrap_or_default(),
        depth_keys: read(device, &keys[by_depth], splats)?,
        order: read(device, &order[by_depth], splats)?,
        pairs_needed: counts.pairs_needed,
        pair_tiles: emitted_tiles,
        pair_splats: emitted_splats,
        sorted_tiles: read(device, &tiles[by_tile], pairs)?,
        sorted_splats: read(device, &values[by_tile], pairs)?,
        ranges: read(device, &view.ranges, view.tile_count() as usize)?,
    })
}

/// The first `count` values of a buffer that only the device sees.
fn read<T: AnyBitPattern>(device: &Device, from: &Buffer, count: usize) -> Result<Vec<T>, Error> {
    let to = Buffer::new::<T>(device, "probe", count, Memory::Readback)?;
    let mut recorder = Recorder::new(device)?;
    recorder.copy(from, &to)?;
    recorder.finish()?.run()?;
    Ok(to.read(count).to_vec())
}
