//! The commands that a frame's submission has the device do.

use nvsprior::render::SearchCommands;
use nvsprior::vulkan::CommandCounts;
use serde::Serialize;

/// Numbers of commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    pub dispatches: u32,
    pub fills: u32,
    pub copies: u32,
    pub barriers: u32,
}

impl Counts {
    fn of(counts: CommandCounts) -> Counts {
        let CommandCounts { dispatches, fills, copies, barriers } = counts;
        Counts { dispatches, fills, copies, barriers }
    }
}

/// The commands of a frame that is found by one evaluation.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct FrameCommands {
    /// Those that do something.
    pub run: Counts,
    /// Those of the evaluations that there is room for beyond the one.
    pub unused: Counts,
}

impl FrameCommands {
    pub fn of(search: &SearchCommands) -> FrameCommands {
        let SearchCommands { all, slot, slots } = *search;
        let mut run = all;
        (1..slots).for_each(|_| run = run.since(slot));
        FrameCommands { run: Counts::of(run), unused: Counts::of(all.since(run)) }
    }
}
