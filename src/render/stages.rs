//! The stages of a frame, in the order in which the device runs them.

use std::mem::offset_of;

use crate::shared::{GROUP, Groups, PyramidLevel, PyramidLevels};
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::frame::{Bytes, FrameBuffers};
use super::jacobian::Jacobian;
use super::levels::{Level, LevelBuffers, Pass};
use super::radix::{Sort, SortPrecision};
use super::splat_buffers::SplatBuffers;
use super::workspace::Workspace;

/// Evaluations that a frame's first submission has room for. A frame that follows another takes one or two. Unused ones
/// cost their empty dispatches, nine each.
const EVALUATIONS: usize = 4;
/// Evaluations that each further submission of a longer search has room for.
const FURTHER_EVALUATIONS: usize = 4;
/// Evaluations whose times are kept.
pub const TIMED_EVALUATIONS: usize = EVALUATIONS + 20 * FURTHER_EVALUATIONS;

/// Which parts of a picture are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// Colours, depth and transmittance.
    All,
    /// Depth is not.
    Colour,
}

/// Where the camera is.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum CameraPose {
    /// At the pose of the parameters.
    Asked,
    /// At the coded pose.
    Coded,
}

/// What a final picture comes with.
pub struct PictureEnds<'a> {
    /// Depths, for the host to read.
    pub depths: bool,
    /// The difference from this frame.
    pub frame: Option<&'a FrameBuffers>,
}

/// What all stages are recorded with. A [`Pass`] says which workgroup counts a dispatch uses.
#[derive(Clone, Copy)]
pub struct Stages<'a> {
    pub kernels: &'a Kernels,
    pub splats: &'a SplatBuffers,
    pub levels: &'a LevelBuffers,
    pub work: &'a Workspace,
    pub bytes: &'a Bytes,
}

/// What a search is recorded with beyond that.
#[derive(Clone, Copy)]
pub struct SearchStages<'a> {
    pub stages: Stages<'a>,
    pub frame: &'a FrameBuffers,
    pub jacobian: Jacobian,
    pub sort_precision: SortPrecision,
    /// The final picture comes with depths.
    pub depths: bool,
}

impl SearchStages<'_> {
    /// A frame from its bytes on: pyramid, evaluations, pictures.
    pub fn record(&self, r: &mut Recorder) -> Result<(), Error> {
        let Stages { levels, bytes, .. } = self.stages;
        self.stages.clear_sums(r);
        r.copy_beside(&self.frame.search_asked, &self.frame.search);
        r.copy_beside(&bytes.coded_asked, &bytes.coded);
        r.copy_beside(&levels.params_asked, &levels.params);
        r.copy_beside(&levels.groups_asked, &levels.groups);
        self.stages.pyramid(r, self.frame)?;
        self.record_evaluations(r, EVALUATIONS)
    }

    /// Records further evaluations of a search under way, and its final pictures.
    pub fn record_more(&self, r: &mut Recorder) -> Result<(), Error> {
        // What follows needs them at once, so no stage can be beside.
        self.stages.clear_sums(r);
        r.barrier("clear");
        self.record_evaluations(r, FURTHER_EVALUATIONS)
    }

    fn record_evaluations(&self, r: &mut Recorder, count: usize) -> Result<(), Error> {
        for _ in 0..count {
            self.stages.equations(r, self.jacobian, self.sort_precision)?;
            self.solve(r)?;
            r.mark("evaluation");
        }
        self.record_pictures(r)?;
        let (stages, frame) = (&self.stages, self.frame);
        r.copy_beside(&frame.search, &frame.search_read);
        r.copy_beside(&stages.levels.partials, &frame.tile_sums_read);
        r.copy_beside(&stages.bytes.coded, &frame.coded_read);
        r.copy(&stages.work.counters, &stages.work.counters_read);
        r.mark("pictures");
        Ok(())
    }

    /// Records the picture at the pose as its packet holds it, and the difference from the frame.
    fn record_pictures(&self, r: &mut Recorder) -> Result<(), Error> {
        let ends = PictureEnds { depths: self.depths, frame: Some(self.frame) };
        self.stages.final_picture(r, &ends, CameraPose::Coded, Pass::Picture)
    }

    /// Records the search's next step. It reduces the sums of the tiles itself.
    fn solve(&self, r: &mut Recorder) -> Result<(), Error> {
        let Stages { kernels, levels, work, bytes, .. } = self.stages;
        let buffers = [
            &levels.prototypes,
            &self.frame.search,
            &levels.partials,
            &levels.params,
            &levels.groups,
            &work.counters,
            &bytes.coded,
        ];
        let one = Pass::Evaluation.at(offset_of!(Groups, one));
        r.dispatch_indirect(&kernels.solve, &buffers, &[], &levels.groups, one)
    }
}

impl Stages<'_> {
    /// The camera's frame at every level.
    pub fn pyramid(&self, r: &mut Recorder, frame: &FrameBuffers) -> Result<(), Error> {
        let sizes = &self.levels.sizes;
        let mut levels = PyramidLevels {
            frame_width: sizes[0].camera.width,
            count: sizes.len() as u32,
            ..PyramidLevels::default()
        };
        for (to, Level { camera, factor, .. }) in levels.levels.iter_mut().zip(sizes) {
            *to = PyramidLevel { width: camera.width, height: camera.height, factor: *factor };
        }
        let buffers = [&frame.bytes, &self.levels.frame, &frame.light, &frame.mask];
        // Uses the second axis too: 4096×4096 pixels take more workgroups than some devices allow along one axis.
        let groups: u32 = levels.levels.iter().map(|level| level.pixels().div_ceil(GROUP)).sum();
        let down = groups.div_ceil(GROUP);
        let groups = [groups.div_ceil(down), down, 1];
        r.dispatch(&self.kernels.pyramid, &buffers, bytemuck::cast_slice(&[levels]), groups)
    }

    /// Clears the sums that the stages after the next add to, beside what is recorded next.
    pub fn clear_sums(&self, r: &mut Recorder) {
        let words = self.work.sum_words;
        if words > 0 {
            r.clear_beside(&self.work.histogram, words);
        }
    }

    /// The picture, from the splats on.
    pub fn picture(
        &self,
        r: &mut Recorder,
        channels: Channels,
        camera_pose: CameraPose,
        pass: Pass,
    ) -> Result<(), Error> {
        self.tile_lists(r, SortPrecision::Exact, camera_pose, pass)?;
        self.splat(r, channels, pass)
    }

    /// The picture in 8 bits, from the splats on.
    pub fn final_picture(
        &self,
        r: &mut Recorder,
        ends: &PictureEnds,
        camera_pose: CameraPose,
        pass: Pass,
    ) -> Result<(), Error> {
        let channels = if ends.depths { Channels::All } else { Channels::Colour };
        self.picture(r, channels, camera_pose, pass)?;
        if ends.depths {
            r.copy_beside(&self.levels.image, &self.levels.image_read);
        }
        self.quantize_rgb8(r, ends.frame, pass)
    }

    /// Each tile's share of the normal equations, from the splats on.
    pub fn equations(
        &self,
        r: &mut Recorder,
        jacobian: Jacobian,
        sort_precision: SortPrecision,
    ) -> Result<(), Error> {
        let pass = Pass::Evaluation;
        self.tile_lists(r, sort_precision, CameraPose::Asked, pass)?;
        match jacobian {
            Jacobian::Flow => self.splat_flow(r, pass),
            Jacobian::Exact => {
                self.pose_jacobian(r, pass)?;
                self.splat_exact(r, pass)
            }
        }
    }

    /// Records the lists of each tile's splats in depth order. Every picture and every sum begins with them.
    pub fn tile_lists(
        &self,
        r: &mut Recorder,
        sort_precision: SortPrecision,
        camera_pose: CameraPose,
        pass: Pass,
    ) -> Result<(), Error> {
        self.project(r, sort_precision, camera_pose, pass)?;
        self.sort(r, sort_precision, pass)?;
        self.bin(r, pass)?;
        self.clear_sums(r);
        Ok(())
    }

    /// Mean, conic, colour and depth key of every splat, and the counts of the keys' first digits.
    fn project(
        &self,
        r: &mut Recorder,
        sort_precision: SortPrecision,
        camera_pose: CameraPose,
        pass: Pass,
    ) -> Result<(), Error> {
        let Stages { splats, levels, work, .. } = *self;
        let (geometry, sh) = (&splats.geometry, &splats.sh);
        let (records, keys, counters) = (&work.records, &work.keys, &work.counters);
        let (histogram, coded) = (&work.histogram, &self.bytes.coded);
        let buffers = [&levels.params, geometry, sh, records, keys, counters, histogram, coded];
        let is_coded = (camera_pose == CameraPose::Coded).into();
        let push = [is_coded, sort_precision.first_digit(), levels.log_sort_blocks];
        let blocks = pass.at(offset_of!(Groups, sort_blocks));
        r.dispatch_indirect(&splats.kernels.project, &buffers, &push, &levels.groups, blocks)
    }

    /// The splats in the order of their depths.
    fn sort(
        &self,
        r: &mut Recorder,
        sort_precision: SortPrecision,
        pass: Pass,
    ) -> Result<(), Error> {
        let Stages { levels, work, .. } = *self;
        let sort = Sort {
            sort_precision,
            count: None,
            log_blocks: levels.log_sort_blocks,
            pass,
            groups: &levels.groups,
            counters: &work.counters,
            histogram: &work.histogram,
            keys: &work.keys,
            between: &work.between,
            order: &work.order,
        };
        sort.record(r, self.kernels)
    }

    /// Stages `bin_count`, `bin_scan`, `bin_emit`: the sorted splats by tile.
    fn bin(&self, r: &mut Recorder, pass: Pass) -> Result<(), Error> {
        let Stages { kernels, levels, work, .. } = *self;
        let split = [levels.binning.log_blocks];
        let blocks = pass.at(offset_of!(Groups, bin_blocks));
        let bands_at = pass.at(offset_of!(Groups, bands));
        let groups = &levels.groups;
        let (params, counters, starts) = (&levels.params, &work.counters, &levels.binning.starts);
        let (order, records, bands) = (&work.order, &work.records, &levels.bands);
        let buffers = [params, counters, order, records, starts];
        r.dispatch_indirect(&kernels.bin_count, &buffers, &split, groups, blocks)?;
        let buffers = [params, starts, bands];
        r.dispatch_indirect(&kernels.bin_scan, &buffers, &split, groups, bands_at)?;
        let (ranges, pairs) = (&levels.ranges, &work.pair_splats);
        let buffers = [params, counters, order, records, starts, bands, ranges, pairs];
        r.dispatch_indirect(&kernels.bin_emit, &buffers, &split, groups, blocks)
    }

    /// The picture, blended tile by tile.
    fn splat(&self, r: &mut Recorder, channels: Channels, pass: Pass) -> Result<(), Error> {
        let Stages { splats, levels, work, .. } = *self;
        let (params, counters) = (&levels.params, &work.counters);
        let pairs = &work.pair_splats;
        let buffers = [params, &levels.ranges, pairs, &work.records, &levels.image, counters];
        let kernel = match channels {
            Channels::All => &splats.kernels.splat,
            Channels::Colour => &splats.kernels.splat_colour,
        };
        let tiles = pass.at(offset_of!(Groups, tile_groups));
        r.dispatch_indirect(kernel, &buffers, &[], &levels.groups, tiles)
    }

    /// Each tile's share of the normal equations, by the optical-flow Jacobian.
    fn splat_flow(&self, r: &mut Recorder, pass: Pass) -> Result<(), Error> {
        let Stages { splats, levels, work, .. } = *self;
        let (params, ranges, counters) = (&levels.params, &levels.ranges, &work.counters);
        let (pairs, frame, partials) = (&work.pair_splats, &levels.frame, &levels.partials);
        let buffers = [params, ranges, pairs, &work.records, frame, partials, counters];
        let tiles = pass.at(offset_of!(Groups, tile_groups));
        r.dispatch_indirect(&splats.kernels.splat_flow, &buffers, &[], &levels.groups, tiles)
    }

    /// Records the pose derivatives of every visible splat, for the exact Jacobian. Records nothing if the workspace
    /// was made without room for them.
    pub fn pose_jacobian(&self, r: &mut Recorder, pass: Pass) -> Result<(), Error> {
        let Stages { splats, levels, work, .. } = *self;
        let Some(derivatives) = &work.derivatives else { return Ok(()) };
        let (geometry, sh) = (&splats.geometry, &splats.sh);
        let buffers = [&levels.params, geometry, sh, &work.records, &work.keys, derivatives];
        let groups = pass.at(offset_of!(Groups, splats));
        r.dispatch_indirect(&splats.kernels.pose_jacobian, &buffers, &[], &levels.groups, groups)
    }

    /// Records each tile's share of the normal equations, by the exact Jacobian. Records nothing if the workspace was
    /// made without room for derivatives.
    fn splat_exact(&self, r: &mut Recorder, pass: Pass) -> Result<(), Error> {
        let Stages { splats, levels, work, .. } = *self;
        let Some(derivatives) = &work.derivatives else { return Ok(()) };
        let (params, ranges, counters) = (&levels.params, &levels.ranges, &work.counters);
        let (pairs, frame, partials) = (&work.pair_splats, &levels.frame, &levels.partials);
        let records = &work.records;
        let buffers = [params, ranges, pairs, records, frame, partials, derivatives, counters];
        let tiles = pass.at(offset_of!(Groups, tiles));
        r.dispatch_indirect(&splats.kernels.splat_exact, &buffers, &[], &levels.groups, tiles)
    }

    /// Records the sum of the tiles' shares of the normal equations, in a fixed order. For the host; stage `solve` sums
    /// them itself.
    pub fn reduce(&self, r: &mut Recorder) -> Result<(), Error> {
        let levels = self.levels;
        let buffers = [&levels.params, &levels.partials, &levels.sums];
        let one = Pass::Evaluation.at(offset_of!(Groups, one));
        r.dispatch_indirect(&self.kernels.reduce, &buffers, &[], &levels.groups, one)
    }

    /// The picture in 8 bits and, if there is a frame, the frame less it.
    pub fn quantize_rgb8(
        &self,
        r: &mut Recorder,
        frame: Option<&FrameBuffers>,
        pass: Pass,
    ) -> Result<(), Error> {
        let (levels, render) = (self.levels, &self.bytes.render);
        // Without a frame anything is bound in its place.
        let [from, to] = frame.map_or([render; 2], |frame| [&frame.bytes, &frame.difference]);
        let buffers = [&levels.params, &levels.image, render, from, to];
        let byte_words = pass.at(offset_of!(Groups, byte_words));
        let push = [frame.is_some().into()];
        r.dispatch_indirect(
            &self.kernels.quantize_rgb8,
            &buffers,
            &push,
            &levels.groups,
            byte_words,
        )
    }
}
