//! How much memory a training takes, said and checked before any picture is read.

use nvsprior::Engine;
use nvsprior_kernels::training::planes;
use nvsprior_train::mapper::MapOptions;
use nvsprior_train::trainer::TrainingMemory;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

use super::from::CANDIDATES;
use super::inputs::Listed;

/// Sets of parameters on the host when a state is saved: three sets of planes as numbers, and as bytes.
const SETS: u64 = 6;
/// Bytes of a pixel while a picture is decoded, undistorted and reduced.
const DECODED: u64 = 12;
/// Bytes of a pixel of a picture: as it was read, its mask, and as the loss reads it.
const PIXEL: u64 = 3 + 1 + 4;
/// Bytes of a pixel of a picture that is held out, besides: it is measured by, and trained on in the end.
const MEASURED: u64 = 3 + 1;
/// Bytes of a pixel of a picture that a training goes on with: of the views of which those that are remembered are
/// chosen, then of one as it was, as it is trained on, and what has changed.
const REMEMBERED: u64 = 4 * CANDIDATES as u64 + 4 + PIXEL + 4;
/// Bytes of a point: as it was read, and as training takes it.
const POINT: u64 = 120;

/// A training that the host has no room for.
#[derive(Debug, thiserror::Error)]
#[error(
    "{pictures} pictures of {}×{} and {splats} splats take {} MB of the host's memory{shared}, and it has {} MB; \
        {fits}",
    size[0], size[1], needed.div_ceil(1_000_000), total / 1_000_000
)]
pub struct NoHostRoom {
    pictures: u64,
    size: [u32; 2],
    splats: u32,
    needed: u64,
    /// Says whether the device's memory is the host's.
    shared: &'static str,
    total: u64,
    fits: String,
}

/// What of the host's memory a training takes, bytes.
#[derive(Clone, Copy, Debug)]
struct HostMemory {
    count: u64,
    size: [u32; 2],
    splats: u32,
    /// What grows with the pictures.
    by_pictures: u64,
    /// What grows with the splats.
    by_splats: u64,
    rest: u64,
}

impl HostMemory {
    /// `goes_on`: with a prior, of which views are remembered.
    fn of(listed: &Listed, options: &MapOptions, goes_on: bool) -> HostMemory {
        let held_out = listed.held_out.len() as u64;
        let count = listed.train.len() as u64 + held_out;
        let numbers = 4 * u64::from(options.splats) * u64::from(planes(options.sh_degree));
        let pixels = listed.size.pixels() as u64;
        let remembered = if goes_on { listed.train.len() as u64 * REMEMBERED } else { 0 };
        let of_size = |by: &u32| 4 * count * pixels / u64::from(*by).pow(2);
        let smaller = options.reductions.iter().filter(|by| **by > 1).map(of_size).sum::<u64>();
        let at_once = rayon::current_num_threads() as u64;
        HostMemory {
            count,
            size: [listed.size.width, listed.size.height],
            splats: options.splats,
            by_pictures: (count * PIXEL + held_out * MEASURED + remembered) * pixels + smaller,
            by_splats: SETS * numbers,
            rest: at_once * DECODED * listed.largest() + POINT * listed.points.len() as u64,
        }
    }

    fn sum(&self) -> u64 {
        self.by_pictures + self.by_splats + self.rest
    }

    /// Refuses what is more than a host has. `shared`: memory of a device that has none of its own.
    fn check(&self, shared: Option<u64>, total: u64) -> Result<(), NoHostRoom> {
        let HostMemory { count, size, splats, .. } = *self;
        let by_splats = self.by_splats + shared.unwrap_or(0);
        let needed = self.by_pictures + by_splats + self.rest;
        if needed <= total {
            return Ok(());
        }
        let room = |others: u64| total.saturating_sub(others) as f64;
        let fewer = f64::from(splats) * room(self.by_pictures + self.rest) / by_splats as f64;
        let smaller = room(by_splats + self.rest) / self.by_pictures as f64;
        let narrower = f64::from(size[0]) * smaller.sqrt();
        let fits = if fewer >= 1.0 {
            format!("about {} splats would fit", fewer as u32)
        } else if narrower >= 1.0 {
            format!("pictures {} pixels wide would fit", narrower as u32)
        } else {
            "take fewer pictures".to_owned()
        };
        let shared = if shared.is_some() { ", which the device shares" } else { "" };
        Err(NoHostRoom { pictures: count, size, splats, needed, shared, total, fits })
    }
}

/// Says how much memory the training takes, at most. Refuses what the device or the host has no room for. `goes_on`:
/// with a prior.
pub fn check(
    engine: &Engine,
    listed: &Listed,
    options: &MapOptions,
    goes_on: bool,
) -> anyhow::Result<()> {
    let size = [listed.size.width, listed.size.height];
    let device = options.plan(size, Default::default()).memory(engine.device())?;
    let host = HostMemory::of(listed, options, goes_on);
    describe(listed, &host, &device, goes_on);
    let shared = engine.device().unified.then_some(device.peak);
    match total() {
        Some(total) => Ok(host.check(shared, total)?),
        None => Ok(()),
    }
}

/// What is trained, and in how much memory.
fn describe(listed: &Listed, host: &HostMemory, device: &TrainingMemory, goes_on: bool) {
    let Listed { train, held_out, points, size, .. } = listed;
    let points = match points.len() {
        0 if goes_on => "a prior to go on with".to_owned(),
        0 => "no points: random ones".to_owned(),
        count => format!("{count} points"),
    };
    let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
    tell!(
        "{} pictures of {}×{}, {} held out, {points}; up to {} MB of host memory and {} MB of device memory",
        train.len(),
        size.width,
        size.height,
        held_out.len(),
        megabytes(host.sum()),
        megabytes(device.peak)
    );
}

/// The host's memory, if it is known: that of the machine, or of the container.
fn total() -> Option<u64> {
    let memory = MemoryRefreshKind::nothing().with_ram();
    let system = System::new_with_specifics(RefreshKind::nothing().with_memory(memory)).ok()?;
    let container = system.cgroup_limits().map(|limits| limits.total_memory);
    let machine = Some(system.total_memory());
    [container, machine].into_iter().flatten().filter(|total| *total > 0).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOST: HostMemory = HostMemory {
        count: 1_000,
        size: [400, 200],
        splats: 50_000,
        by_pictures: 4_000_000,
        by_splats: 5_000_000,
        rest: 1_000_000,
    };

    #[test]
    fn what_the_host_has_no_room_for_is_refused_with_what_would_fit() {
        assert!(HOST.check(None, 10_000_000).is_ok());
        for (shared, total, named) in [
            (None, 9_999_999, "about 49999 splats would fit"),
            (None, 7_000_000, "about 20000 splats would fit"),
            (
                Some(5_000_000),
                10_000_000,
                "which the device shares, and it has 10 MB; about 25000 splats",
            ),
            (None, 4_000_000, "take fewer pictures"),
        ] {
            let error = HOST.check(shared, total).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
            assert!(error.starts_with("1000 pictures of 400×200 and 50000 splats take"), "{error}");
        }
        let many = HostMemory { by_pictures: 400_000_000, ..HOST };
        let error = many.check(None, 106_000_000).unwrap_err().to_string();
        assert!(
            error.contains("take 406 MB") && error.contains("pictures 200 pixels wide"),
            "{error}"
        );
    }
}
