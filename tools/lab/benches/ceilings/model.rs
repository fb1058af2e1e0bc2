//! What each stage reads, writes and calculates, by formula, and how long that should take on a device
//! of which little is known: docs/latency.md says where the numbers come from.

/// What a render at one pose comes to.
pub struct Counts {
    pub splats: f64,
    pub visible: f64,
    /// Coefficients of the spherical harmonics, for each channel.
    pub coefficients: f64,
    /// Splats times the tiles that they touch.
    pub pairs: f64,
    /// Splats times the rows of tiles that they touch.
    pub rows: f64,
    /// Splats times pixels that are blended, of a picture and of an evaluation.
    pub blended: [f64; 2],
    pub tiles: f64,
    pub pixels: f64,
    /// Values of a digit.
    pub digits: f64,
}

/// A device as the model sees it.
pub struct Machine {
    pub name: &'static str,
    /// Floating-point operations a second; a multiply-add is two.
    pub flops: f64,
    /// Bytes a second.
    pub bytes: f64,
    /// Seconds from a load to its value; 0 where loads do not overlap anyway.
    pub latency: f64,
    /// Seconds of a dispatch with its barrier.
    pub dispatch: f64,
    /// Workgroups that share the splats.
    pub blocks: f64,
    /// Invocations of the scans' workgroups.
    pub scan_lanes: f64,
    /// Pixels that an invocation of the blending stages draws of a splat that it has loaded, in a
    /// picture and in an evaluation.
    pub column: [f64; 2],
}

/// Some stages together.
pub struct Work {
    /// Name of a stage, or what the names of several begin with.
    pub name: &'static str,
    pub bytes: f64,
    pub operations: f64,
    /// Loads that wait for each other.
    pub chain: f64,
    pub dispatches: f64,
}

impl Work {
    /// Whether a stage of that name is one of these.
    pub fn holds(&self, stage: &str) -> bool {
        let several = ["radix", "bin"].contains(&self.name);
        stage == self.name || several && stage.starts_with(self.name)
    }

    /// Seconds: whichever of bytes, operations and waiting takes longest, and the dispatches.
    pub fn seconds(&self, on: &Machine) -> f64 {
        let bound = (self.bytes / on.bytes).max(self.operations / on.flops);
        bound.max(self.chain * on.latency) + self.dispatches * on.dispatch
    }
}

/// Operations of a splat at a pixel, in a picture and in an evaluation: see `PICTURE_FLOPS`.
type Flops = [f64; 2];

/// The stages of a render: with a sort of so many passes; an evaluation or else a picture.
pub fn stages(c: &Counts, on: &Machine, passes: f64, evaluation: bool, flops: Flops) -> Vec<Work> {
    let kind = usize::from(evaluation);
    let Counts { splats, visible, pairs, tiles, .. } = *c;
    let cells = [on.blocks * c.digits, on.blocks * tiles];
    // A scan goes down the blocks twice, four loads at a time, for each column of its lanes.
    let scan = |columns: f64| (columns / on.scan_lanes).ceil() * 2.0 * on.blocks / 4.0;
    // Seven pairs of floats and a key; harmonics in threes of pairs; a record of 48 bytes.
    let harmonics = 24.0 * (c.coefficients / 2.0).ceil();
    let project = Work {
        name: "project",
        bytes: splats * (56.0 + 4.0) + visible * (harmonics + 48.0),
        operations: splats * 200.0 + visible * (60.0 + 6.0 * c.coefficients),
        chain: 4.0,
        dispatches: 2.0,
    };
    // Keys twice, keys and values out; values in but in the first pass; no keys out of the last.
    let sorted = 4.0 * (2.0 * splats + visible * (5.0 * passes - 4.0));
    let sort = Work {
        name: "radix",
        bytes: sorted + passes * cells[0] * 20.0,
        operations: passes * visible * 60.0,
        chain: passes * (scan(c.digits) + 2.0 * visible / (on.blocks * 32.0)),
        dispatches: 3.0 * passes,
    };
    // Order and 24 bytes of the record, twice; a place's end and its splat; the table of starts, once
    // counted, three times scanned, twice asked.
    let lists = Work {
        name: "bin",
        bytes: visible * 56.0 + pairs * 8.0 + cells[1] * 24.0 + tiles * 8.0,
        operations: 2.0 * (visible * 40.0 + c.rows * 45.0 + pairs * 30.0),
        chain: scan(tiles) + 4.0 * visible / (on.blocks * 32.0),
        dispatches: 3.0,
    };
    let blended = c.blended[kind];
    let entries = blended / 64.0;
    let blend = Work {
        name: if evaluation { "splat_flow" } else { "splat" },
        // A place and its record; pixels of 20 bytes, or the frame's 12 and a row of sums a tile.
        bytes: entries * 52.0
            + if evaluation { c.pixels * 12.0 + tiles * 112.0 } else { c.pixels * 20.0 },
        // Two dozen more for each column; the pixel's share of the normal equations.
        operations: blended * (flops[kind] + 24.0 / on.column[kind])
            + if evaluation { c.pixels * 3.0 * 90.0 } else { 0.0 },
        chain: 2.0,
        dispatches: 1.0,
    };
    let mut all = vec![project, sort, lists, blend];
    if evaluation {
        let (bytes, operations) = (tiles * 112.0, tiles * 28.0);
        // Eight invocations a sum.
        all.push(Work { name: "reduce", bytes, operations, chain: tiles / 8.0, dispatches: 1.0 });
    }
    all
}
