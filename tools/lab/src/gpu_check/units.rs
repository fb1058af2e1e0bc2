//! What a round of each module's work loop does, and which of its invocations work. The rest of the report follows from
//! the compiled code alone; this is counted from the sources. A module that is not listed has rounds for units.

use nvsprior_kernels::shared::{ROWS, TILE};

/// The unit of work of a module's loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    pub name: &'static str,
    /// Units that an invocation does in a round.
    pub per_round: u32,
}

const PIXELS: Unit = pixels(ROWS);
const KEY: Unit = Unit { name: "key", per_round: 1 };
const PAIR: Unit = Unit { name: "pair of splat and tile", per_round: 1 };
/// The forms for waves move four keys at a time.
const KEYS: Unit = Unit { per_round: 4, ..KEY };
/// The scan loads four counters at a time.
const COUNTER: Unit = Unit { name: "counter", per_round: 16 };
const SPLAT: Unit = Unit { name: "splat", per_round: 1 };
const ROW: Unit = Unit { name: "row of tiles of a splat", per_round: 1 };
/// A tile's share of a sum, eight at a time.
const SUM: Unit = Unit { name: "sum of a tile", per_round: 8 };
const FRAME_PIXEL: Unit = Unit { name: "pixel of the frame", per_round: 1 };
const ROUND: Unit = Unit { name: "round", per_round: 1 };

const fn pixels(per_round: u32) -> Unit {
    Unit { name: "pair of splat and pixel", per_round }
}

/// Splats that the forms for waves blend in a round: `LOOK` of `shaders-rs/stages/src/blend.rs`.
pub const SPLATS_PER_ROUND: u32 = 4;

/// Rounds of the loops in which a module ranks a subgroup's invocations, one for each bit of a number: those of the
/// reef's digits, and one for no digit. Tiles of a band take fewer.
pub fn ranking_rounds(module: &str) -> Option<u32> {
    matches!(form(module), ("radix_scatter" | "bin_emit", Some(_))).then_some(11)
}

/// A module's name without its form, and the subgroup size if it is a form for waves.
pub fn form(module: &str) -> (&str, Option<u32>) {
    match module.rsplit_once("_wave") {
        Some((name, size)) => (name, size.parse().ok()),
        None => (module, None),
    }
}

/// The unit of the work loop of a module; `None` if loops are the least of its work.
pub fn unit(module: &str) -> Option<Unit> {
    let (module, wave) = form(module);
    Some(match module {
        "splat" | "splat_flow" if wave.is_some() => {
            pixels(wave.map_or(0, |size| TILE * TILE / size * SPLATS_PER_ROUND))
        }
        "project" => SPLAT,
        "splat" | "splat_flow" | "splat_exact" | "splat_backward" => PIXELS,
        "radix_count" => KEY,
        "radix_scatter" if wave.is_some() => KEYS,
        "radix_scatter" => KEY,
        "bin_scan" => COUNTER,
        "bin_count" => ROW,
        "bin_emit" => PAIR,
        "reduce" => SUM,
        "pyramid" => FRAME_PIXEL,
        "solve" | "pose_jacobian" => return None,
        _ => ROUND,
    })
}

/// The invocations of a workgroup that do most of a module's instructions, if these are not all.
pub fn workers(module: &str) -> Option<u32> {
    match module {
        // The sums take a loop of all, the step that follows some 2,500 instructions of one.
        "solve" => Some(1),
        _ => None,
    }
}

/// A module with idle lanes that the check lets pass.
#[derive(Clone, Copy, Debug)]
pub struct Idle {
    pub module: &'static str,
    /// Sizes of the subgroups in which lanes are idle.
    pub subgroups: &'static [u32],
    pub reason: &'static str,
}

const fn idle(module: &'static str, subgroups: &'static [u32], reason: &'static str) -> Idle {
    Idle { module, subgroups, reason }
}

const STEP: &str = "one invocation's work, once per evaluation";
const TILE_OF_16: &str =
    "16 invocations draw a tile; a form with full subgroups is not written yet";
const SSIM: &str = "training only: a workgroup of 8; a form with full subgroups is not written yet";

/// All of them. One that has no idle lanes any more fails the check.
pub const IDLE: &[Idle] = &[
    idle("solve", &[32, 64], STEP),
    idle("splat_exact", &[32, 64], TILE_OF_16),
    idle("splat_backward", &[32, 64], TILE_OF_16),
    idle("ssim_rows", &[32, 64], SSIM),
    idle("ssim_columns", &[32, 64], SSIM),
    idle("ssim_back", &[32, 64], SSIM),
    idle("ssim_gradient", &[32, 64], SSIM),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_those_of_the_sources() {
        let blend = include_str!("../../../../shaders-rs/stages/src/blend.rs");
        assert!(blend.contains(&format!("const LOOK: u32 = {SPLATS_PER_ROUND};")));
        let pixels = |module| unit(module).map(|unit| unit.per_round);
        assert_eq!(pixels("splat"), Some(4));
        assert_eq!(pixels("splat_flow_wave32"), Some(8));
        assert_eq!(pixels("splat_wave64"), Some(4));
        assert_eq!(unit("bin_scan_wave16"), unit("bin_scan"));
        assert_eq!(unit("solve"), None);
    }
}
