//! Single stages run on their own, for the tests that hold them against their twins.

use bytemuck::AnyBitPattern;

use crate::shared::{BIN_BLOCK, Counters, DERIVATIVES, Groups, Params, RADIX, RADIX_BLOCK, RECORD};
use crate::vulkan::{Buffer, Device, Error, Memory, Recorder, Timing};
use crate::{Camera, Engine, Pose};

use super::radix::{Keys, Sort};
use super::view::{Part, View};
use super::workspace::Workspace;
use super::{Kernels, Scene, derive, lists, radix};

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
    let mut recorder = Recorder::new(device, Timing::None)?;
    recorder.fill(&counters, count);
    let depth = Keys::Depth(Part::First);
    let groups = Groups::of(&Params { splats: count, ..Params::default() });
    let groups = Buffer::from_slice(device, "workgroups", &[groups])?;
    let r = &mut recorder;
    let kernels = &engine.kernels;
    let sorted = radix::record(
        r,
        kernels,
        &Sort {
            what: depth,
            passes: 4,
            counters: &counters,
            groups: &groups,
            histogram: &histogram,
            keys: &keys,
            values: &values,
        },
    )?;
    recorder.finish()?.run()?;
    let read = |buffer| read::<u32>(device, buffer, count as usize);
    Ok((read(&keys[sorted])?, read(&values[sorted])?))
}

/// Stages `bin_count` and `bin_scan` alone, for splats in the order of their indices: the pairs
/// that the picture needs, and where each block's begin.
pub fn count_pairs(engine: &Engine, tile_counts: &[u32]) -> Result<(u32, Vec<u32>), Error> {
    let (device, kernels) = (&engine.device, &*engine.kernels);
    let count = tile_counts.len() as u32;
    let blocks = count.div_ceil(BIN_BLOCK);
    let params = Params { splats: count, pair_capacity: u32::MAX, ..Params::default() };
    let params = Buffer::from_slice(device, "parameters", &[params])?;
    let order: Vec<u32> = (0..count).collect();
    let order = Buffer::from_slice(device, "depth order", &order)?;
    let tile_counts = Buffer::from_slice(device, "tile counts", tile_counts)?;
    let sums = Buffer::new::<u32>(device, "block sums", blocks as usize, Memory::Device)?;
    let counters = Buffer::new::<Counters>(device, "counters", 1, Memory::Device)?;
    let mut recorder = Recorder::new(device, Timing::None)?;
    let buffers = [&params, &order, &tile_counts, &sums];
    recorder.dispatch(&kernels.bin_count, &buffers, &[], [blocks, 1, 1])?;
    recorder.dispatch(&kernels.bin_scan, &[&params, &sums, &counters], &[], [1, 1, 1])?;
    recorder.finish()?.run()?;
    let needed = read::<Counters>(device, &counters, 1)?[0].pairs_needed;
    Ok((needed, read(device, &sums, blocks as usize)?))
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
    let mut view = View::new(device, scene, camera, &[1])?;
    view.ask(scene, 0, pair_capacity, pose);

    let by_depth = emit_pairs(device, kernels, scene, &view, &work)?;
    // The sort by tile writes over the pairs as emitted: they are read before it.
    let counters = read::<Counters>(device, &work.counters, 1)?[0];
    let (splats, pairs) = (scene.splats as usize, counters.sort[1] as usize);
    let pair_tiles = read(device, &work.pair_tiles[0], pairs)?;
    let pair_splats = read(device, &work.pair_splats[0], pairs)?;
    let by_tile = sort_pairs(device, kernels, &view, &work)?;
    let derivatives = work.derivatives.as_ref().map(|d| read(device, d, splats));
    Ok(Stages {
        records: read(device, &work.records, splats)?,
        tile_counts: read(device, &work.tile_counts, splats)?,
        derivatives: derivatives.transpose()?.unwrap_or_default(),
        depth_keys: read(device, &work.depth_keys[by_depth], splats)?,
        order: read(device, &work.depth_order[by_depth], splats)?,
        pairs_needed: counters.pairs_needed,
        pair_tiles,
        pair_splats,
        sorted_tiles: read(device, &work.pair_tiles[by_tile], pairs)?,
        sorted_splats: read(device, &work.pair_splats[by_tile], pairs)?,
        ranges: read(device, &view.ranges, view.most_tiles() as usize)?,
    })
}

/// Runs the stages up to the pairs in depth order; returns which of the depth orders is sorted.
fn emit_pairs(
    device: &Device,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
) -> Result<usize, Error> {
    let mut recorder = Recorder::new(device, Timing::None)?;
    let r = &mut recorder;
    r.copy(&view.params_asked, &view.params)?;
    r.copy(&view.groups_asked, &view.groups)?;
    let by_depth = lists::record_pairs(r, kernels, scene, view, work, Part::First)?;
    derive::record(r, kernels, scene, view, work, Part::First)?;
    recorder.finish()?.run()?;
    Ok(by_depth)
}

/// Sorts the pairs by tile and finds the ranges; returns which of the pair buffers is sorted.
fn sort_pairs(
    device: &Device,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
) -> Result<usize, Error> {
    let mut recorder = Recorder::new(device, Timing::None)?;
    let sorted = lists::record_ranges(&mut recorder, kernels, view, work, Part::First)?;
    recorder.finish()?.run()?;
    Ok(sorted)
}

/// The first `count` values of a buffer that only the device sees.
fn read<T: AnyBitPattern>(device: &Device, from: &Buffer, count: usize) -> Result<Vec<T>, Error> {
    let to = Buffer::new::<T>(device, "probe", count, Memory::Readback)?;
    let mut recorder = Recorder::new(device, Timing::None)?;
    recorder.copy(from, &to)?;
    recorder.finish()?.run()?;
    Ok(to.read(count).to_vec())
}
