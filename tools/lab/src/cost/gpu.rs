//! How long a stage should take on a GPU, from what a GPU's compiler makes of it (`make gpu-check`) and from the counts
//! of a picture: the longest of issuing its instructions, moving its bytes, and waiting for loads, plus its dispatches.
//! `docs/latency.md` has the figures.

use anyhow::Context as _;
use nvsprior_kernels::shared::ROWS;

use super::{Cost, Counts, Sharing, TILE_PIXELS};
use crate::gpu_check::{Instructions, Loop, Row, SPLATS_PER_ROUND, form, work_loop, workers};

/// A GPU of NVIDIA's kind: multiprocessors whose schedulers issue one instruction of a subgroup of 32 per cycle,
/// whatever its kind.
#[derive(Clone, Copy, Debug)]
pub struct Gpu {
    /// Multiprocessors.
    pub multiprocessors: f64,
    /// Schedulers of a multiprocessor.
    pub schedulers: f64,
    /// Cycles per second.
    pub clock: f64,
    /// Most subgroups that a multiprocessor holds.
    pub subgroups: f64,
    /// Most workgroups that it holds.
    pub workgroups: f64,
    /// Its registers, 32 bits each.
    pub registers: f64,
    /// Its shared memory.
    pub shared_bytes: f64,
    /// Cycles from a load to its value.
    pub load: f64,
    /// Cycles from a load of shared memory to its value.
    pub shared_load: f64,
    /// Cycles of a transcendental operation of a subgroup.
    pub transcendental: f64,
}

/// Invocations of a subgroup.
const LANES: f64 = 32.0;
/// Loads outside of the loops that wait for each other: the parameters, and what they point to.
const FIRST_LOADS: f64 = 2.0;

/// Seconds of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Until all instructions are issued.
    pub issue: f64,
    /// Until all bytes are moved.
    pub memory: f64,
    /// Until all loads that wait for each other have their values.
    pub latency: f64,
    /// Of its dispatches, whatever they do.
    pub dispatches: f64,
}

impl Times {
    /// All of it.
    pub fn seconds(&self) -> f64 {
        self.issue.max(self.memory).max(self.latency) + self.dispatches
    }

    /// What takes the most.
    pub fn bound(&self) -> &'static str {
        let all = [
            ("issue", self.issue),
            ("memory", self.memory),
            ("latency", self.latency),
            ("dispatches", self.dispatches),
        ];
        all.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or("", |(name, _)| name)
    }
}

/// How often a stage's loops run, over all of its dispatches. Rounds are those of single lanes.
#[derive(Clone, Debug, Default, PartialEq)]
struct Rounds {
    /// Workgroups of one dispatch.
    workgroups: f64,
    dispatches: f64,
    /// Of the loop that does the work.
    work: f64,
    /// Of the loops around it, from the outermost.
    around: Vec<f64>,
    /// Of loops over data beside these; `None`: one each.
    beside: Option<f64>,
    /// Loads of a round of the work that wait for each other.
    waits: f64,
    /// Loads of the whole stage that wait for each other, if one subgroup does all.
    chain: f64,
}

/// A scan goes through its counters twice.
const SCANS: f64 = 2.0;

/// Rounds over some items: each round of the loop around has a part of a round more, half of one on average.
fn rounded_up(items: f64, outer: f64) -> f64 {
    items + outer / 2.0
}

impl Rounds {
    /// Of a stage's pipeline in a picture; `None` for stages that are not modelled.
    fn of(row: &Row, cost: &Cost) -> Option<Rounds> {
        let (c, bins) = (cost.counts, cost.sharing.bin_blocks);
        let blocks = f64::from(cost.sharing.sort_blocks);
        let (passes, lanes) = (f64::from(cost.passes), f64::from(row.workgroup));
        let one = Rounds { workgroups: 1.0, dispatches: 1.0, waits: 1.0, ..Rounds::default() };
        let table = blocks * c.digits;
        let blend = |blended: f64| match form(&row.module).1 {
            None => Rounds {
                workgroups: c.tiles * TILE_PIXELS / f64::from(ROWS) / lanes,
                work: blended / f64::from(ROWS),
                waits: 2.0,
                ..one.clone()
            },
            Some(subgroup) => {
                let (subgroup, splats) = (f64::from(subgroup), f64::from(SPLATS_PER_ROUND));
                // Of each invocation.
                let pairs = blended / (TILE_PIXELS / subgroup);
                let around = vec![rounded_up(pairs / subgroup, c.tiles * subgroup)];
                let work = rounded_up(pairs / splats, c.tiles * subgroup);
                Rounds {
                    workgroups: c.tiles * subgroup / lanes,
                    work,
                    // The lists are loaded together.
                    waits: 2.0 * around[0] / work,
                    around,
                    ..one.clone()
                }
            }
        };
        Some(match row.stage.as_str() {
            "project" => {
                let (work, beside) = (rounded_up(c.splats, blocks * lanes), Some(table));
                // The splat, then its harmonics.
                Rounds { workgroups: blocks, work, beside, waits: 2.0, ..one }
            }
            "radix_count" => {
                let later = passes - 1.0;
                let (work, beside) = (later * c.visible, Some(later * table));
                Rounds { workgroups: blocks, dispatches: later, work, beside, ..one }
            }
            "radix_scatter" => {
                let keys = c.splats + (passes - 1.0) * c.visible;
                // A round moves four keys. Beside its loop, others go over the keys and over the counts of the digits,
                // four at a time.
                let (work, beside) = (keys / 4.0, Some(keys.max(passes * table) / 4.0));
                let [_, digit] = cost.sharing.digit();
                // The keys twice, and the counts.
                let waits = 2.0 + passes * table * digit / work;
                Rounds { workgroups: blocks, dispatches: passes, work, beside, waits, ..one }
            }
            "bin_scan" => {
                let (work, around) = (bins * c.tiles / 16.0, vec![c.tiles]);
                Rounds { work, around, waits: SCANS, ..one }
            }
            "bin_count" => {
                let bands = c.bands(cost.sharing);
                let splats = bands * c.visible;
                let (work, around) = (rounded_up(c.rows, splats), vec![splats]);
                let (beside, waits) = (Some(bins * c.tiles), 2.0 * splats / work);
                Rounds { workgroups: bins * bands, work, around, beside, waits, ..one }
            }
            "bin_emit" => {
                let bands = c.bands(cost.sharing);
                let splats = bands * c.visible;
                let rows = rounded_up(c.rows, splats);
                let (work, around) = (rounded_up(c.pairs, rows), vec![splats, rows]);
                let beside = Some(bins * c.tiles);
                // The places of the splats, then their records.
                let waits = 2.0 * splats / work;
                Rounds { workgroups: bins * bands, work, around, beside, waits, ..one }
            }
            // A GPU's subgroups stop when all pixels of a tile are finished.
            "splat" | "splat_colour" | "splat_flow" => blend(c.blended[0]),
            "quantize_rgb8" => Rounds { workgroups: 3.0 * c.pixels / 4.0 / lanes, ..one },
            // Eight rows of invocations add up the tiles' sums, eight at a time.
            "solve" => Rounds { chain: c.tiles / 64.0, ..one },
            _ => return None,
        })
    }

    /// Instructions of all lanes.
    fn instructions(&self, row: &Row, invocations: f64) -> anyhow::Result<Instructions> {
        let work = if row.loop_unit.is_empty() { None } else { work_loop(&row.loops) };
        let mut in_loops = Instructions::default();
        let mut sum = Instructions::default();
        for outer in &row.loops {
            in_loops = in_loops + outer.standing();
            sum = sum
                + match (work, outer.rounds) {
                    (Some(work), _) if outer.contains(work) => self.down_to(work, outer, 0)?,
                    (_, Some(rounds)) => outer.round() * (f64::from(rounds) * invocations),
                    _ => outer.round() * self.beside.unwrap_or(invocations),
                };
        }
        Ok(sum + (row.by_kind + in_loops * -1.0) * invocations)
    }

    /// Those of a loop that holds the work's loop, or is it.
    fn down_to(&self, work: &Loop, outer: &Loop, depth: usize) -> anyhow::Result<Instructions> {
        if std::ptr::eq(outer, work) {
            let known = self.around.len();
            anyhow::ensure!(depth == known, "{depth} loops around the work's, not {known}");
            return Ok(work.round() * self.work);
        }
        let rounds = self.around.get(depth).copied();
        let rounds =
            rounds.with_context(|| format!("more than {depth} loops around the work's"))?;
        let mut sum = outer.own * rounds;
        for inner in &outer.inner {
            sum = sum
                + match inner.rounds {
                    _ if inner.contains(work) => self.down_to(work, inner, depth + 1)?,
                    Some(known) => inner.round() * (f64::from(known) * rounds),
                    // A scan goes through its cells twice.
                    None => inner.round() * self.work,
                };
        }
        Ok(sum)
    }
}

/// Whether the model knows how often a pipeline's loops run.
pub fn is_modelled(row: &Row) -> bool {
    let any = Cost { counts: &Counts::default(), sharing: &Sharing::GPU, passes: 1 };
    Rounds::of(row, &any).is_some()
}

/// Subgroups that are on the device at once.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Resident {
    multiprocessors: f64,
    /// On each of them.
    subgroups: f64,
}

impl Gpu {
    /// Those of a pipeline: bounded by what a multiprocessor holds, and by what is dispatched.
    fn resident(&self, row: &Row, workgroups: f64, working: f64) -> Resident {
        let subgroups = (f64::from(row.workgroup) / LANES).ceil();
        let registers = self.registers / (f64::from(row.registers) * LANES * subgroups);
        let shared = self.shared_bytes / f64::from(row.shared_bytes.max(1));
        let fits = (self.subgroups / subgroups).min(registers).min(shared).floor();
        let multiprocessors = self.multiprocessors.min(workgroups.ceil());
        let held = fits.min(self.workgroups).max(1.0).min((workgroups / multiprocessors).ceil());
        Resident { multiprocessors, subgroups: held * working }
    }

    /// What a stage should take in a picture, by its pipeline's row; `None` for stages that are not modelled. `bytes`:
    /// bytes per second; `dispatch`: seconds.
    pub fn times(
        &self,
        row: &Row,
        cost: &Cost,
        bytes: f64,
        dispatch: f64,
    ) -> anyhow::Result<Option<Times>> {
        let Some(rounds) = Rounds::of(row, cost) else { return Ok(None) };
        let workers = f64::from(workers(&row.module).unwrap_or(row.workgroup));
        let working = (workers / LANES).ceil();
        // Lanes of a working subgroup that work.
        let lanes = workers / working;
        let invocations = rounds.workgroups * rounds.dispatches * workers;
        let all = rounds.instructions(row, invocations).with_context(|| row.module.clone())?;
        let all = all * (1.0 / lanes);
        let resident = self.resident(row, rounds.workgroups, working);
        let schedulers = self.schedulers.min(resident.subgroups);
        // A scheduler with few subgroups waits for results.
        let alone = all.alone / (resident.subgroups / schedulers);
        let cycles = all.slots().max(all.transcendental * self.transcendental).max(alone);
        let waits = rounds.work * rounds.waits + FIRST_LOADS * invocations;
        let waiting = waits / lanes * self.load + all.shared * self.shared_load;
        let at_once = resident.multiprocessors * resident.subgroups;
        Ok(Some(Times {
            issue: cycles / (resident.multiprocessors * schedulers) / self.clock,
            memory: cost.of(row.stage.trim_end_matches("_colour")).bytes / bytes,
            latency: (waiting / at_once + rounds.chain * self.load) / self.clock,
            dispatches: rounds.dispatches * dispatch,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GPU: Gpu = Gpu {
        multiprocessors: 8.0,
        schedulers: 4.0,
        clock: 1e9,
        subgroups: 48.0,
        workgroups: 16.0,
        registers: 65_536.0,
        shared_bytes: 65_536.0,
        load: 300.0,
        shared_load: 30.0,
        transcendental: 8.0,
    };

    const COUNTS: Counts = Counts {
        splats: 40_000.0,
        visible: 38_000.0,
        coefficients: 16.0,
        planes: 24.0,
        pairs: 180_000.0,
        rows: 77_000.0,
        blended: [64e6, 64e6],
        tiles: 1024.0,
        tiles_x: 32.0,
        pixels: 65_536.0,
        frame_pixels: 65_536.0,
        digits: 1024.0,
    };

    const COST: Cost = Cost { counts: &COUNTS, sharing: &Sharing::GPU, passes: 3 };

    fn a_loop(rounds: Option<u32>, vector: f64, inner: Vec<Loop>) -> Loop {
        // As if each instruction needed the result of the one before.
        let own = Instructions { vector, alone: 4.0 * vector, ..Instructions::default() };
        Loop { rounds, own, inner }
    }

    fn row(stage: &str, workgroup: u32, loops: Vec<Loop>) -> Row {
        let by_kind = loops.iter().map(Loop::standing).sum();
        Row {
            stage: stage.into(),
            module: stage.into(),
            workgroup,
            registers: 32,
            loop_unit: "unit".into(),
            by_kind,
            loops,
            ..Row::default()
        }
    }

    fn times(row: &Row) -> Times {
        GPU.times(row, &COST, 1e11, 5e-6).unwrap().unwrap()
    }

    #[test]
    fn idle_lanes_cost_as_much_as_those_that_work() {
        // 64 million pairs, four to a round of 200 instructions; 32 schedulers.
        let blending =
            |workgroup| times(&row("splat", workgroup, vec![a_loop(None, 200.0, vec![])]));
        let full = 64e6 / 4.0 / 32.0 * 200.0 / 32.0 / 1e9;
        assert!((blending(32).issue / full - 1.0).abs() < 1e-9);
        assert!((blending(16).issue / full - 2.0).abs() < 1e-9);
        assert_eq!(blending(32).bound(), "issue");
    }

    #[test]
    fn transcendental_instructions_bound_where_there_are_many() {
        let mut loops = vec![a_loop(None, 20.0, vec![])];
        let few = times(&row("splat", 32, loops.clone())).issue;
        loops[0].own.transcendental = 10.0;
        assert!((times(&row("splat", 32, loops)).issue / few - 4.0).abs() < 1e-9);
    }

    #[test]
    fn one_workgroup_has_one_multiprocessor() {
        // Columns of a table, with the work's loop and one of 256 rounds inside.
        let inner = vec![a_loop(None, 4.0, vec![]), a_loop(Some(256), 5.0, vec![])];
        let scan = row("bin_scan", 256, vec![a_loop(None, 1.0, inner)]);
        let lanes = 1024.0 * (1.0 + 5.0 * 256.0) + Sharing::GPU.bin_blocks * 1024.0 / 16.0 * 4.0;
        // Each of four schedulers has two of its eight subgroups, which wait for results half of the time.
        let expected = lanes / 32.0 / (4.0 * 0.5) / 1e9;
        assert!((times(&scan).issue / expected - 1.0).abs() < 1e-9);
        assert_eq!(times(&scan).dispatches, 5e-6);
    }

    #[test]
    fn residents_are_bounded_by_registers_workgroups_and_shared_memory() {
        let of = |workgroup, registers, shared_bytes| {
            let row = Row { registers, shared_bytes, ..row("splat", workgroup, vec![]) };
            GPU.resident(&row, 1e4, (f64::from(workgroup) / 32.0).ceil()).subgroups
        };
        assert_eq!(of(32, 32, 0), 16.0);
        assert_eq!(of(128, 32, 0), 48.0);
        assert_eq!(of(128, 128, 0), 16.0);
        assert_eq!(of(128, 32, 32_768), 8.0);
    }

    #[test]
    fn other_loops_than_the_model_knows_are_an_error() {
        let around = row("splat", 32, vec![a_loop(None, 1.0, vec![a_loop(None, 9.0, vec![])])]);
        let error = GPU.times(&around, &COST, 1e11, 5e-6).unwrap_err();
        assert!(format!("{error:#}").starts_with("splat: "), "{error:#}");
        assert!(GPU.times(&row("reduce", 32, vec![]), &COST, 1e11, 5e-6).unwrap().is_none());
    }
}
