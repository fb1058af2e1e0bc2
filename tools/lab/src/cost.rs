//! Formulas for what each stage reads, writes and calculates, and for how long that should take on a little known
//! device. `docs/experiments/stages.md` has the formulas as a table.
//!
//! Bytes are those of the algorithm. Each word that an invocation asks for counts, whether a cache has it or not; words
//! that a workgroup shares count once. Operations are sums, products, divisions, roots, minima, comparisons that choose
//! a value, and such integer work; a device's own power of 2 counts as 14. All is counted by hand from the sources.
//! These are estimates, best for the blending.

mod counts;

use nvsprior::{Engine, Prior};
use nvsprior_kernels::block_table::BlockTable;
use nvsprior_kernels::shared::{BIN_TABLE, DIGITS, SUMS};
use nvsprior_reference::probe::Probe;

pub use counts::Counts;

/// Passes of a picture's sort, and of that of an evaluation nobody sees.
pub const PICTURE_PASSES: u32 = DIGITS;
/// See [`PICTURE_PASSES`].
pub const SEARCH_PASSES: u32 = DIGITS - 1;

/// Operations per splat and pixel of a picture: 4 for the argument, 7 for the power, 3 for alpha's clamp, cut and stop,
/// 2 for weight and transmittance, 8 for colour and depth.
pub const PICTURE_FLOPS: f64 = 4.0 + 7.0 + 3.0 + 2.0 + 8.0;
/// The same for an evaluation, with the device's own power of 2, and without depth.
const EVALUATION_FLOPS: f64 = PICTURE_FLOPS + 7.0 - 2.0;
/// As [`EVALUATION_FLOPS`], with the flow Jacobian: 4 for the pull, 5 for what the clamp leaves and the four motions, 9
/// for the derivatives of the transmittance, 24 for the twelve sums.
pub const FLOW_FLOPS: f64 = EVALUATION_FLOPS + 4.0 + 5.0 + 9.0 + 24.0;
/// As [`EVALUATION_FLOPS`], with the exact Jacobian: 5 for `v`, 72 for dα (six derivatives with six terms each), 18 for
/// weights, 54 for three colours with their own derivatives, 18 for the transmittance.
const EXACT_FLOPS: f64 = EVALUATION_FLOPS + 5.0 + 72.0 + 18.0 + 54.0 + 18.0;
/// Operations per splat that an invocation has loaded, before its column of pixels: 21 for the splat, 7 for the column.
const COLUMN: f64 = 28.0;
/// Operations of a pixel's share of the normal equations: three channels.
const SHARE: f64 = 3.0 * 90.0;
/// Bytes of a splat's place and record.
const ENTRY: f64 = 4.0 + 48.0;
/// Pixels of a tile.
const TILE_PIXELS: f64 = 64.0;

/// How a device's invocations share the stages.
#[derive(Clone, Copy, Debug)]
pub struct Sharing {
    /// Workgroups that share the sort of the splats, S.
    pub sort_blocks: u32,
    /// Workgroups that share their binning, B.
    pub bin_blocks: f64,
    /// Tiles of a band at most.
    pub bin_table: f64,
    /// Rows of tiles of a band at most.
    pub band_rows: f64,
    /// Pixels that an invocation of the blending stages draws per loaded splat, in a picture and in an evaluation, c.
    pub column: [f64; 2],
}

impl Sharing {
    /// As integrated GPUs have it, with as many workgroups as small priors take.
    pub const GPU: Sharing = Sharing {
        sort_blocks: 32,
        bin_blocks: 128.0,
        bin_table: BIN_TABLE as f64,
        band_rows: 6.0,
        column: [4.0, 4.0],
    };

    /// As the engine has it for a prior.
    pub fn of(engine: &Engine, prior: &Prior) -> Sharing {
        let (probe, splats) = (Probe::of(engine), prior.len() as u32);
        let sort_blocks = 1 << probe.log_sort_blocks(splats);
        let bin_blocks = f64::from(1 << probe.log_bin_blocks(splats));
        let bin_table = f64::from(probe.bin_table());
        let band_rows = f64::from(probe.band_rows());
        let sharing = Sharing { sort_blocks, bin_blocks, bin_table, band_rows, ..Sharing::GPU };
        match engine.device().in_lockstep() {
            true => Sharing { column: [8.0, 4.0], ..sharing },
            false => sharing,
        }
    }

    /// Counters of a digit that a workgroup of the sort adds up, on average.
    fn digit(&self) -> f64 {
        let table = BlockTable::new(1, self.sort_blocks.ilog2(), 0, 1);
        let (sums, each) = (f64::from(1 << table.log_sums()), f64::from(1 << table.log_each()));
        sums + (each - 1.0) / 2.0
    }
}

/// What a stage takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Work {
    /// Bytes that it reads and writes.
    pub bytes: f64,
    /// Operations.
    pub flops: f64,
    /// Dispatches.
    #[serde(skip)]
    pub dispatches: f64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Work) {
        self.bytes += other.bytes;
        self.flops += other.flops;
        self.dispatches += other.dispatches;
    }
}

impl std::ops::Mul<f64> for Work {
    type Output = Work;

    fn mul(self, times: f64) -> Work {
        Work {
            bytes: self.bytes * times,
            flops: self.flops * times,
            dispatches: self.dispatches * times,
        }
    }
}

/// A picture whose stages are counted.
#[derive(Clone, Copy, Debug)]
pub struct Cost<'a> {
    /// What it is made of.
    pub counts: &'a Counts,
    /// How the device shares it.
    pub sharing: &'a Sharing,
    /// Passes of its sort.
    pub passes: u32,
}

impl Cost<'_> {
    /// Work of the stage of this name. Stages that touch some hundred bytes count as nothing.
    pub fn of(&self, stage: &str) -> Work {
        match stage {
            "project" => self.project(),
            "radix_count" | "radix_scatter" => self.sort(stage),
            "bin_count" | "bin_scan" | "bin_emit" => self.lists(stage),
            "splat" => self.picture(),
            "splat_flow" => self.evaluation(FLOW_FLOPS, 0.0),
            // Twelve vectors of derivatives a record.
            "splat_exact" => self.evaluation(EXACT_FLOPS, 12.0 * 16.0),
            _ => self.small(stage),
        }
    }

    /// Seven pairs of floats per splat; the harmonics of the visible ones; a record and a key; the counts of a digit.
    fn project(&self) -> Work {
        let c = self.counts;
        Work {
            bytes: c.splats * (56.0 + 4.0) + c.visible * (8.0 * c.planes + 48.0) + self.table(),
            flops: c.splats * 200.0 + c.visible * (60.0 + 6.0 * c.coefficients),
            dispatches: 1.0,
        }
    }

    /// Bytes of the counts of one digit.
    fn table(&self) -> f64 {
        4.0 * f64::from(self.sharing.sort_blocks) * self.counts.digits
    }

    /// All passes of a stage of the sort.
    fn sort(&self, stage: &str) -> Work {
        let (c, passes) = (self.counts, f64::from(self.passes));
        let (n, v, later) = (c.splats, c.visible, passes - 1.0);
        if stage == "radix_count" {
            // Stage `project` counts the first digit.
            let bytes = later * (4.0 * v + self.table());
            return Work { bytes, flops: 20.0 * later * v, dispatches: later };
        }
        let counters = self.sharing.digit();
        let blocks = f64::from(self.sharing.sort_blocks);
        // The first pass makes its values, the last writes no keys.
        let moved = 4.0 * n + 8.0 * v + 16.0 * later * v - 4.0 * v;
        Work {
            bytes: moved + passes * counters * self.table(),
            flops: passes * (40.0 * v + 2.0 * counters * blocks * c.digits),
            dispatches: passes,
        }
    }

    /// Bands of whole rows of tiles that are binned by themselves.
    fn bands(&self) -> f64 {
        let (c, sharing) = (self.counts, self.sharing);
        let rows = (sharing.bin_table / c.tiles_x).floor().min(sharing.band_rows);
        (c.tiles / c.tiles_x / rows).ceil()
    }

    /// A stage of the binning. Each band goes over all splats: their place in the order, and 24 bytes of the record.
    fn lists(&self, stage: &str) -> Work {
        let c = self.counts;
        let table = 4.0 * self.sharing.bin_blocks * c.tiles;
        let read = self.bands() * 28.0 * c.visible;
        let flops = self.bands() * 40.0 * c.visible + 45.0 * c.rows;
        let (bytes, flops) = match stage {
            "bin_count" => (read + table, flops + 4.0 * c.rows),
            "bin_scan" => (3.0 * table, 0.0),
            // Reads each place twice. Writes the list, and the two ends of each tile's part.
            _ => (read + 2.0 * table + 8.0 * c.pairs + 8.0 * c.tiles, flops + 30.0 * c.pairs),
        };
        Work { bytes, flops, dispatches: 1.0 }
    }

    /// An entry of the list and a record; five floats per pixel.
    fn picture(&self) -> Work {
        let (c, [column, _]) = (self.counts, self.sharing.column);
        let [blended, _] = c.blended;
        Work {
            bytes: ENTRY * blended / TILE_PIXELS + 8.0 * c.tiles + 20.0 * c.pixels,
            flops: (PICTURE_FLOPS + COLUMN / column) * blended,
            dispatches: 1.0,
        }
    }

    /// The blending with `derivatives` further bytes per record. Also three floats per pixel of the frame, and one row
    /// of sums per tile.
    fn evaluation(&self, flops: f64, derivatives: f64) -> Work {
        let (c, [_, column]) = (self.counts, self.sharing.column);
        let [_, blended] = c.blended;
        let tile = 8.0 + 4.0 * f64::from(SUMS);
        Work {
            bytes: (ENTRY + derivatives) * blended / TILE_PIXELS + tile * c.tiles + 12.0 * c.pixels,
            flops: (flops + COLUMN / column) * blended + SHARE * c.pixels,
            dispatches: 1.0,
        }
    }

    fn small(&self, stage: &str) -> Work {
        let c = self.counts;
        let (bytes, flops) = match stage {
            "pose_jacobian" => (
                4.0 * c.splats + c.visible * (56.0 + 8.0 * c.planes + 48.0 + 192.0),
                c.visible * (700.0 + 24.0 * c.coefficients),
            ),
            "reduce" | "solve" => {
                let sums = f64::from(SUMS) * c.tiles;
                (4.0 * sums, sums)
            }
            // Bytes of the whole frame, whatever the level; floats of the level.
            "pyramid" => (3.0 * c.frame_pixels + 12.0 * c.pixels, 3.0 * c.frame_pixels),
            // With the difference from a frame.
            "quantize_rgb8" => ((20.0 + 3.0 + 6.0) * c.pixels, 12.0 * c.pixels),
            _ => return Work::default(),
        };
        Work { bytes, flops, dispatches: 1.0 }
    }
}

/// A device as the model sees it.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Operations per second; a multiply-add is two.
    pub flops: f64,
    /// Bytes per second.
    pub bytes: f64,
    /// Seconds of a dispatch with its barrier.
    pub dispatch: f64,
}

impl Machine {
    /// Seconds of some work: the longer of bytes and operations, plus the dispatches.
    pub fn seconds(&self, work: &Work) -> f64 {
        (work.bytes / self.bytes).max(work.flops / self.flops) + work.dispatches * self.dispatch
    }
}
