//! Runs single stages and reads what they leave on the device: for tests and measurements.

use nvsprior::parts::{
    Bytes, CameraPose, LevelBuffers, Pass, Sort, Workspace, kernels, radix, stages,
};
use nvsprior::render::{Kernels, Scene};
use nvsprior::vulkan::{Buffer, Device, Error, Memory, Recorder, Timing};
use nvsprior::{Camera, Engine, Pose};
use nvsprior_kernels::shared::{CULLED, Counters, DERIVATIVES, Groups, Params, RECORD, digit_bits};

pub use nvsprior::render::SortPrecision;

/// Runs single stages of an engine: see [`Probe::of`].
#[derive(Clone, Copy)]
pub struct Probe<'a> {
    device: &'a Device,
    kernels: &'a Kernels,
}

/// What stage `bin_scan` makes of each block's pairs by tile.
pub struct TileStarts {
    /// Pairs of the tiles.
    pub pairs: u32,
    /// Where each block's part of each tile's list begins. At the end: where the lists end.
    pub starts: Vec<u32>,
}

/// What each stage before the blending left, up to the pairs that there was room for.
#[derive(Clone, Debug)]
pub struct Stages {
    /// What stage `project` wrote: twelve floats per splat, unset if the splat is culled. One more record at the end
    /// shows nothing.
    pub records: Vec<[f32; 4 * RECORD as usize]>,
    /// Stage `project`.
    pub keys: Vec<u32>,
    /// Stage `pose_jacobian`, as the records.
    pub derivatives: Vec<[f32; 4 * DERIVATIVES as usize]>,
    /// Visible splats in the order of their keys.
    pub order: Vec<u32>,
    /// Bits of a digit of the sort.
    pub digit_bits: u32,
    /// Pairs that the picture needs.
    pub pairs_needed: u32,
    /// Stage `bin_emit`: the splats of all tiles.
    pub pair_splats: Vec<u32>,
    /// Stage `bin_emit`: the range of each tile's pairs.
    pub ranges: Vec<[u32; 2]>,
}

impl<'a> Probe<'a> {
    /// Of an engine.
    pub fn of(engine: &'a Engine) -> Probe<'a> {
        Probe { device: engine.vulkan(), kernels: engine.kernels() }
    }

    /// The places of the keys in the order of their values, equal keys in the order of their places. [`CULLED`] keys
    /// are left out.
    pub fn sort(&self, keys: &[u32], sort_precision: SortPrecision) -> Result<Vec<u32>, Error> {
        self.sort_in_blocks(keys, sort_precision, self.log_sort_blocks(keys.len() as u32))
    }

    /// As [`sort`](Self::sort), shared by 2^`log_blocks` workgroups.
    pub fn sort_in_blocks(
        &self,
        keys: &[u32],
        sort_precision: SortPrecision,
        log_blocks: u32,
    ) -> Result<Vec<u32>, Error> {
        let Probe { device, kernels } = *self;
        let count = keys.len() as u32;
        let own = |name, count| Buffer::new::<u32>(device, name, count, Memory::Device);
        let between = || Ok::<_, Error>([own("keys", keys.len())?, own("values", keys.len())?]);
        let largest = keys.iter().copied().filter(|key| *key != CULLED).max();
        let digit_bits = digit_bits(largest.unwrap_or(0));
        let counters = Counters { digit_bits, ..Counters::default() };
        let counters = Buffer::from_slice(device, "counters", &[counters])?;
        let order = own("order", keys.len())?;
        let groups = Groups { sort_blocks: [1 << log_blocks, 1, 1], ..Groups::NONE };
        let table = radix::histogram(log_blocks);
        let histogram = own("digit histogram", table.words() as usize)?;
        let sort = Sort {
            sort_precision,
            count: Some(count),
            log_blocks,
            pass: Pass::Evaluation,
            groups: &Buffer::from_slice(device, "workgroups", &[groups])?,
            counters: &counters,
            histogram: &histogram,
            keys: &Buffer::from_slice(device, "keys", keys)?,
            between: &[between()?, between()?],
            order: &order,
        };
        let mut recorder = Recorder::new(device, Timing::None)?;
        recorder.fill(&histogram, 0);
        sort.record(&mut recorder, kernels)?;
        recorder.finish()?.run()?;
        let sorted = counters.fetch::<Counters>(device, 1)?[0].visible;
        order.fetch(device, sorted as usize)
    }

    /// Logarithm, base 2, of the number of workgroups that share a sort of `keys` keys.
    pub fn log_sort_blocks(&self, keys: u32) -> u32 {
        kernels::log_sort_blocks(self.device.info(), keys)
    }

    /// Logarithm, base 2, of the number of workgroups that share the binning of `splats` splats. Large pictures have
    /// fewer.
    pub fn log_bin_blocks(&self, splats: u32) -> u32 {
        kernels::log_bin_blocks(self.device.info(), splats)
    }

    /// Rows of tiles of a band at most.
    pub fn band_rows(&self) -> u32 {
        kernels::band_rows(self.device.info())
    }

    /// Tiles of a band at most.
    pub fn bin_table(&self) -> u32 {
        kernels::bin_table(self.device.info())
    }

    /// Stage `bin_scan` alone, on blocks × tiles counts of one band.
    ///
    /// # Panics
    /// If the blocks are not a power of two from 4 on, or there are not `tiles` counts each.
    pub fn scan_tiles(&self, tiles: u32, counts: &[u32]) -> Result<TileStarts, Error> {
        let Probe { device, kernels } = *self;
        let log_blocks = (counts.len() as u32 / tiles).ilog2();
        assert!(log_blocks >= 2, "four blocks or more");
        assert_eq!((tiles as usize) << log_blocks, counts.len(), "counts of whole blocks");
        let params = Params { tiles_x: tiles, tiles_y: 1, band_rows: 1, ..Params::default() };
        let params = Buffer::from_slice(device, "parameters", &[params])?;
        let mut starts = counts.to_vec();
        starts.resize(counts.len() + tiles as usize, 0);
        let starts = Buffer::from_slice(device, "tile starts", &starts)?;
        let bands = Buffer::new::<u32>(device, "bands", 1, Memory::Device)?;
        let mut recorder = Recorder::new(device, Timing::None)?;
        let buffers = [&params, &starts, &bands];
        recorder.dispatch(&kernels.bin_scan, &buffers, &[log_blocks], [1, 1, 1])?;
        recorder.finish()?.run()?;
        Ok(TileStarts {
            pairs: bands.fetch::<u32>(device, 1)?[0],
            starts: starts.fetch(device, counts.len() + tiles as usize)?,
        })
    }

    /// Runs the stages before the blending at a pose, with room for `pair_capacity` pairs.
    pub fn stages(
        &self,
        scene: &Scene,
        camera: &Camera,
        pose: &Pose,
        pair_capacity: u32,
        sort_precision: SortPrecision,
    ) -> Result<Stages, Error> {
        self.stages_at(scene, camera, 1, pose, pair_capacity, sort_precision)
    }

    /// As [`Probe::stages`], for the level of the pyramid that is reduced by `factor`.
    pub fn stages_at(
        &self,
        scene: &Scene,
        camera: &Camera,
        factor: u32,
        pose: &Pose,
        pair_capacity: u32,
        sort_precision: SortPrecision,
    ) -> Result<Stages, Error> {
        let Probe { device, kernels } = *self;
        let work = Workspace::new(device, scene.splat_buffers(), pair_capacity, true)?;
        let mut levels = LevelBuffers::new(device, scene.splat_buffers(), camera, &[factor])?;
        levels.ask(scene, 0, pair_capacity, pose);

        let mut recorder = Recorder::new(device, Timing::None)?;
        let bytes = &Bytes::new(device, &levels)?;
        let stages = stages::Stages {
            kernels,
            splats: scene.splat_buffers(),
            levels: &levels,
            work: &work,
            bytes,
        };
        stages.clear_sums(&mut recorder);
        recorder.copy_beside(&levels.params_asked, &levels.params);
        recorder.copy(&levels.groups_asked, &levels.groups);
        stages.tile_lists(&mut recorder, sort_precision, CameraPose::Asked, Pass::Evaluation)?;
        stages.pose_jacobian(&mut recorder, Pass::Evaluation)?;
        recorder.finish()?.run()?;
        let counters = work.counters.fetch::<Counters>(device, 1)?[0];
        let splats = scene.splat_buffers().room as usize;
        let pairs = counters.pairs_needed.min(pair_capacity) as usize;
        let Params { tiles_x, tiles_y, .. } = levels.sizes[0].params;
        let tiles = tiles_x * tiles_y;
        let derivatives = work.derivatives.as_ref().map(|d| d.fetch(device, splats + 1));
        Ok(Stages {
            records: work.records.fetch(device, splats + 1)?,
            keys: work.keys.fetch(device, splats)?,
            derivatives: derivatives.transpose()?.unwrap_or_default(),
            order: work.order.fetch(device, counters.visible as usize)?,
            digit_bits: counters.digit_bits,
            pairs_needed: counters.pairs_needed,
            pair_splats: work.pair_splats.fetch(device, pairs)?,
            ranges: levels.ranges.fetch(device, tiles as usize)?,
        })
    }
}
