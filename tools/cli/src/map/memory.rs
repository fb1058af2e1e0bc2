//! How much memory a training takes, said and checked before any picture is read.

use nvsprior::Engine;
use nvsprior::render::training::TrainingMemory;
use nvsprior_kernels::training::planes;
use nvsprior_train::mapper::MapOptions;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

use super::inputs::Listed;

/// Sets of parameters on the host when a state is saved: three sets of planes as numbers, and as bytes.
const SETS: u64 = 6;
/// Bytes of a pixel while a picture is decoded, undistorted and reduced.
const DECODED: u64 = 12;
/// Bytes of a point: as it was read, and as training takes it.
const POINT: u64 = 120;

/// A training that the host has no room for.
#[derive(Debug, thiserror::Error)]
#[error(
    "{pictures} pictures of {}×{} and {splats} splats take {} MB of the host's memory{shared}, and it has {} MB; {fits}",
    size[0], size[1], needed.div_ceil(1_000_000), total / 1_000_000
)]
pub struct NoHostRoom {
    pictures: usize,
    size: [u32; 2],
    splats: u32,
    needed: u64,
    /// Says whether the device's memory is the host's.
    shared: &'static str,
    total: u64,
    fits: String,
}

/// Bytes on the host.
#[derive(Clone, Copy, Debug)]
struct HostMemory {
    /// Of the pictures.
    pictures: u64,
    /// What grows with the splats.
    splats: u64,
    /// The rest.
    rest: u64,
}

impl HostMemory {
    fn of(listed: &Listed, options: &MapOptions) -> HostMemory {
        let count = (listed.train.len() + listed.held_out.len()) as u64;
        let numbers = 4 * u64::from(options.splats) * u64::from(planes(options.sh_degree));
        let at_once = rayon::current_num_threads() as u64;
        HostMemory {
            pictures: count * 3 * listed.size.pixels() as u64,
            splats: SETS * numbers,
            rest: at_once * DECODED * listed.largest() + POINT * listed.points.len() as u64,
        }
    }

    fn sum(&self) -> u64 {
        self.pictures + self.splats + self.rest
    }
}

/// Says how much memory the training takes, at most. Refuses what the device or the host has no room for.
pub fn check(engine: &Engine, listed: &Listed, options: &MapOptions) -> anyhow::Result<()> {
    let size = [listed.size.width, listed.size.height];
    let device = options.plan(size, Default::default()).memory(engine.device())?;
    let host = HostMemory::of(listed, options);
    describe(listed, &host, &device);
    let unified = engine.device().unified;
    let needed = host.sum() + if unified { device.peak } else { 0 };
    let Some(total) = total().filter(|total| needed > *total) else { return Ok(()) };
    let by_splats = needed - host.pictures - host.rest;
    let room = |others: u64| total.saturating_sub(others);
    let splats = scaled(options.splats, room(host.pictures + host.rest), by_splats);
    let pixels = room(host.rest + by_splats) as f64 / host.pictures as f64;
    let fits = match (splats, f64::from(size[0]) * pixels.sqrt()) {
        (1.., _) => format!("about {splats} splats would fit"),
        (_, width) if width >= 1.0 => format!("pictures {} pixels wide would fit", width as u32),
        _ => "take fewer pictures".to_owned(),
    };
    let shared = if unified { ", which the device shares" } else { "" };
    let pictures = listed.train.len() + listed.held_out.len();
    Err(NoHostRoom { pictures, size, splats: options.splats, needed, shared, total, fits }.into())
}

/// What is trained, and in how much memory.
fn describe(listed: &Listed, host: &HostMemory, device: &TrainingMemory) {
    let Listed { train, held_out, points, size, .. } = listed;
    let points = match points.len() {
        0 => "no points: random ones".to_owned(),
        count => format!("{count} points"),
    };
    let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
    eprintln!(
        "{} pictures of {}×{}, {} held out, {points}; up to {} MB of host memory and {} MB of device memory",
        train.len(),
        size.width,
        size.height,
        held_out.len(),
        megabytes(host.sum()),
        megabytes(device.peak)
    );
}

/// `count` in the ratio of two sizes, rounded down.
fn scaled(count: u32, room: u64, taken: u64) -> u32 {
    (u128::from(count) * u128::from(room) / u128::from(taken.max(1))) as u32
}

/// The host's memory, if it is known: that of the machine, or of the container.
fn total() -> Option<u64> {
    let memory = MemoryRefreshKind::nothing().with_ram();
    let system = System::new_with_specifics(RefreshKind::nothing().with_memory(memory)).ok()?;
    let container = system.cgroup_limits().map(|limits| limits.total_memory);
    let machine = Some(system.total_memory());
    [container, machine].into_iter().flatten().filter(|total| *total > 0).min()
}
