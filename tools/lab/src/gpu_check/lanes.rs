//! Which invocations of a module's workgroup work, counted from the sources, and the idle lanes that are known. The
//! rest of the report follows from the compiled code alone.

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
