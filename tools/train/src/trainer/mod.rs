//! Training splats on the device: the render's own stages, their gradients, and Adam's steps.
//!
//! What to train on, how fast, and when splats move elsewhere is the caller's: see `nvsprior map`. Sums run in a
//! fixed order, so the same input gives the same splats on one device, byte for byte.

mod memory;

use std::sync::Arc;

use glam::DVec3;

use nvsprior::parts::{
    Bytes, CameraPose, Channels, DrawnSplats, LevelBuffers, Pass, SplatBuffers, Stages,
    TrainingKernels, Workspace, posed, prototype,
};
use nvsprior::prior::RenderOptions;
use nvsprior::render::{Kernels, PipelineKey};
use nvsprior::vulkan::{Buffer, Commands, Device, Error, Memory, Recorder, StageTime, Timing};
use nvsprior::{Camera, Engine, Picture, Pose};
use nvsprior_kernels::shared::{
    Counters, GEOMETRY_PLANES, GROUP, Groups, Params, TILE, sh_coefficients, sh_planes,
};
use nvsprior_kernels::training::{
    FRAME_BITS, FRAME_COUNTS, FRAME_MASK, FRAME_ONE, GRADIENT_PIXEL, NO_PAIR, PAIR_FLOATS, RUN,
    RUNS, SSIM_MAPS, SlotCounters, planes,
};

pub use memory::{Fits, NoRoom, Shortage, TrainingMemory};
pub use nvsprior_kernels::training::{FADING, Training};

/// The first basis function of the spherical harmonics: a coefficient times it, plus ½, is a colour.
pub const SH_0: f32 = 0.282_094_8;
/// Logit of the opacity of splats that are not in use: they show nowhere.
pub const UNUSED: f32 = -20.0;

/// Tiles that a splat shows in, on average: there is room for so many from the start, if they are not very many. On the
/// reef it is one to three.
const PAIRS_PER_SPLAT: u32 = 5;

/// What is trained.
#[derive(Clone, Debug)]
pub struct TrainingPlan {
    /// Size of the largest pictures, pixels.
    pub size: [u32; 2],
    /// How the prior will be rendered.
    pub options: RenderOptions,
    /// Degree of the spherical harmonics.
    pub sh_degree: u32,
    /// Number of splats.
    pub splats: u32,
    /// What positions are relative to, so that f32 tells them apart.
    pub centre: DVec3,
    /// Whether SSIM has a share in the loss; else its stages are left out.
    pub ssim: bool,
    /// Have the device time each stage.
    pub profiled: bool,
}

impl TrainingPlan {
    /// Numbers of all splats: those of a set of planes.
    fn numbers(&self) -> usize {
        self.splats as usize * planes(self.sh_degree) as usize
    }
}

/// What a camera saw, as the loss reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingFrame {
    /// Pixels, row-major: see [`FRAME_BITS`].
    words: Vec<u32>,
}

impl TrainingFrame {
    /// All of a picture.
    pub fn new(picture: &Picture) -> TrainingFrame {
        let (pixels, _) = picture.data.as_chunks::<3>();
        let rgb = |pixel: usize| Some(pixels[pixel].map(|byte| f32::from(byte) / 255.0));
        TrainingFrame::from_fn(pixels.len(), rgb)
    }

    /// The colour of each pixel, row-major: RGB from 0 to 1, held to 1/1020; `None` if it does not count.
    pub fn from_fn(pixels: usize, rgb: impl Fn(usize) -> Option<[f32; 3]>) -> TrainingFrame {
        let bits = |value: f32| ((value * FRAME_ONE as f32).round() as u32).min(FRAME_MASK);
        let word = |pixel| match rgb(pixel).map(|rgb| rgb.map(bits)) {
            Some([r, g, b]) => r | g << FRAME_BITS | b << (2 * FRAME_BITS) | FRAME_COUNTS,
            None => 0,
        };
        TrainingFrame { words: (0..pixels).map(word).collect() }
    }

    /// The part of a frame `width` wide whose first pixel is `corner`, column and row.
    pub fn part(&self, width: usize, corner: [usize; 2], size: [usize; 2]) -> TrainingFrame {
        let rows = self.words.chunks(width).skip(corner[1]).take(size[1]);
        let words = rows.flat_map(|row| &row[corner[0]..corner[0] + size[0]]).copied().collect();
        TrainingFrame { words }
    }

    /// The frame whose pixels are means over `factor × factor` blocks of this one's, which is `width` wide: of those
    /// that count. See [`Camera::reduced`].
    pub fn reduced(&self, width: usize, factor: usize) -> TrainingFrame {
        let columns = width / factor;
        let rows = self.words.len() / width / factor;
        TrainingFrame::from_fn(columns * rows, |pixel| {
            let first = pixel / columns * factor * width + pixel % columns * factor;
            let block = (0..factor * factor).map(|k| first + k / factor * width + k % factor);
            let (mut sum, mut count) = ([0.0; 3], 0.0);
            for colour in block.filter_map(|at| self.colour(at)) {
                sum = [0, 1, 2].map(|c| sum[c] + colour[c]);
                count += 1.0;
            }
            (count > 0.0).then(|| sum.map(|channel| channel / count))
        })
    }

    /// A pixel's colour; `None` if it does not count.
    pub fn colour(&self, pixel: usize) -> Option<[f32; 3]> {
        let word = self.words[pixel];
        let channel = |c: u32| (word >> (FRAME_BITS * c) & FRAME_MASK) as f32 / FRAME_ONE as f32;
        (word & FRAME_COUNTS != 0).then(|| [0, 1, 2].map(channel))
    }
}

/// A camera's frame with its pose.
#[derive(Clone, Copy, Debug)]
pub struct TrainingView<'a> {
    /// The camera, of the plan's size or smaller.
    pub camera: &'a Camera,
    /// Its pose.
    pub pose: &'a Pose,
    /// What it saw.
    pub frame: &'a TrainingFrame,
    /// Side of the block of a picture's pixels that is one of this view's; 1 if it is not reduced.
    pub factor: u32,
}

/// The splats and what Adam knows of them: planes of one float per splat, in the order of `nvsprior_kernels::training`.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingState {
    /// The parameters. Positions are relative to the plan's centre.
    pub parameters: Vec<f32>,
    /// Running means of the gradients.
    pub first: Vec<f32>,
    /// Running means of their squares.
    pub second: Vec<f32>,
}

/// What the host can ask for.
#[derive(Clone, Copy)]
enum Job<'a> {
    /// The picture in 8 bits.
    Picture,
    /// The gradients alone, into a buffer.
    Gradients(&'a Buffer),
    /// A step.
    Step,
}

/// Buffers as large as the splats' number, or as the picture, asks.
struct Fixed {
    training: Buffer,
    frame: Buffer,
    parameters: Buffer,
    /// Means of the gradients and of their squares, in pairs.
    moments: Buffer,
    starts: Buffer,
    /// The splats that take a step.
    seen: Buffer,
    maps: Buffer,
    /// SSIM's derivatives by variance and covariance.
    partials: Buffer,
    /// Those by the mean: as they are, and blurred along rows.
    means: Buffer,
    gradient: Buffer,
    slot_counters: Buffer,
    slot_counters_read: Buffer,
}

/// Buffers as large as the pictures turn out to need.
struct Grown {
    work: Workspace,
    slots: Buffer,
    slot_capacity: u32,
    pairs: Buffer,
}

/// Trains splats.
pub struct Trainer {
    device: Device,
    kernels: Arc<Kernels>,
    own: TrainingKernels,
    plan: TrainingPlan,
    splats: Arc<SplatBuffers>,
    /// Splats in use, the first ones of those that are trained.
    in_use: u32,
    levels: LevelBuffers,
    bytes: Bytes,
    fixed: Fixed,
    grown: Grown,
    recorded: Recorded,
}

/// What is submitted again and again, once it is recorded.
#[derive(Default)]
struct Recorded {
    picture: Option<Commands>,
    step: Option<Commands>,
    /// The pictures' size that the step was recorded for.
    size: [u32; 2],
}

impl Recorded {
    /// Where a job's commands are kept. Gradients are asked for now and then, for checks.
    fn of(&mut self, job: Job) -> Option<&mut Option<Commands>> {
        match job {
            Job::Picture => Some(&mut self.picture),
            Job::Step => Some(&mut self.step),
            Job::Gradients(_) => None,
        }
    }
}

impl Fixed {
    /// `room`: splats of the planes that are drawn, those that are not trained too.
    fn new(device: &Device, plan: &TrainingPlan, room: u32) -> Result<Fixed, Error> {
        let splats = room as usize;
        let pixels = plan.size[0] as usize * plan.size[1] as usize;
        let numbers = plan.numbers();
        let own = |name, count| Buffer::new::<f32>(device, name, count, Memory::Device);
        let counters = |memory| Buffer::new::<SlotCounters>(device, "slot counters", 1, memory);
        Ok(Fixed {
            training: Buffer::new::<Training>(device, "training", 1, Memory::Upload)?,
            frame: Buffer::new::<u32>(device, "frame", pixels, Memory::Upload)?,
            parameters: own("parameters", numbers)?,
            moments: own("means of gradients", 2 * numbers)?,
            // Lists of tiles may hold the splat after the last, which shows nothing.
            starts: own("first slots", splats + 1)?,
            seen: own("splats in view", plan.splats as usize)?,
            maps: own("blurred maps", 3 * 2 * SSIM_MAPS as usize * pixels)?,
            partials: own("derivatives of SSIM", 3 * 2 * pixels)?,
            means: own("derivatives by means", 3 * 2 * pixels)?,
            gradient: own("gradient of the loss", GRADIENT_PIXEL as usize * pixels)?,
            slot_counters: counters(Memory::Device)?,
            slot_counters_read: counters(Memory::Readback)?,
        })
    }
}

impl Grown {
    fn new(
        device: &Device,
        splats: &SplatBuffers,
        pair_capacity: u32,
        slot_capacity: u32,
    ) -> Result<Grown, Error> {
        let own = |name, count| Buffer::new::<u32>(device, name, count, Memory::Device);
        let sums = pair_capacity as usize * 2 * PAIR_FLOATS as usize;
        Ok(Grown {
            work: Workspace::new(device, splats, pair_capacity, false)?,
            slots: own("slots", slot_capacity as usize)?,
            slot_capacity,
            pairs: own("sums of pairs", sums)?,
        })
    }
}

/// Pairs that there is room for from the start.
fn first_pairs(splats: u32) -> u32 {
    splats.saturating_mul(PAIRS_PER_SPLAT).clamp(1 << 14, 1 << 21)
}

/// A little to spare.
fn with_room(count: u32) -> u32 {
    count.saturating_add(count / 4)
}

impl Trainer {
    /// Makes a trainer of splats.
    pub fn new(engine: &Engine, plan: &TrainingPlan) -> Result<Trainer, Error> {
        let key = PipelineKey { sh_degree: plan.sh_degree, clamped: true };
        let (device, scene_kernels) = (engine.vulkan(), engine.scene_kernels(&key)?);
        let count = plan.splats as usize;
        let own = |name, planes: u32| {
            Buffer::new::<f32>(device, name, count * 2 * planes as usize, Memory::Device)
        };
        let buffers = [
            own("geometry", GEOMETRY_PLANES)?,
            own("spherical harmonics", sh_planes(plan.sh_degree))?,
        ];
        let held = DrawnSplats::all(plan.splats, f32::INFINITY);
        let splats = SplatBuffers::new(scene_kernels, buffers, &held, plan.options);
        let [width, height] = plan.size;
        let camera = Camera { width, height, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let levels = LevelBuffers::new(device, &splats, &camera, &[1])?;
        let (pairs, slots) = (first_pairs(splats.room), first_pairs(plan.splats));
        Ok(Trainer {
            device: device.clone(),
            kernels: engine.kernels().clone(),
            own: TrainingKernels::new(device, plan.sh_degree)?,
            bytes: Bytes::new(device, &levels)?,
            fixed: Fixed::new(device, plan, splats.room)?,
            grown: Grown::new(device, &splats, pairs, slots)?,
            plan: plan.clone(),
            in_use: plan.splats,
            splats: Arc::new(splats),
            levels,
            recorded: Recorded::default(),
        })
    }

    /// Says that only the first so many splats are in use, at least one: the others are not looked at. At first all
    /// are.
    pub fn set_in_use(&mut self, splats: u32) {
        self.in_use = splats.clamp(1, self.plan.splats);
    }

    /// Sets splats and what is known of their gradients.
    ///
    /// # Panics
    /// If the planes are not those of the plan.
    pub fn set(&mut self, state: &TrainingState) -> Result<(), Error> {
        let numbers = self.plan.numbers();
        let TrainingState { parameters, first, second } = state;
        for planes in [parameters, first, second] {
            assert_eq!(planes.len(), numbers, "planes of the plan");
        }
        let moments: Vec<[f32; 2]> = first.iter().zip(second).map(|(a, b)| [*a, *b]).collect();
        let Fixed { parameters: to, moments: to_moments, .. } = &self.fixed;
        for (from, to) in [(parameters.as_slice(), to), (moments.as_flattened(), to_moments)] {
            let upload = Buffer::from_slice(&self.device, "state", from)?;
            let mut recorder = Recorder::new(&self.device, Timing::None)?;
            recorder.copy(&upload, to);
            recorder.finish()?.run()?;
        }
        Ok(())
    }

    /// The splats, and what is known of their gradients.
    pub fn state(&self) -> Result<TrainingState, Error> {
        let (device, numbers) = (&self.device, self.plan.numbers());
        let moments: Vec<[f32; 2]> = self.fixed.moments.fetch(device, numbers)?;
        Ok(TrainingState {
            parameters: self.read(&self.fixed.parameters)?,
            first: moments.iter().map(|pair| pair[0]).collect(),
            second: moments.iter().map(|pair| pair[1]).collect(),
        })
    }

    fn read(&self, from: &Buffer) -> Result<Vec<f32>, Error> {
        from.fetch(&self.device, self.plan.numbers())
    }

    /// One step towards a picture. `training`: rates and shares; the room for slots is filled in.
    ///
    /// # Panics
    /// If the camera is larger than the plan's size, or the frame not of the camera's.
    pub fn step(&mut self, view: &TrainingView, training: &Training) -> Result<(), Error> {
        self.run(Job::Step, view, training)
    }

    /// The loss's gradient by all parameters: planes as those of the parameters.
    ///
    /// # Panics
    /// As [`step`](Self::step).
    pub fn gradients(
        &mut self,
        view: &TrainingView,
        training: &Training,
    ) -> Result<Vec<f32>, Error> {
        let device = &self.device;
        let into = Buffer::new::<f32>(device, "gradients", self.plan.numbers(), Memory::Device)?;
        self.run(Job::Gradients(&into), view, training)?;
        self.read(&into)
    }

    /// Draws the splats as they are.
    ///
    /// # Panics
    /// If the camera or the picture is not of the plan's size.
    pub fn picture(
        &mut self,
        camera: &Camera,
        pose: &Pose,
        into: &mut Picture,
    ) -> Result<(), Error> {
        let training = Training {
            sh_coefficients: sh_coefficients(self.plan.sh_degree),
            ..Training::default()
        };
        let frame = &TrainingFrame { words: Vec::new() };
        self.run(Job::Picture, &TrainingView { camera, pose, frame, factor: 1 }, &training)?;
        let pixels = camera.pixels();
        into.data.copy_from_slice(&self.bytes.render.read::<u8>(pixels * 3)[..pixels * 3]);
        Ok(())
    }

    /// Device times of the last step's stages; empty unless the plan asked for them.
    pub fn stage_times(&self) -> Result<Vec<StageTime>, Error> {
        self.recorded.step.as_ref().map_or(Ok(Vec::new()), Commands::stage_times)
    }

    /// Runs a job. If there was not room for all, makes room and runs it again: no step was taken.
    fn run(&mut self, job: Job, view: &TrainingView, training: &Training) -> Result<(), Error> {
        let TrainingView { camera, frame, .. } = *view;
        let (size, [width, height]) = ([camera.width, camera.height], self.plan.size);
        assert!(size[0] <= width && size[1] <= height, "pictures of the plan's size");
        if !matches!(job, Job::Picture) {
            assert_eq!(frame.words.len(), camera.pixels(), "a frame of the camera's size");
            self.fixed.frame.write(&frame.words);
            if self.recorded.size != size {
                self.recorded.step = None;
                self.recorded.size = size;
            }
        }
        loop {
            let slot_capacity = self.grown.slot_capacity;
            let own = Training {
                slot_capacity,
                first_trained: 0,
                trained: self.plan.splats,
                in_use: self.in_use,
                ..*training
            };
            self.fixed.training.write(&[own]);
            self.ask(view);
            self.submit(job)?;
            if !self.grow()? {
                return Ok(());
            }
        }
    }

    fn submit(&mut self, job: Job) -> Result<(), Error> {
        let kept = self.recorded.of(job).and_then(Option::take);
        let mut commands = kept.map_or_else(|| self.record(job), Ok)?;
        commands.run()?;
        if let Some(place) = self.recorded.of(job) {
            *place = Some(commands);
        }
        Ok(())
    }

    fn ask(&mut self, view: &TrainingView) {
        let TrainingView { camera, pose, factor, .. } = *view;
        // Training moves the splats.
        let (splats, stride) = (self.in_use, self.splats.room);
        let held = DrawnSplats { splats, stride, radius: f32::INFINITY };
        let own = prototype(&self.plan.options, &held, camera, factor, 0);
        let Params { sort_blocks, tiles_per_group, .. } = self.levels.sizes[0].params;
        let pair_capacity = self.grown.work.pair_capacity;
        let mut own = Params { sort_blocks, tiles_per_group, pair_capacity, ..own };
        self.levels.binning.share(&mut own);
        let params = posed(&own, self.plan.centre, pose);
        self.levels.params_asked.write(&[params]);
        self.levels.groups_asked.write(&[[Groups::of(&params); 2]]);
    }

    /// Makes room for what the last run needed; whether it did. If it fails, everything is as before.
    fn grow(&mut self) -> Result<bool, Error> {
        let pairs = self.grown.work.counters_read.read::<Counters>(1)[0].pairs_needed;
        let slots = self.fixed.slot_counters_read.read::<SlotCounters>(1)[0];
        let (pair_capacity, slot_capacity) =
            (self.grown.work.pair_capacity, self.grown.slot_capacity);
        if pairs == u32::MAX {
            return Err(Error::TooManyPairs);
        }
        let blocks = slots.blocks.saturating_add(self.plan.splats / 256).saturating_mul(256);
        let wrapped = slots.blocks > slot_capacity / 256;
        let needed = if wrapped { slots.slots.max(blocks) } else { slots.slots };
        if pairs <= pair_capacity && needed <= slot_capacity {
            return Ok(false);
        }
        let more = |needed: u32, capacity: u32| {
            if needed > capacity { with_room(needed) } else { capacity }
        };
        let (pairs, slots) = (more(pairs, pair_capacity), more(needed, slot_capacity));
        self.grown = Grown::new(&self.device, &self.splats, pairs, slots)?;
        self.recorded = Recorded { size: self.recorded.size, ..Recorded::default() };
        Ok(true)
    }

    fn record(&self, job: Job) -> Result<Commands, Error> {
        let timing = if self.plan.profiled { Timing::Stages } else { Timing::None };
        let mut recorder = Recorder::new(&self.device, timing)?;
        let r = &mut recorder;
        let Trainer { kernels, splats, levels, bytes, fixed, grown, .. } = self;
        let stages = Stages { kernels, splats, levels, work: &grown.work, bytes };
        stages.clear_sums(r);
        r.copy_beside(&levels.params_asked, &levels.params);
        r.copy_beside(&levels.groups_asked, &levels.groups);
        r.fill(&fixed.slot_counters, 0);
        r.fill(&fixed.starts, NO_PAIR);
        self.activate(r)?;
        stages.picture(r, Channels::Colour, CameraPose::Asked, Pass::Evaluation)?;
        if let Job::Picture = job {
            stages.quantize_rgb8(r, None, Pass::Evaluation)?;
        } else {
            self.slots(r)?;
            self.loss(r)?;
            self.backward(r)?;
        }
        match job {
            Job::Picture => {}
            Job::Gradients(into) => self.gradient(r, into)?,
            Job::Step => self.take_step(r)?,
        }
        r.copy_beside(&fixed.slot_counters, &fixed.slot_counters_read);
        r.copy(&grown.work.counters, &grown.work.counters_read);
        recorder.finish()
    }

    /// Workgroups of one invocation per splat.
    fn per_splat(&self) -> [u32; 3] {
        [self.plan.splats.div_ceil(GROUP), 1, 1]
    }

    /// Parameters as the render reads splats.
    fn activate(&self, r: &mut Recorder) -> Result<(), Error> {
        let Trainer { splats, levels, fixed, .. } = self;
        let (geometry, sh) = (&splats.geometry, &splats.sh);
        let buffers = [&levels.params, &fixed.training, &fixed.parameters, geometry, sh];
        r.dispatch(&self.own.train_activate, &buffers, &[], self.per_splat())
    }

    /// A slot per splat and tile.
    fn slots(&self, r: &mut Recorder) -> Result<(), Error> {
        let Trainer { levels, fixed, grown, .. } = self;
        let Workspace { records, keys, .. } = &grown.work;
        r.fill(&grown.slots, NO_PAIR);
        let (params, starts) = (&levels.params, &fixed.starts);
        let Fixed { training, seen, slot_counters, .. } = fixed;
        let buffers = [params, training, records, keys, starts, seen, slot_counters];
        r.dispatch(&self.own.train_slots, &buffers, &[], self.per_splat())
    }

    /// The loss's gradient by each pixel.
    fn loss(&self, r: &mut Recorder) -> Result<(), Error> {
        let Trainer { levels, fixed, own, .. } = self;
        let [width, height] = self.recorded.size;
        let (params, image, frame) = (&levels.params, &levels.image, &fixed.frame);
        let Fixed { training, maps, partials, means, gradient, .. } = fixed;
        if self.plan.ssim {
            let rows = [height.div_ceil(RUNS), width.div_ceil(RUN), 3];
            let columns = [width.div_ceil(RUNS), height.div_ceil(RUN), 3];
            r.dispatch(&own.ssim_rows, &[params, image, frame, maps], &[], rows)?;
            r.dispatch(&own.ssim_columns, &[params, maps, partials, means], &[], columns)?;
            // The maps are not needed any more: their room takes the blurred derivatives.
            r.dispatch(&own.ssim_back, &[params, partials, maps, means], &[], rows)?;
            let buffers = [params, training, image, frame, maps, means, gradient];
            r.dispatch(&own.ssim_gradient, &buffers, &[], columns)?;
        }
        let buffers = [params, training, image, frame, gradient];
        r.dispatch(&own.loss_gradient, &buffers, &[], [(width * height).div_ceil(GROUP), 1, 1])
    }

    /// What each splat does to the loss in each tile.
    fn backward(&self, r: &mut Recorder) -> Result<(), Error> {
        let Trainer { levels, fixed, grown, own, .. } = self;
        let Workspace { records, pair_splats, .. } = &grown.work;
        let [tiles_x, tiles_y] = self.recorded.size.map(|side| side.div_ceil(TILE));
        let (gradient, starts) = (&fixed.gradient, &fixed.starts);
        let (params, ranges) = (&levels.params, &levels.ranges);
        let (slots, pairs) = (&grown.slots, &grown.pairs);
        let buffers = [params, ranges, pair_splats, records, gradient, starts, slots, pairs];
        r.dispatch(&own.splat_backward, &buffers, &[], [tiles_x, tiles_y, 1])
    }

    /// The loss's gradient by each parameter.
    fn gradient(&self, r: &mut Recorder, into: &Buffer) -> Result<(), Error> {
        let Trainer { levels, fixed, grown, own, .. } = self;
        let Fixed { training, parameters, starts, .. } = fixed;
        let (params, records) = (&levels.params, &grown.work.records);
        let (slots, pairs) = (&grown.slots, &grown.pairs);
        let buffers = [params, training, parameters, records, starts, slots, pairs, into];
        r.dispatch(&own.train_gradient, &buffers, &[], self.per_splat())
    }

    /// Adam's step along that gradient.
    fn take_step(&self, r: &mut Recorder) -> Result<(), Error> {
        let Trainer { levels, fixed, grown, own, .. } = self;
        let Fixed { training, slot_counters, starts, seen, parameters, moments, .. } = fixed;
        let Workspace { records, counters, .. } = &grown.work;
        let (params, slots, pairs) = (&levels.params, &grown.slots, &grown.pairs);
        let buffers = [
            params,
            training,
            counters,
            slot_counters,
            seen,
            records,
            starts,
            slots,
            pairs,
            parameters,
            moments,
        ];
        let groups = std::mem::offset_of!(SlotCounters, groups) as u64;
        r.dispatch_indirect(&own.train_step, &buffers, &[], slot_counters, groups)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_frame_has_the_means_of_what_counts() {
        let picture = Picture { width: 5, height: 3, data: (0..45).map(|k| 4 * k).collect() };
        let frame = TrainingFrame::new(&picture).reduced(5, 2);
        assert_eq!(frame.words.len(), 2);
        // Rows 0 and 1, columns 2 and 3.
        let mean = [0, 1, 2].map(|c| (6 + 9 + 21 + 24 + 4 * c) as f32 / 255.0);
        let own = frame.colour(1).unwrap();
        assert!(own.iter().zip(mean).all(|(a, b)| (a - b).abs() < 1e-6), "{own:?} for {mean:?}");

        let counts = |pixel| pixel == 1 || pixel == 4;
        let some = TrainingFrame::from_fn(15, |pixel| counts(pixel).then_some([0.2, 0.4, 0.6]));
        let some = some.reduced(5, 2);
        assert_eq!(some.colour(0), Some([0.2, 0.4, 0.6]));
        assert_eq!(some.colour(1), None);
    }
}
