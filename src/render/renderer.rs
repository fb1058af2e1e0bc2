//! The recorded chains of stages, and how the host has them run.

use std::sync::{Arc, MutexGuard};

use bytemuck::Zeroable;

use crate::image::Mask;
use crate::prior::blocked::Block;
use crate::queue::Interrupt;
use crate::search::{self, LEVELS, Placement, PoseCode, Program, STARTS, Search};
use crate::shared::{self, CELL, Counters, PIXEL, SUMS, TILE};
use crate::vulkan::{CommandCounts, Commands, Device, Error, Recorder, StageTime, Timing};
use crate::{Camera, Picture, Pose};

use super::binning::{self, Binning};
use super::frame::{Bytes, Coded, FrameBuffers};
use super::jacobian::Jacobian;
use super::levels::{LevelBuffers, NormalEquations, Pass, anchor, pose_of};
use super::light::{Correction, FlatField};
use super::radix::SortPrecision;
use super::sight::{Reach, Sight};
use super::splat_buffers::DrawnSplats;
use super::stages::{CameraPose, Channels, PictureEnds, SearchStages, Stages, TIMED_EVALUATIONS};
use super::tile_sums::TileSums;
use super::window::{Content, Window};
use super::workspace::Workspace;
use super::{Kernels, Scene};

/// What a renderer is to be ready for; only that is allocated and recorded.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Reduction factors of the pyramid's levels, at most eight. Level 0 should be 1, the full
    /// picture.
    pub factors: Vec<u32>,
    /// Jacobians that the host will ask for.
    pub jacobians: Vec<Jacobian>,
    /// Have the device search for poses, with this Jacobian.
    pub search: Option<Jacobian>,
    /// How finely the search's evaluations tell depths apart.
    pub sort_precision: SortPrecision,
    /// Pictures at coded poses come with depths: those of a search, and those of [`Renderer::draw_coded_deep`].
    pub depths: bool,
    /// Have the device time each stage.
    pub profiled: bool,
}

impl Plan {
    /// The full picture alone, without normal equations.
    pub fn picture() -> Plan {
        Plan {
            factors: vec![1],
            jacobians: Vec::new(),
            search: None,
            sort_precision: SortPrecision::default(),
            depths: false,
            profiled: false,
        }
    }

    fn exact(&self) -> bool {
        self.jacobians.contains(&Jacobian::Exact) || self.search == Some(Jacobian::Exact)
    }
}

/// What the host can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// The picture, depth and transmittance, as floats.
    Draw,
    /// The picture in 8 bits.
    Picture,
    /// The picture in 8 bits, at a coded pose.
    Coded,
    /// The same, and its depths.
    CodedDeep,
    /// The camera's frame, reduced to all levels.
    Pyramid,
    /// The normal equations.
    Sums(Jacobian),
    /// A frame from its bytes to its pictures: see [`Renderer::search`].
    Search,
    /// More evaluations of a search.
    More,
}

/// What a frame's first submission has the device do.
#[derive(Clone, Copy, Debug)]
pub struct SearchCommands {
    /// All that is recorded.
    pub all: CommandCounts,
    /// What is recorded for one evaluation.
    pub slot: CommandCounts,
    /// Evaluations that there is room for. What is recorded for those that a search does not need still costs time.
    pub slots: u32,
}

/// What a search found.
pub struct Searched<'a> {
    /// Its record.
    pub search: &'a Search,
    /// The pose, as its packet holds it.
    pub code: PoseCode,
    /// Submissions that it took.
    pub submissions: u32,
    /// Milliseconds from the first submission to the end of each evaluation, in order. Holds only what the device
    /// reports.
    pub times: &'a [f64],
}

/// Renders one prior for one camera. All commands are recorded beforehand; a render writes the pose,
/// submits and waits.
pub struct Renderer {
    device: Device,
    kernels: Arc<Kernels>,
    scene: Arc<Scene>,
    /// The scene's splats as the levels have them.
    held: DrawnSplats,
    plan: Plan,
    work: Workspace,
    levels: LevelBuffers,
    bytes: Bytes,
    frame: Option<FrameBuffers>,
    recorded: Vec<(Job, Commands)>,
    renders: Vec<u32>,
    times: Vec<f64>,
    /// Where the last picture of a blocked prior was drawn.
    drawn_at: Option<Pose>,
    /// Of the last search, over its submissions, if the plan is profiled.
    search_stages: Vec<StageTime>,
    interrupt: Interrupt,
}

/// How much room to make for `pairs` pairs: some to spare, but no more than storage buffers of `storage_range` bytes
/// hold, unless the pairs themselves take more.
fn room_for(pairs: u32, storage_range: u64) -> u32 {
    let most = (storage_range / size_of::<u32>() as u64).min(u32::MAX.into()) as u32;
    pairs.saturating_add(pairs / 4).min(most).max(pairs)
}

/// A pixel that shows less than this share of light has no depth to speak of.
const LEAST_SHOWN: f32 = 1e-3;

/// Searches on a blocked prior after which one that still lacks blocks is taken as it is.
const MOST_SEARCHES: usize = 4;
/// Frames ahead for which blocks of a blocked prior are read.
const AHEAD: [f64; 3] = [0.0, 5.0, 15.0];

/// Submissions after which a search is given up. The search's own limits let none need as many.
const MOST_SUBMISSIONS: u32 = 160;

impl Renderer {
    /// Allocates and records everything of `plan`. Levels that would have no pixel are left out.
    pub fn new(
        device: &Device,
        kernels: &Arc<Kernels>,
        scene: &Arc<Scene>,
        camera: &Camera,
        plan: Plan,
    ) -> Result<Renderer, Error> {
        // Room for a few tiles per splat. A picture that needs more makes it grow once.
        let pairs = (scene.splats.room.saturating_mul(8)).clamp(1 << 14, 1 << 22);
        let held = scene.splats.held();
        let levels = LevelBuffers::new(device, &scene.splats, camera, &plan.factors)?;
        let framed = plan.search.is_some() || !plan.jacobians.is_empty();
        let mut renderer = Renderer {
            device: device.clone(),
            kernels: kernels.clone(),
            scene: scene.clone(),
            work: Workspace::new(device, &scene.splats, pairs, plan.exact())?,
            bytes: Bytes::new(device, &levels)?,
            frame: framed.then(|| FrameBuffers::new(device, &levels)).transpose()?,
            renders: vec![0; levels.sizes.len()],
            times: Vec::with_capacity(TIMED_EVALUATIONS),
            drawn_at: None,
            search_stages: Vec::new(),
            interrupt: Interrupt::default(),
            recorded: Vec::new(),
            held,
            levels,
            plan,
        };
        renderer.recorded = renderer.record_all(&renderer.work)?;
        renderer.levels.set_room(pairs);
        Ok(renderer)
    }

    /// Sets what ends work between two submissions, with [`Error::Interrupted`].
    pub(crate) fn set_interrupt(&mut self, interrupt: &Interrupt) {
        self.interrupt = interrupt.clone();
    }

    fn record_all(&self, work: &Workspace) -> Result<Vec<(Job, Commands)>, Error> {
        let mut jobs = vec![Job::Draw, Job::Picture, Job::Coded];
        jobs.extend(self.plan.depths.then_some(Job::CodedDeep));
        jobs.extend(self.plan.jacobians.iter().map(|jacobian| Job::Sums(*jacobian)));
        jobs.extend(self.frame.is_some().then_some(Job::Pyramid));
        if self.plan.search.is_some() {
            jobs.extend([Job::Search, Job::More]);
        }
        jobs.into_iter().map(|job| Ok((job, self.record(work, job)?))).collect()
    }

    fn record(&self, work: &Workspace, job: Job) -> Result<Commands, Error> {
        let timing = match job {
            _ if self.plan.profiled => Timing::Stages,
            Job::Search | Job::More => Timing::Marks,
            _ => Timing::None,
        };
        let mut recorder = Recorder::new(&self.device, timing)?;
        let (kernels, splats) = (&*self.kernels, &self.scene.splats);
        let stages = Stages { kernels, splats, levels: &self.levels, work, bytes: &self.bytes };
        match (job, &self.frame) {
            (Job::Pyramid, Some(frame)) => stages.pyramid(&mut recorder, frame)?,
            (Job::Search, Some(frame)) => {
                self.search_stages(stages, frame).record(&mut recorder)?
            }
            (Job::More, Some(frame)) => {
                self.search_stages(stages, frame).record_more(&mut recorder)?;
            }
            _ => self.record_asked(&mut recorder, &stages, job)?,
        }
        recorder.finish()
    }

    fn search_stages<'a>(&self, stages: Stages<'a>, frame: &'a FrameBuffers) -> SearchStages<'a> {
        let jacobian = self.plan.search.unwrap_or(Jacobian::Flow);
        let Plan { sort_precision, depths, .. } = self.plan;
        SearchStages { stages, frame, jacobian, sort_precision, depths }
    }

    /// What the host asks for at one pose.
    fn record_asked(&self, r: &mut Recorder, stages: &Stages, job: Job) -> Result<(), Error> {
        let (levels, work, pass) = (&self.levels, stages.work, Pass::Evaluation);
        stages.clear_sums(r);
        r.copy_beside(&self.bytes.coded_asked, &self.bytes.coded);
        r.copy_beside(&levels.params_asked, &levels.params);
        r.copy(&levels.groups_asked, &levels.groups);
        match job {
            Job::Draw => {
                stages.picture(r, Channels::All, CameraPose::Asked, pass)?;
                r.copy_beside(&levels.image, &levels.image_read);
            }
            Job::Sums(jacobian) => {
                stages.equations(r, jacobian, SortPrecision::Exact)?;
                stages.reduce(r)?;
            }
            _ => {
                let camera_pose =
                    if job == Job::Picture { CameraPose::Asked } else { CameraPose::Coded };
                let ends =
                    PictureEnds { depths: job == Job::CodedDeep, frame: self.frame.as_ref() };
                stages.final_picture(r, &ends, camera_pose, pass)?;
            }
        }
        r.copy(&work.counters, &work.counters_read);
        Ok(())
    }

    fn submit(&mut self, job: Job) -> Result<(), Error> {
        if self.interrupt.is_set() {
            return Err(Error::Interrupted);
        }
        let commands = self.recorded.iter_mut().find(|(recorded, _)| *recorded == job);
        commands.expect("only what was planned is asked for").1.run()
    }

    /// Runs a job of a level. If the picture needs more pairs than there is room for, makes room
    /// and runs again, so that a result is always complete.
    fn run(&mut self, level: usize, job: Job, pose: &Pose) -> Result<(), Error> {
        let scene = self.scene.clone();
        let _seen = self.see(&scene, level, pose)?;
        self.follow_scene();
        loop {
            self.levels.ask(&self.scene, level, self.work.pair_capacity, pose);
            self.submit(job)?;
            if !self.grow(0)? {
                self.renders[level] += 1;
                return Ok(());
            }
        }
    }

    /// Brings what a level shows at a pose to the device, and keeps it there as long as the guard is held. Only a
    /// blocked prior needs that.
    fn see<'a>(
        &self,
        scene: &'a Scene,
        level: usize,
        pose: &Pose,
    ) -> Result<Option<MutexGuard<'a, Content>>, Error> {
        let Some(window) = scene.window() else { return Ok(None) };
        let sight = |reach| self.sight(level, pose, reach);
        let (needed, wanted) = (sight(Reach::NONE), sight(window.wanted()));
        let seen = window.see(
            &scene.splats,
            |block| needed.may_show(block),
            |block| wanted.may_show(block),
        );
        seen.map(Some)
    }

    /// What a level can see within a reach of a pose.
    fn sight(&self, level: usize, pose: &Pose, reach: Reach) -> Sight {
        let options = &self.scene.splats.options;
        Sight::new([*self.camera(level)].into_iter(), options, pose, reach)
    }

    /// Draws as many splats as the scene holds.
    fn follow_scene(&mut self) {
        let held = self.scene.splats.held();
        if held != self.held {
            self.levels.hold(&held, self.work.pair_capacity);
            self.held = held;
        }
    }

    /// Makes room if the last run, or `needed`, has more pairs than there is room for. Returns whether it did. If it
    /// fails, nothing changes.
    fn grow(&mut self, needed: u32) -> Result<bool, Error> {
        let counters = self.work.counters_read.read::<Counters>(1)[0];
        let pairs = counters.pairs_needed.max(needed);
        if pairs <= self.work.pair_capacity {
            return Ok(false);
        }
        if pairs == u32::MAX {
            return self.split_binning();
        }
        let room = room_for(pairs, self.device.info().storage_range);
        let work = Workspace::new(&self.device, &self.scene.splats, room, self.plan.exact())?;
        self.recorded = self.record_all(&work)?;
        self.work = work;
        self.levels.set_room(room);
        Ok(true)
    }

    /// Shares the binning among more workgroups, so that each goes through fewer pairs: some drivers end long loops. If
    /// it fails, nothing changes.
    fn split_binning(&mut self) -> Result<bool, Error> {
        let before = self.levels.binning.log_blocks;
        let tiles = self.levels.most_tiles();
        let finest = binning::log_most_blocks(tiles);
        if before >= finest {
            return Err(Error::TooManyPairs);
        }
        let finer = Binning::new(&self.device, (before + 2).min(finest), tiles)?;
        let coarser = self.levels.share_binning(finer);
        match self.record_all(&self.work) {
            Ok(recorded) => self.recorded = recorded,
            Err(error) => {
                self.levels.share_binning(coarser);
                return Err(error);
            }
        }
        self.levels.set_room(self.work.pair_capacity);
        Ok(true)
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.sizes.len()
    }

    /// The camera of a level.
    pub fn camera(&self, level: usize) -> &Camera {
        &self.levels.sizes[level].camera
    }

    /// Side of the block of the frame's pixels that one pixel of a level covers.
    pub fn factor(&self, level: usize) -> u32 {
        self.levels.sizes[level].factor
    }

    /// The prior that is drawn.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Draws level 0; see [`draw_level`](Self::draw_level).
    pub fn draw(&mut self, pose: &Pose) -> Result<&[f32], Error> {
        self.draw_level(0, pose)
    }

    /// Draws a level: height × width × 5 floats (linear R, G, B before clamping, depth Σ wᵢ zᵢ,
    /// transmittance).
    pub fn draw_level(&mut self, level: usize, pose: &Pose) -> Result<&[f32], Error> {
        self.run(level, Job::Draw, pose)?;
        Ok(self.levels.image_read.read(self.camera(level).pixels() * PIXEL as usize))
    }

    /// Draws level 0 as 8-bit RGB.
    pub fn picture(&mut self, pose: &Pose, into: &mut Picture) -> Result<(), Error> {
        self.run(0, Job::Picture, pose)?;
        into.data.copy_from_slice(self.rendered());
        Ok(())
    }

    /// Draws level 0 as 8-bit RGB at a packet's pose, to the same bytes as the search that found it.
    pub fn coded_picture(&mut self, code: &PoseCode, into: &mut Picture) -> Result<(), Error> {
        self.draw_coded(code)?;
        into.data.copy_from_slice(self.rendered());
        Ok(())
    }

    /// As [`coded_picture`](Self::coded_picture), but [`rendered`](Self::rendered) reads the
    /// picture. If the plan knows frames, also takes the difference from the picture set.
    pub fn draw_coded(&mut self, code: &PoseCode) -> Result<(), Error> {
        self.run_coded(code, Job::Coded)
    }

    /// As [`draw_coded`](Self::draw_coded), and [`depths`](Self::depths) reads the depths.
    ///
    /// # Panics
    /// If the plan knows no depths.
    pub fn draw_coded_deep(&mut self, code: &PoseCode) -> Result<(), Error> {
        self.run_coded(code, Job::CodedDeep)
    }

    /// As [`draw_coded`](Self::draw_coded), with depths if the plan knows them: as a search leaves its picture.
    pub(crate) fn draw_coded_as_planned(&mut self, code: &PoseCode) -> Result<(), Error> {
        match self.plan.depths {
            true => self.draw_coded_deep(code),
            false => self.draw_coded(code),
        }
    }

    fn run_coded(&mut self, code: &PoseCode, job: Job) -> Result<(), Error> {
        self.bytes.coded_asked.write(&[Coded { anchor: anchor(&self.scene), code: *code }]);
        let pose = pose_of(&self.scene, &self.placed(code));
        self.run(0, job, &pose)?;
        self.read_ahead(&pose);
        Ok(())
    }

    /// Has a blocked prior's blocks read that the frames to come may show, after one at a pose.
    fn read_ahead(&mut self, pose: &Pose) {
        let scene = self.scene.clone();
        let Some(window) = scene.window() else { return };
        let motion = self.drawn_at.replace(*pose).map(|before| pose.after(&before.inverse()).log());
        let reach = window.wanted().times(1.5);
        let ahead = |frames: f64| {
            let moved = motion.map_or(*pose, |motion| pose.stepped(&motion.map(|v| frames * v)));
            self.sight(0, &moved, reach)
        };
        window.expect(&AHEAD.map(ahead));
    }

    /// Mean depth of what each pixel of the picture drawn last shows, row by row: the same bits on every portable
    /// device. It is meant for pictures at coded poses that were drawn with depths. A pixel that shows next to nothing
    /// has any depth, 0 for one.
    pub fn depths(&self) -> impl Iterator<Item = f32> {
        let floats = self.levels.image_read.read::<f32>(self.camera(0).pixels() * PIXEL as usize);
        floats
            .chunks_exact(PIXEL as usize)
            .map(|pixel| pixel[3] / shared::max(1.0 - pixel[4], LEAST_SHOWN))
    }

    /// Where a packet's pose puts the camera, as numbers that are the same on every device.
    pub fn placed(&self, code: &PoseCode) -> Placement {
        search::placed(code, &anchor(&self.scene))
    }

    /// The 8-bit picture drawn last, RGB.
    pub fn rendered(&self) -> &[u8] {
        self.bytes.render.read(self.camera(0).pixels() * 3)
    }

    /// `clamp(frame − render, −128, 127) + 128` of the picture set and the 8-bit picture drawn last.
    ///
    /// # Panics
    /// If the plan knows no frame.
    pub fn difference(&self) -> &[u8] {
        self.framed().difference.read(self.camera(0).pixels() * 3)
    }

    fn framed(&self) -> &FrameBuffers {
        self.frame.as_ref().expect("only planned frames are asked for")
    }

    /// Takes the camera's picture for the next search.
    ///
    /// # Panics
    /// If it has not the size of level 0, or the plan knows no frame.
    pub fn set_picture(&mut self, frame: &Picture) {
        let camera = self.camera(0);
        assert_eq!((frame.width, frame.height), (camera.width, camera.height), "frame size");
        self.frame.as_mut().expect("only planned frames are set").set(frame);
    }

    /// Sets how searches and evaluations correct the light of pictures from here on, and which pixels count. The
    /// difference is taken from the picture as it is.
    ///
    /// # Panics
    /// If the plan knows no frame, or the flat field is not of the size of level 0.
    pub fn set_light(&mut self, correction: &Correction, field: &FlatField) {
        let camera = self.camera(0);
        let side = |length: u32| (length / CELL) as usize;
        assert_eq!(field.size(), [side(camera.width), side(camera.height)], "cells");
        self.frame.as_mut().expect("only planned frames are lit").set_light(correction, field);
    }

    /// Sets which pixels of pictures count in searches and evaluations from here on; `None`: all do. A pixel of a level
    /// counts if all that it shows does.
    ///
    /// # Panics
    /// If the plan knows no frame, or the mask is not of the size of level 0.
    pub fn set_mask(&mut self, mask: Option<&Mask>) {
        let camera = *self.camera(0);
        let fits = |mask: &Mask| {
            (mask.width, mask.height, mask.data.len())
                == (camera.width, camera.height, camera.pixels())
        };
        assert!(mask.is_none_or(fits), "a mask of level 0's size");
        for level in &mut self.levels.sizes {
            level.count(mask.map(|mask| mask.reduced(level.factor)).as_ref());
        }
        self.frame.as_mut().expect("only planned frames are masked").set_mask(mask);
    }

    /// Pixels of a level that count: all, and those of the rows of tiles that a sparse evaluation draws.
    pub fn counted(&self, level: usize) -> [usize; 2] {
        self.levels.sizes[level].counted
    }

    /// Of how many rows of tiles a sparse evaluation of a level draws one, as a power of 2.
    pub fn sparse_shift(&self, level: usize) -> u32 {
        self.levels.sizes[level].sparse.row_shift
    }

    /// Whether a sparse evaluation draws a level's row of pixels.
    pub fn draws_sparsely(&self, level: usize, row: u32) -> bool {
        self.levels.sizes[level].sparse.draws(row / TILE)
    }

    /// Reduces the camera's picture to all levels, for evaluations that the host asks for.
    pub fn reduce_picture(&mut self) -> Result<(), Error> {
        self.submit(Job::Pyramid)
    }

    /// Gives a level the frame to compare with: height × width × 3 floats in [0, 1].
    ///
    /// # Panics
    /// If the number of floats is not the level's.
    pub fn set_frame(&mut self, level: usize, rgb: &[f32]) {
        let Renderer { levels, .. } = self;
        let level = &levels.sizes[level];
        assert_eq!(rgb.len(), level.camera.pixels() * 3, "floats of the level");
        levels.frame.write_at(level.params.frame_offset as usize, rgb);
    }

    /// Makes the device search for the pose of the picture set, draw the prior at the pose as its
    /// packet holds it, and take the difference. Takes one submission, unless the search needs more
    /// evaluations, or the pictures more pairs, than there is room for.
    ///
    /// # Panics
    /// If the plan has no search.
    pub fn search(&mut self, program: &Program) -> Result<Searched<'_>, Error> {
        let scene = self.scene.clone();
        let submissions = match scene.window() {
            None => self.search_there(program)?,
            Some(window) => self.search_blocked(&scene, window, program)?,
        };
        let code = self.framed().coded_read.read::<Coded>(1)[0].code;
        let search = &self.framed().search_read.read::<Search>(1)[0];
        Ok(Searched { search, code, submissions, times: &self.times })
    }

    /// As [`search`](Self::search), on a blocked prior: brings the blocks that it may need. If an evaluation was
    /// further from its start than that, brings more and searches again. So the outcome is that of the whole prior,
    /// unless there is no room for all. The picture at the end is always whole.
    fn search_blocked(
        &mut self,
        scene: &Scene,
        window: &Window,
        program: &Program,
    ) -> Result<u32, Error> {
        let starts = &program.starts[..program.count as usize];
        let (mut reach, mut submissions, mut complete) = (window.searched(), 0, false);
        let (mut renders, levels) = ([0; LEVELS], self.renders.len());
        renders[..levels].copy_from_slice(&self.renders);
        for searches in 0..MOST_SEARCHES {
            if searches > 0 {
                window.note_repeated();
            }
            // Trackers have budgets of renders. They must decide as with the whole prior, so repetitions do not count.
            self.renders.copy_from_slice(&renders[..levels]);
            let seen = self.see_search(scene, window, starts, reach);
            let (seen, whole) = match seen {
                Err(Error::TooManySplats { .. }) => {
                    (self.see_search(scene, window, starts, Reach::NONE)?, false)
                }
                seen => (seen?, true),
            };
            submissions += self.search_there(program)?;
            drop(seen);
            let [moved, turned] = self.searched().strayed.map(f64::from);
            let strayed = Reach { moved, turned };
            complete = strayed.within(&reach) && whole;
            if complete || !whole {
                break;
            }
            reach = strayed.times(1.5).or(&reach);
        }
        if !complete {
            window.note_incomplete();
        }
        let code = self.framed().coded_read.read::<Coded>(1)[0].code;
        let pose = pose_of(scene, &self.placed(&code));
        let sight = self.sight(0, &pose, Reach::NONE);
        if !window.has(|block| sight.may_show(block)) {
            let renders = self.renders[0];
            self.draw_coded_as_planned(&code)?;
            self.renders[0] = renders;
        } else {
            self.read_ahead(&pose);
        }
        Ok(submissions)
    }

    /// Brings what a search may evaluate within a reach of its starts, at any level.
    fn see_search<'a>(
        &self,
        scene: &'a Scene,
        window: &'a Window,
        starts: &[Placement],
        reach: Reach,
    ) -> Result<MutexGuard<'a, Content>, Error> {
        let options = &scene.splats.options;
        let sights = |reach: Reach| -> [Option<Sight>; STARTS] {
            let cameras = || self.levels.sizes.iter().map(|level| level.camera);
            let sight = |start| Sight::new(cameras(), options, &pose_of(scene, start), reach);
            std::array::from_fn(|i| starts.get(i).map(sight))
        };
        let (needed, wanted) = (sights(reach), sights(window.wanted().or(&reach)));
        let any = |sights: &[Option<Sight>], block: &Block| {
            sights.iter().flatten().any(|sight| sight.may_show(block))
        };
        window.see(&scene.splats, |block| any(&needed, block), |block| any(&wanted, block))
    }

    /// Searches among the splats that are there. Returns how many submissions it took.
    fn search_there(&mut self, program: &Program) -> Result<u32, Error> {
        self.follow_scene();
        let mut submissions = 0;
        loop {
            let frame = self.frame.as_mut().expect("only planned searches are asked for");
            let begun = frame.ask(program);
            self.levels.ask_first(&begun, self.work.pair_capacity);
            let coded = Coded { anchor: anchor(&self.scene), code: PoseCode::zeroed() };
            self.bytes.coded_asked.write(&[coded]);
            self.times.clear();
            self.search_stages.clear();
            let mut job = Job::Search;
            let most = submissions + MOST_SUBMISSIONS;
            loop {
                self.submit(job)?;
                self.note_times(job)?;
                submissions += 1;
                job = Job::More;
                if self.searched().phase == crate::search::FOUND || submissions >= most {
                    break;
                }
            }
            let needed = self.searched().pairs_needed;
            if !self.grow(needed)? {
                let by_level = self.searched().by_level;
                for (renders, count) in self.renders.iter_mut().zip(by_level) {
                    *renders += count;
                }
                self.renders[0] += 1;
                return Ok(submissions);
            }
        }
    }

    /// The sums of the tiles at the last evaluation of a search. `sparse`: see [`Program::sparse`].
    pub(crate) fn tile_sums(&self, sparse: u32) -> TileSums<'_> {
        let level = &self.levels.sizes[0];
        let params = if sparse & 1 == 1 { &level.sparse } else { &level.params };
        let tiles = (params.tiles_x * params.tiles_y) as usize;
        let sums = self.framed().tile_sums_read.read::<f32>(tiles * SUMS as usize);
        TileSums { sums, params: *params }
    }

    fn searched(&self) -> Search {
        self.framed().search_read.read::<Search>(1)[0]
    }

    /// Adds the times of a submission's evaluations to those before.
    fn note_times(&mut self, job: Job) -> Result<(), Error> {
        let before = self.times.last().copied().unwrap_or(0.0);
        let commands = self.recorded.iter().find(|(recorded, _)| *recorded == job);
        let Some((_, commands)) = commands else { return Ok(()) };
        let room = self.times.capacity() - self.times.len();
        let evaluations = commands.marks("evaluation")?;
        self.times.extend(evaluations.take(room).map(|time| before + time));
        if self.plan.profiled {
            self.search_stages.extend(commands.stage_times()?);
        }
        Ok(())
    }

    /// The normal equations of a level against its frame.
    ///
    /// # Panics
    /// If the plan does not hold the Jacobian.
    pub fn normal_equations(
        &mut self,
        level: usize,
        jacobian: Jacobian,
        pose: &Pose,
    ) -> Result<NormalEquations, Error> {
        self.run(level, Job::Sums(jacobian), pose)?;
        Ok(self.levels.normal_equations(level))
    }

    /// Renders so far, by level. What was done again for lack of room counts once.
    pub fn renders(&self) -> &[u32] {
        &self.renders
    }

    /// Renders so far, of all levels.
    pub(crate) fn all_renders(&self) -> u64 {
        self.renders.iter().map(|count| u64::from(*count)).sum()
    }

    /// What is recorded for a search; `None` if the plan has none.
    pub fn search_commands(&self) -> Option<SearchCommands> {
        let (_, commands) = self.recorded.iter().find(|(job, _)| *job == Job::Search)?;
        let mut evaluations = commands.counts_at("evaluation");
        let (first, second) = (evaluations.next()?, evaluations.next()?);
        let slots = 2 + evaluations.count() as u32;
        Some(SearchCommands { all: commands.counts(), slot: second.since(first), slots })
    }

    /// Device times of the stages of a job's last run, of a search over all its submissions; empty if the plan is not
    /// profiled.
    pub fn stage_times(&self, job: Job) -> Result<Vec<StageTime>, Error> {
        if job == Job::Search {
            return Ok(self.search_stages.clone());
        }
        let commands = self.recorded.iter().find(|(recorded, _)| *recorded == job);
        commands.map_or(Ok(Vec::new()), |(_, commands)| commands.stage_times())
    }
}

#[cfg(test)]
mod tests {
    use super::room_for;

    #[test]
    fn room_to_spare_never_keeps_a_picture_out() {
        assert_eq!(room_for(1000, 1 << 27), 1250);
        // 30 million pairs fit into 128 MiB, with a quarter more they would not.
        assert_eq!(room_for(30_000_000, 1 << 27), 1 << 25);
        assert_eq!(room_for(40_000_000, 1 << 27), 40_000_000);
        assert_eq!(room_for(u32::MAX - 1, u64::MAX), u32::MAX);
    }
}
