//! How near the stages come to what the device can do, and to the same stages written by hand in
//! GLSL (`benches/glsl/`): `cargo bench --bench ceilings`, where the reef's data lies beside the
//! project, else on the tests' wall.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/scene/mod.rs"]
mod scene;

use nvsprior::render::ceilings::{self, Ceilings};
use nvsprior::render::probe::{self, Stages};
use nvsprior::shared::{Counters, PIXEL, Params, RADIX, RADIX_BLOCK, SUMS, TILE};
use nvsprior::vulkan::{
    Buffer, Commands, Device, DeviceOptions, Error, Kernel, Memory, Recorder, Timing,
};
use nvsprior::{Camera, Engine, Pose, Prior};

/// Runs of each kernel, in turn with those that it is compared with; the fastest counts.
const RUNS: usize = 30;

/// Floating-point operations of one splat at one pixel, from the source of each stage: sums, products,
/// minima, comparisons that choose a value, and 14 for the power of 2, the multiply-adds and the
/// scaling of a polynomial of degree 5. The exponent has 4, alpha 2, the weights 4, colour and depth 8.
const PICTURE_FLOPS: f64 = 4.0 + 14.0 + 2.0 + 4.0 + 8.0;
/// Without depth; the pull 6, the step of the weights 14, the twelve sums 24, the transmittance's 4.
const FLOW_FLOPS: f64 = PICTURE_FLOPS - 2.0 + 6.0 + 14.0 + 24.0 + 4.0;

macro_rules! ours {
    ($file:literal, $name:literal) => {
        Source {
            name: $name,
            entry: concat!($file, "::", $name),
            spirv: include_bytes!(concat!("../shaders-rs/spv/", $name, ".spv")),
        }
    };
}

macro_rules! glsl {
    ($name:literal) => {
        Source {
            name: concat!($name, " in GLSL"),
            entry: "main",
            spirv: include_bytes!(concat!("glsl/", $name, ".spv")),
        }
    };
}

struct Source {
    name: &'static str,
    entry: &'static str,
    spirv: &'static [u8],
}

impl Source {
    fn kernel(&self, device: &Device, bindings: u32, push: u32) -> Result<Kernel, Error> {
        Kernel::new(device, self.name, self.entry, self.spirv, bindings, push)
    }
}

/// A prior seen from somewhere, with all that comes before the blending.
struct View {
    camera: Camera,
    params: Params,
    stages: Stages,
}

impl View {
    fn new(engine: &Engine) -> Result<View, Error> {
        let (prior, camera, pose): (Prior, Camera, Pose) = match common::reef_prior() {
            Some(prior) => (prior, common::REEF_CAMERA, common::reef_pose()),
            None => (scene::wall(1), scene::CAMERA, scene::pose(0.0)),
        };
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
        let stages = probe::stages(engine, &*engine.upload(&prior)?, &camera, &pose, 1 << 20)?;
        Ok(View { camera, params, stages })
    }

    /// Splats times pixels that the blending goes through: a tile ends with its last pixel.
    fn evaluations(&self) -> f64 {
        let tiles =
            (0..self.params.tiles_y).flat_map(|y| (0..self.params.tiles_x).map(move |x| [x, y]));
        let drawn = std::iter::zip(tiles, &self.stages.ranges);
        drawn.map(|(tile, &range)| self.drawn(tile, range)).sum::<usize>() as f64
            * f64::from(TILE * TILE)
    }

    /// Splats of a tile that are drawn.
    fn drawn(&self, tile: [u32; 2], [from, to]: [u32; 2]) -> usize {
        let mut left = [1.0f32; (TILE * TILE) as usize];
        let list = &self.stages.sorted_splats[from as usize..to as usize];
        let ends = |splat: &u32| {
            let s = &self.stages.records[*splat as usize];
            for (k, t) in (0..).zip(&mut left) {
                let dx = s[0] - (tile[0] * TILE + k % TILE) as f32 - 0.5;
                let dy = s[1] - (tile[1] * TILE + k / TILE) as f32 - 0.5;
                let (u, w) = (s[2] * dx + s[3] * dy, s[4] * dy);
                let alpha = (s[5] * (-0.5 * (u * u + w * w)).exp()).min(self.params.alpha_max);
                let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
                *t = if *t * (1.0 - alpha) > 1e-4 { *t * (1.0 - alpha) } else { 0.0 };
            }
            left.iter().all(|t| *t == 0.0)
        };
        list.iter().position(ends).map_or(list.len(), |last| last + 1)
    }
}

/// Fastest device times of kernels with the same bindings, run in turn, milliseconds.
fn times(mut commands: Vec<Commands>) -> Result<Vec<f64>, Error> {
    let mut best = vec![f64::INFINITY; commands.len()];
    for _ in 0..RUNS {
        for (commands, best) in commands.iter_mut().zip(&mut best) {
            commands.run()?;
            *best = best.min(commands.stage_times()?.iter().map(|s| s.milliseconds).sum());
        }
    }
    Ok(best)
}

/// The blending stages against the arithmetic's ceiling, and against GLSL where that fits the device.
fn blending(device: &Device, view: &View, ceilings: &Ceilings) -> Result<(), Error> {
    let (stages, params) = (&view.stages, &view.params);
    let groups = [params.tiles_x, params.tiles_y, 1];
    let params = Buffer::from_slice(device, "parameters", &[*params])?;
    let ranges = Buffer::from_slice(device, "ranges", &stages.ranges)?;
    let pairs = Buffer::from_slice(device, "pairs", &stages.sorted_splats)?;
    let records = Buffer::from_slice(device, "records", &stages.records)?;
    let frame = Buffer::from_slice(device, "frame", &common::random_frame(1, &view.camera))?;
    let out = PIXEL as usize * view.camera.pixels();
    let image = Buffer::new::<f32>(device, "picture", out, Memory::Device)?;
    let rows = SUMS as usize * (groups[0] * groups[1]) as usize;
    let partials = Buffer::new::<f32>(device, "sums by tile", rows, Memory::Device)?;
    let picture = [&params, &ranges, &pairs, &records, &image];
    let sums = [&params, &ranges, &pairs, &records, &frame, &partials];
    let record = |source: &Source, buffers: &[&Buffer]| {
        let kernel = source.kernel(device, buffers.len() as u32, 0)?;
        let mut recorder = Recorder::new(device, Timing::Stages)?;
        recorder.dispatch(&kernel, buffers, &[], groups)?;
        recorder.finish()
    };
    let of_eight = device.info().subgroup == 8 && device.info().shuffles;
    let (splat, flow) = match of_eight {
        true => (ours!("splat", "splat_lanes"), ours!("splat_flow", "splat_flow_lanes")),
        false => (ours!("splat", "splat"), ours!("splat_flow", "splat_flow")),
    };
    let mut commands = vec![record(&splat, &picture)?, record(&flow, &sums)?];
    if of_eight {
        commands.push(record(&glsl!("splat"), &picture)?);
    }
    let times = times(commands)?;
    let evaluations = view.evaluations();
    println!("{:.2} M splats times pixels", evaluations * 1e-6);
    for (name, ms, flops) in [("splat", times[0], PICTURE_FLOPS), ("flow", times[1], FLOW_FLOPS)] {
        let rate = evaluations * flops / (ms * 1e-3);
        let share = 100.0 * rate / ceilings.flops;
        println!("{name}: {ms:.2} ms, {flops} operations each, {:.1} GFLOP/s", rate * 1e-9);
        println!("  {share:.0} % of the arithmetic's ceiling");
    }
    if let Some(glsl) = times.get(2) {
        println!("splat in GLSL: {glsl:.2} ms; ours takes {:.2} of it", times[0] / glsl);
    }
    Ok(())
}

/// One pass of the sort, against the copy's ceiling and against GLSL. A pass reads the keys twice and
/// the values once, and writes both: 20 bytes a pair.
fn sorting(device: &Device, view: &View, ceilings: &Ceilings) -> Result<(), Error> {
    let count = view.stages.pair_tiles.len();
    let blocks = (count as u32).div_ceil(RADIX_BLOCK);
    let own = |name| Buffer::new::<u32>(device, name, count, Memory::Device);
    let counters = Counters { sort: [0, count as u32], ..Counters::default() };
    let counters = Buffer::from_slice(device, "counters", &[counters])?;
    let keys = Buffer::from_slice(device, "keys", &view.stages.pair_tiles)?;
    let values = Buffer::from_slice(device, "values", &view.stages.pair_splats)?;
    let (keys_out, values_out) = (own("sorted keys")?, own("sorted values")?);
    let words = (blocks * RADIX) as usize;
    let histogram = Buffer::new::<u32>(device, "digit histogram", words, Memory::Device)?;
    let record = |[count, scan, scatter]: [Source; 3]| {
        let mut recorder = Recorder::new(device, Timing::Stages)?;
        let r = &mut recorder;
        let many = [blocks, 1, 1];
        let (first, all) = ([&counters, &keys, &histogram], [1, 0]);
        r.dispatch(&count.kernel(device, 3, 2)?, &first, &all, many)?;
        r.dispatch(&scan.kernel(device, 2, 2)?, &[&counters, &histogram], &all, [1, 1, 1])?;
        let last = [&counters, &histogram, &keys, &values, &keys_out, &values_out];
        r.dispatch(&scatter.kernel(device, 6, 2)?, &last, &all, many)?;
        recorder.finish()
    };
    let ours = record([
        ours!("radix", "radix_count"),
        ours!("radix", "radix_scan"),
        ours!("radix", "radix_scatter"),
    ])?;
    let glsl = record([glsl!("radix_count"), glsl!("radix_scan"), glsl!("radix_scatter")])?;
    let times = times(vec![ours, glsl])?;
    let rate = count as f64 * 20.0 / (times[0] * 1e-3);
    println!(
        "one pass of the sort, {count} pairs: {:.2} ms, {:.2} GB/s, {:.0} % of the copy's ceiling",
        times[0],
        rate * 1e-9,
        100.0 * rate / ceilings.bytes
    );
    println!("the pass in GLSL: {:.2} ms; ours takes {:.2} of it", times[1], times[0] / times[1]);
    Ok(())
}

fn main() -> Result<(), Error> {
    let engine = Engine::new(&DeviceOptions::default())?;
    let device = Device::open(&DeviceOptions::default())?;
    let ceilings = ceilings::measure(&engine)?;
    println!("{}", engine.device());
    println!("multiply-adds: {:.1} GFLOP/s", ceilings.flops * 1e-9);
    println!("copy by words: {:.2} GB/s", ceilings.bytes * 1e-9);
    let view = View::new(&engine)?;
    blending(&device, &view, &ceilings)?;
    sorting(&device, &view, &ceilings)
}
