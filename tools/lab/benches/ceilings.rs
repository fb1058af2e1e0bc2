//! Measures how near the stages come to what the device can do, and to the same stages written by
//! hand in GLSL (`glsl/`): `cargo bench -p nvsprior-lab`. Uses the reef if its data lies beside the
//! project, else the tests' wall.

#[path = "../../../tests/common/mod.rs"]
mod common;
#[path = "../../../tests/scene/mod.rs"]
mod scene;

use std::sync::Arc;

use nvsprior::render::{Jacobian, Job, Plan, Renderer, Scene};
use nvsprior::vulkan::{
    Buffer, Code, Commands, Device, DeviceOptions, Error, Kernel, Memory, Recorder, StageTime,
    Timing,
};
use nvsprior::{Camera, Engine, Pose, Prior};
use nvsprior_kernels::block_table::BlockTable;
use nvsprior_kernels::modules::{self, Module};
use nvsprior_kernels::shared::{
    CULLED, Counters, DIGITS, PIXEL, Params, SUMS, TABLE, TILE, digit_bits,
};
use nvsprior_lab::ceilings::{self, Ceilings, Clock};
use nvsprior_reference::probe::{Probe, SortPrecision, Stages};

use nvsprior_lab::cost::{
    Cost, Counts, FLOW_FLOPS, Machine, PICTURE_FLOPS, PICTURE_PASSES, Sharing, Work,
};

/// Runs of each kernel, in turn with those that it is compared with. The fastest counts.
const RUNS: usize = 60;

/// A stage written by hand in GLSL, built by `glsl/build.sh`.
macro_rules! glsl {
    ($name:literal) => {
        Source {
            name: concat!($name, " in GLSL"),
            module: Module {
                entry: "main",
                spirv: include_bytes!(concat!("glsl/", $name, ".spv")),
            },
        }
    };
}

struct Source {
    name: &'static str,
    module: Module,
}

impl Source {
    /// A stage of the library.
    fn ours(module: Module) -> Source {
        Source { name: module.entry, module }
    }

    fn kernel(&self, device: &Device, bindings: u32, push: u32) -> Result<Kernel, Error> {
        let Module { entry, spirv } = self.module;
        let code =
            Code { entry, spirv, bindings, push_words: push, constants: &[], subgroup: None };
        Kernel::new(device, self.name, &code)
    }
}

/// A prior, and the camera and pose that it is seen from.
struct PriorView {
    prior: Prior,
    scene: Arc<Scene>,
    camera: Camera,
    pose: Pose,
}

impl PriorView {
    fn new(engine: &Engine) -> Result<PriorView, Error> {
        let (prior, camera, pose) = match common::reef_prior() {
            Some(prior) => (prior, common::REEF_CAMERA, common::reef_pose()),
            None => (scene::wall(1), scene::CAMERA, scene::pose(0.0)),
        };
        let scene = engine.upload(&prior)?;
        Ok(PriorView { prior, scene, camera, pose })
    }
}

/// A prior seen from a pose, with all that comes before the blending.
struct LevelView {
    camera: Camera,
    params: Params,
    stages: Stages,
}

impl LevelView {
    /// A level of the pyramid.
    fn new(engine: &Engine, seen: &PriorView, factor: u32) -> Result<LevelView, Error> {
        let PriorView { prior, scene, pose, .. } = seen;
        let camera = seen.camera.reduced(factor);
        let tiles = [camera.width.div_ceil(TILE), camera.height.div_ceil(TILE)];
        let options = prior.options();
        let params = Params {
            focal: [camera.fx, camera.fy],
            principal: [camera.cx, camera.cy],
            background: options.background,
            alpha_max: options.alpha_max,
            width: camera.width,
            height: camera.height,
            tiles_x: tiles[0],
            tiles_y: tiles[1],
            ..Params::default()
        };
        let (room, exact) = (1 << 20, SortPrecision::Exact);
        let stages = Probe::of(engine).stages_at(scene, &seen.camera, factor, pose, room, exact)?;
        Ok(LevelView { camera, params, stages })
    }

    /// What the model counts if one of 2^`row_shift` rows of tiles is drawn.
    fn counts(&self, seen: &PriorView, row_shift: u32) -> Counts {
        Counts::of(&seen.prior, &self.camera, &seen.camera, &self.stages, row_shift)
    }
}

/// The best ceilings so far.
struct Best<'a> {
    engine: &'a Engine,
    ceilings: Ceilings,
}

impl Best<'_> {
    fn measure(&mut self) -> Result<(), Error> {
        let Ceilings { flops, bytes } = ceilings::measure(self.engine.vulkan())?;
        let best = &mut self.ceilings;
        *best = Ceilings { flops: best.flops.max(flops), bytes: best.bytes.max(bytes) };
        Ok(())
    }
}

/// Fastest device times of each stage, milliseconds, of recordings of the same work that run in turn. The ceilings are
/// measured now and then in between, under the same load.
fn times(best: &mut Best, commands: &mut [Commands]) -> Result<Vec<Vec<f64>>, Error> {
    let ceilings = best;
    let mut best = vec![Vec::new(); commands.len()];
    for run in 0..RUNS {
        if run % 10 == 0 {
            ceilings.measure()?;
        }
        for (commands, best) in commands.iter_mut().zip(&mut best) {
            commands.run()?;
            let stages = commands.stage_times()?;
            best.resize(stages.len(), f64::INFINITY);
            for (best, stage) in best.iter_mut().zip(stages) {
                *best = best.min(stage.milliseconds);
            }
        }
    }
    Ok(best)
}

/// The blending stages against the ceiling of arithmetic, and against GLSL if that fits the device.
fn blending(seen: &PriorView, view: &LevelView, best: &mut Best) -> Result<(), Error> {
    let device = best.engine.vulkan();
    let (stages, params) = (&view.stages, &view.params);
    let groups = [params.tiles_x, params.tiles_y, 1];
    let params = Buffer::from_slice(device, "parameters", &[*params])?;
    let ranges = Buffer::from_slice(device, "ranges", &stages.ranges)?;
    let pairs = Buffer::from_slice(device, "pairs", &stages.pair_splats)?;
    let records = Buffer::from_slice(device, "records", &stages.records)?;
    let frame = Buffer::from_slice(device, "frame", &common::random_frame(1, &view.camera))?;
    let out = PIXEL as usize * view.camera.pixels();
    let picture = || Buffer::new::<f32>(device, "picture", out, Memory::Readback);
    let (image, image_in_glsl) = (picture()?, picture()?);
    let rows = SUMS as usize * (groups[0] * groups[1]) as usize;
    let partials = Buffer::new::<f32>(device, "sums by tile", rows, Memory::Device)?;
    let record = |source: &Source, buffers: &[&Buffer]| {
        let kernel = source.kernel(device, buffers.len() as u32, 0)?;
        let mut recorder = Recorder::new(device, Timing::Stages)?;
        recorder.dispatch(&kernel, buffers, &[], groups)?;
        recorder.finish()
    };
    let (splat, flow) = match device.info().in_lockstep() {
        true => (Source::ours(modules::splat_lockstep), Source::ours(modules::splat_flow_lockstep)),
        false => (Source::ours(modules::splat), Source::ours(modules::splat_flow)),
    };
    let sums = [&params, &ranges, &pairs, &records, &frame, &partials];
    let drawn = [&params, &ranges, &pairs, &records, &image];
    let mut commands = vec![record(&splat, &drawn)?, record(&flow, &sums)?];
    if device.info().in_lockstep() {
        let drawn = [&params, &ranges, &pairs, &records, &image_in_glsl];
        commands.push(record(&glsl!("splat"), &drawn)?);
    }
    let times: Vec<f64> =
        times(best, &mut commands)?.iter().map(|stages| stages.iter().sum()).collect();
    let blended = view.counts(seen, 0).blended;
    let all = [("splat", times[0], PICTURE_FLOPS), ("flow", times[1], FLOW_FLOPS)];
    for ((name, ms, flops), evaluations) in all.into_iter().zip(blended) {
        let rate = evaluations * flops / (ms * 1e-3);
        println!("{name}: {ms:.2} ms, {:.2} M splats times pixels", evaluations * 1e-6);
        println!("  {flops} operations each, {:.1} GFLOP/s", rate * 1e-9);
        println!("  {:.0} % of the arithmetic's ceiling", 100.0 * rate / best.ceilings.flops);
    }
    if let Some(glsl) = times.get(2) {
        let pixels = std::iter::zip(image.read::<f32>(out), image_in_glsl.read::<f32>(out));
        let apart = pixels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("splat in GLSL: {glsl:.2} ms; ours takes {:.2} of it", times[0] / glsl);
        println!("  pictures differ by {apart:.1e} at most");
    }
    Ok(())
}

/// The sort of the depth keys, pass by pass, against the copy's ceiling and against GLSL.
struct Sort<'a> {
    device: &'a Device,
    count: u32,
    log_blocks: u32,
    counters: Buffer,
    keys: Buffer,
    histogram: Buffer,
    between: [[Buffer; 2]; 2],
}

impl Sort<'_> {
    fn new<'a>(device: &'a Device, keys: &[u32], log_blocks: u32) -> Result<Sort<'a>, Error> {
        let own = |name| Buffer::new::<u32>(device, name, keys.len(), Memory::Device);
        let largest = keys.iter().copied().filter(|key| *key != CULLED).max().unwrap_or(0);
        let counters = Counters { digit_bits: digit_bits(largest), ..Counters::default() };
        let words = BlockTable::new(TABLE, log_blocks, 0, DIGITS).words() as usize;
        Ok(Sort {
            device,
            count: keys.len() as u32,
            log_blocks,
            counters: Buffer::from_slice(device, "counters", &[counters])?,
            keys: Buffer::from_slice(device, "keys", keys)?,
            histogram: Buffer::new::<u32>(device, "digit histogram", words, Memory::Device)?,
            between: [[own("keys")?, own("values")?], [own("keys")?, own("values")?]],
        })
    }

    /// Records all passes by these stages, as `src/render/radix.rs` does for keys whose first digit is not counted yet.
    fn record(&self, [count, scatter]: [Source; 2], order: &Buffer) -> Result<Commands, Error> {
        let Sort { device, counters, histogram, .. } = self;
        let (count, scatter) = (count.kernel(device, 3, 4)?, scatter.kernel(device, 6, 4)?);
        let blocks = [1 << self.log_blocks, 1, 1];
        let mut r = Recorder::new(device, Timing::Stages)?;
        r.fill(histogram, 0);
        let (mut keys, mut values) = (&self.keys, &self.between[1][1]);
        for digit in 0..DIGITS {
            let [keys_out, values_out] = &self.between[digit as usize % 2];
            let values_out = if digit + 1 < DIGITS { values_out } else { order };
            let push = [digit, (digit == 0).into(), self.log_blocks, self.count];
            r.dispatch(&count, &[counters, keys, histogram], &push, blocks)?;
            let buffers = [counters, histogram, keys, values, keys_out, values_out];
            r.dispatch(&scatter, &buffers, &push, blocks)?;
            (keys, values) = (keys_out, values_out);
        }
        r.finish()
    }
}

/// Bytes of keys and values that a pass reads and writes. The first pass reads each key twice,
/// makes the values itself, and writes only visible splats. The last pass writes no keys.
fn pass_bytes(digit: u32, keys: usize, visible: usize) -> f64 {
    let words = match digit {
        0 => 2 * keys + 2 * visible,
        _ if digit + 1 < DIGITS => 5 * visible,
        _ => 4 * visible,
    };
    4.0 * words as f64
}

fn sorting(device: &Device, keys: &[u32], best: &mut Best) -> Result<(), Error> {
    let sort = Sort::new(device, keys, Probe::of(best.engine).log_sort_blocks(keys.len() as u32))?;
    let order = || Buffer::new::<u32>(device, "order", keys.len(), Memory::Readback);
    let orders = [order()?, order()?];
    let stages = match device.info().in_lockstep() {
        true => [
            Source::ours(modules::radix_count_lockstep),
            Source::ours(modules::radix_scatter_lockstep),
        ],
        false => [Source::ours(modules::radix_count), Source::ours(modules::radix_scatter)],
    };
    let mut commands = vec![sort.record(stages, &orders[0])?];
    if device.info().in_lockstep() {
        let stages = [glsl!("radix_count"), glsl!("radix_scatter")];
        commands.push(sort.record(stages, &orders[1])?);
    }
    let times = times(best, &mut commands)?;
    let place = |place: &u32| keys[*place as usize];
    let mut right: Vec<u32> = (0..sort.count).filter(|at| place(at) != CULLED).collect();
    right.sort_by_key(place);
    let visible = right.len();
    for order in &orders[..commands.len()] {
        assert_eq!(order.read::<u32>(visible), right, "a wrong order");
    }
    println!("sort of {} keys, {visible} of them visible", sort.count);
    for (digit, ms) in (0..).zip(times[0][1..].chunks(2)) {
        let rate =
            pass_bytes(digit, sort.count as usize, visible) / (ms.iter().sum::<f64>() * 1e-3);
        println!("  pass {digit}: count {:.2}, scatter {:.2} ms", ms[0], ms[1]);
        let share = 100.0 * rate / best.ceilings.bytes;
        println!("    {:.2} GB/s, {share:.0} % of the copy's ceiling", rate * 1e-9);
    }
    // After the fill.
    let all: Vec<f64> = times.iter().map(|stages| stages[1..].iter().sum()).collect();
    println!("  all passes: {:.2} ms", all[0]);
    if let Some(glsl) = all.get(1) {
        println!("sort in GLSL: {glsl:.2} ms; ours takes {:.2} of it", all[0] / glsl);
    }
    Ok(())
}

/// Fastest times of the stages of a job at a level, in milliseconds.
fn measured(renderer: &mut Renderer, level: usize, job: Job, pose: &Pose) -> Times {
    let mut best: Vec<StageTime> = Vec::new();
    for _ in 0..RUNS / 2 {
        match job {
            Job::Draw => drop(renderer.draw_level(level, pose)?.first()),
            _ => drop(renderer.normal_equations(level, Jacobian::Flow, pose)?),
        }
        let times = renderer.stage_times(job)?;
        best.resize(times.len(), StageTime { name: "", milliseconds: f64::INFINITY });
        for (best, time) in best.iter_mut().zip(times) {
            let milliseconds = best.milliseconds.min(time.milliseconds);
            *best = StageTime { milliseconds, ..time };
        }
    }
    Ok(best)
}

type Times = Result<Vec<StageTime>, Error>;

/// What is compared: a stage, or what the names of several begin with.
const PICTURE: [&str; 4] = ["project", "radix", "bin", "splat"];
/// The same of an evaluation.
const EVALUATION: [&str; 5] = ["project", "radix", "bin", "splat_flow", "reduce"];
/// All stages of either.
const STAGES: [&str; 9] = [
    "project",
    "radix_count",
    "radix_scatter",
    "bin_count",
    "bin_scan",
    "bin_emit",
    "splat",
    "splat_flow",
    "reduce",
];

/// Whether a stage belongs to a part of the comparison.
fn belongs(stage: &str, part: &str) -> bool {
    stage == part || ["radix", "bin"].contains(&part) && stage.starts_with(part)
}

/// Work of a part of a picture or an evaluation.
fn work(part: &str, cost: &Cost) -> Work {
    let mut sum = Work::default();
    for stage in STAGES.iter().filter(|stage| belongs(stage, part)) {
        sum += cost.of(stage);
    }
    sum
}

/// Prints a picture's stages, or an evaluation's: as the model predicts them here, and as measured.
fn compare(cost: &Cost, here: &Machine, evaluation: bool, measured: &[StageTime]) {
    println!("  {}", if evaluation { "evaluation" } else { "picture" });
    let parts = if evaluation { EVALUATION.as_slice() } else { &PICTURE };
    let mut total = [0.0; 2];
    for part in parts {
        let work = work(part, cost);
        let times = measured.iter().filter(|stage| belongs(stage.name, part));
        let took: f64 = times.map(|stage| stage.milliseconds).sum();
        let model = here.seconds(&work) * 1e3;
        let (bytes, operations) = (work.bytes * 1e-6, work.flops * 1e-6);
        print!("    {part:10} {bytes:6.2} MB, {operations:7.1} MFLOP: model {model:6.2} ms, ");
        println!("measured {took:6.2}, {:4.1} times", took / model);
        total = [total[0] + model, total[1] + took];
    }
    let [model, took] = total;
    println!("    all: model {model:.2} ms, measured {took:.2}");
}

/// The stages of each level.
fn predicting(
    engine: &Engine,
    device: &Device,
    seen: &PriorView,
    best: &Best,
) -> Result<(), Error> {
    let here = Machine {
        flops: best.ceilings.flops,
        bytes: best.ceilings.bytes,
        dispatch: ceilings::dispatch_seconds(device, Clock::Device)?,
    };
    let sharing = Sharing::of(engine, &seen.prior);
    println!("{:.0} us per dispatch", here.dispatch * 1e6);
    let factors = vec![1, 2, 4];
    let jacobians = vec![Jacobian::Flow];
    let plan = Plan { factors: factors.clone(), jacobians, profiled: true, ..Plan::picture() };
    let mut renderer = engine.renderer(&seen.scene, &seen.camera, plan)?;
    for (level, factor) in factors.into_iter().enumerate() {
        let view = LevelView::new(engine, seen, factor)?;
        let c = view.counts(seen, 0);
        println!("level {level}: {} splats, {} visible, {} pairs", c.splats, c.visible, c.pairs);
        println!("  {} rows, {} tiles, {} digits", c.rows, c.tiles, c.digits);
        renderer.set_frame(level, &common::random_frame(1, &view.camera));
        for (job, evaluation) in [(Job::Draw, false), (Job::Sums(Jacobian::Flow), true)] {
            let times = measured(&mut renderer, level, job, &seen.pose)?;
            let cost = Cost { counts: &c, sharing: &sharing, passes: PICTURE_PASSES };
            compare(&cost, &here, evaluation, &times);
        }
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let engine = Engine::new(&DeviceOptions::default())?;
    let device = engine.vulkan();
    println!("{}", engine.device());
    let seen = PriorView::new(&engine)?;
    let view = LevelView::new(&engine, &seen, 1)?;
    let mut best = Best { engine: &engine, ceilings: ceilings::measure(engine.vulkan())? };
    blending(&seen, &view, &mut best)?;
    let keys = &view.stages.keys;
    sorting(device, keys, &mut best)?;
    sorting(device, &keys.repeat(16), &mut best)?;
    // The cost of passes with as many digits, without anything to sort.
    let largest = keys.iter().copied().filter(|key| *key != CULLED).max();
    sorting(device, &[largest.unwrap_or(0)], &mut best)?;
    println!("multiply-adds: {:.1} GFLOP/s", best.ceilings.flops * 1e-9);
    println!("copy by words: {:.2} GB/s", best.ceilings.bytes * 1e-9);
    Ok(predicting(&engine, device, &seen, &best)?)
}
