//! What a training takes of the device's memory, known before any of it is taken.

use nvsprior::parts::{binning, kernels, radix};
use nvsprior::vulkan::DeviceInfo;
use nvsprior_kernels::shared::{
    Counters, GEOMETRY_PLANES, GROUP, PIXEL, RECORD, SUMS, TILE, sh_planes,
};
use nvsprior_kernels::training::{GRADIENT_PIXEL, PAIR_FLOATS, SSIM_MAPS, planes};

use super::{PAIRS_PER_SPLAT, TrainingPlan, first_pairs, with_room};

/// Device memory of a training, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainingMemory {
    /// What it takes from the start.
    pub start: u64,
    /// What it takes at most, while a splat shows in five tiles on average, or in fewer.
    pub peak: u64,
}

/// Which limit of the device a training passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum Shortage {
    #[error("buffer \"{buffer}\" would take {} MB, and a buffer of this device holds {} MB",
        megabytes(*bytes), limit / 1_000_000)]
    Buffer { buffer: &'static str, bytes: u64, limit: u64 },
    #[error("it would take {} MB, and this device has {} MB", megabytes(*bytes), heap / 1_000_000)]
    Heap { bytes: u64, heap: u64 },
    #[error("it would take {count} workgroups, and this device dispatches {limit}")]
    Workgroups { count: u64, limit: u64 },
}

/// What would fit instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fits {
    /// So many splats of the same degree, on the same pictures.
    Splats(u32),
    /// The same splats on pictures of this width, of the same shape.
    Width(u32),
    /// Neither fewer splats nor smaller pictures alone.
    Nothing,
}

impl std::fmt::Display for Fits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Fits::Splats(count) => write!(f, "{count} splats of this degree would fit"),
            Fits::Width(width) => write!(f, "pictures {width} pixels wide would fit"),
            Fits::Nothing => write!(f, "take fewer splats and smaller pictures"),
        }
    }
}

/// A training that the device has no room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Its text tells.
#[error(
    "{splats} splats of degree {sh_degree} on pictures of {}×{} do not fit: {shortage}; {fits}",
    size[0], size[1]
)]
pub struct NoRoom {
    pub splats: u32,
    pub sh_degree: u32,
    pub size: [u32; 2],
    pub shortage: Shortage,
    pub fits: Fits,
}

/// Rounded up, so that what is too large also reads as larger than its limit.
fn megabytes(bytes: u64) -> u64 {
    bytes.div_ceil(1_000_000)
}

impl TrainingPlan {
    /// Memory that this training takes, if the device has it.
    pub fn memory(&self, device: &DeviceInfo) -> Result<TrainingMemory, NoRoom> {
        let Some(shortage) = self.shortage(device) else {
            return Ok(Sizes::of(self, device).memory());
        };
        let TrainingPlan { splats, sh_degree, size, .. } = *self;
        Err(NoRoom { splats, sh_degree, size, shortage, fits: self.what_fits(device) })
    }

    fn shortage(&self, device: &DeviceInfo) -> Option<Shortage> {
        let (count, limit) =
            (u64::from(self.splats) / u64::from(GROUP) + 1, device.workgroups.into());
        if count > limit {
            return Some(Shortage::Workgroups { count, limit });
        }
        let sizes = Sizes::of(self, device);
        let limit = device.storage_range.min(device.allocation);
        if let Some((buffer, bytes)) = sizes.buffers().find(|(_, bytes)| *bytes > limit) {
            return Some(Shortage::Buffer { buffer, bytes, limit });
        }
        let (bytes, heap) = (sizes.memory().peak, device.heap);
        (bytes > heap).then_some(Shortage::Heap { bytes, heap })
    }

    fn what_fits(&self, device: &DeviceInfo) -> Fits {
        let with_splats = |splats| TrainingPlan { splats, ..self.clone() };
        let [width, height] = self.size.map(u64::from);
        let with_width = |own: u32| {
            let scaled = (height * u64::from(own)).div_ceil(width.max(1)) as u32;
            TrainingPlan { size: [own, scaled.max(1)], ..self.clone() }
        };
        let fits = |plan: TrainingPlan| plan.shortage(device).is_none();
        if let Some(splats) = most(self.splats, |splats| fits(with_splats(splats))) {
            return Fits::Splats(splats);
        }
        most(self.size[0], |width| fits(with_width(width))).map_or(Fits::Nothing, Fits::Width)
    }
}

/// The largest number below `end` that fits, if 1 does. Whatever is larger than what does not fit does not fit either.
fn most(end: u32, fits: impl Fn(u32) -> bool) -> Option<u32> {
    let (mut low, mut high) = (0, end);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if fits(middle) { low = middle } else { high = middle }
    }
    (low > 0).then_some(low)
}

/// A buffer's name and its size in bytes.
type Size = (&'static str, u64);

/// The buffers of a training. Those of a few words are left out.
struct Sizes {
    /// Buffers that stay as they are, and the longest copy of a set of planes from or to the host.
    fixed: [Size; 18],
    /// Workspace by splats: it is made again when pictures need more pairs.
    workspace: [Size; 5],
    /// Buffers whose size grows with (tile, splat) pairs, at first.
    pairs: [Size; 3],
    /// The same, if a splat shows in as many tiles as is planned for.
    planned: [Size; 3],
}

impl Sizes {
    fn of(plan: &TrainingPlan, device: &DeviceInfo) -> Sizes {
        let splats = u64::from(plan.splats);
        let [width, height] = plan.size.map(u64::from);
        let pixels = width * height;
        let tiles = width.div_ceil(TILE.into()) * height.div_ceil(TILE.into());
        let numbers = 4 * splats * u64::from(planes(plan.sh_degree));
        let floats = |count: u32, each: u64| 4 * u64::from(count) * each;
        let log_blocks = kernels::log_sort_blocks(device, plan.splats);
        let log_bin_blocks = kernels::log_bin_blocks(device, plan.splats);
        let log_bin_blocks = binning::log_blocks(log_bin_blocks, tiles.min(u32::MAX.into()) as u32);
        let first = first_pairs(plan.splats);
        let planned = plan.splats.saturating_mul(PAIRS_PER_SPLAT);
        let planned = if planned > first { with_room(planned) } else { first };
        Sizes {
            fixed: [
                ("parameters", numbers),
                ("means of gradients", 2 * numbers),
                ("state", 2 * numbers),
                ("geometry", floats(2 * GEOMETRY_PLANES, splats)),
                ("spherical harmonics", floats(2 * sh_planes(plan.sh_degree), splats)),
                ("first slots", 4 * (splats + 1)),
                ("splats in view", 4 * splats),
                ("picture", floats(PIXEL, pixels)),
                ("picture read back", floats(PIXEL, pixels)),
                ("frame", floats(3, pixels)),
                ("8-bit picture, training frame", (3 + 4) * pixels),
                ("blurred maps", floats(3 * 2 * SSIM_MAPS, pixels)),
                ("derivatives of SSIM", floats(3 * 2, pixels)),
                ("derivatives by means", floats(3 * 2, pixels)),
                ("gradient of the loss", floats(GRADIENT_PIXEL, pixels)),
                ("tile ranges", 8 * tiles),
                ("tile starts", 4 * ((tiles << log_bin_blocks) + tiles)),
                ("sums by tile", floats(SUMS, tiles)),
            ],
            workspace: [
                ("projected splats", floats(4 * RECORD, splats + 1)),
                ("depth keys", 4 * splats),
                ("splats half sorted", 4 * 4 * splats),
                ("depth order", 4 * splats),
                (
                    "digit histogram",
                    floats(radix::histogram(log_blocks).words(), 1) + size_of::<Counters>() as u64,
                ),
            ],
            pairs: by_pairs(first),
            planned: by_pairs(planned),
        }
    }

    /// Each buffer that the device must give in one piece.
    fn buffers(&self) -> impl Iterator<Item = Size> {
        self.fixed.into_iter().chain(self.workspace).chain(self.planned)
    }

    fn memory(&self) -> TrainingMemory {
        let sum = |sizes: &[Size]| sizes.iter().map(|(_, bytes)| bytes).sum::<u64>();
        let Sizes { fixed, workspace, pairs, planned } = self;
        let start = sum(fixed) + sum(workspace) + sum(pairs);
        // The old buffers are there until the new ones are made.
        let grown = if planned == pairs { 0 } else { sum(workspace) + sum(planned) };
        TrainingMemory { start, peak: start + grown }
    }
}

fn by_pairs(count: u32) -> [Size; 3] {
    let count = u64::from(count);
    let sums = 8 * u64::from(PAIR_FLOATS) * count;
    [("pair splats", 4 * count), ("slots", 4 * count), ("sums of pairs", sums)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_finds_the_last_that_fits() {
        for last in [1, 2, 63, 99] {
            assert_eq!(most(100, |n| n <= last), Some(last));
        }
        assert_eq!(most(100, |_| false), None);
    }
}
