//! Stage `solve`: sums an evaluation's normal equations and takes the search for the pose one step further. It decides
//! what comes next and at which level, or that the pose is found. One workgroup; after the sums one invocation does all
//! the work.

use crate::reduce::{self, Columns};
use crate::search::{self, Anchor, FOUND, PoseCode, Search};
use crate::shared::{Counters, Groups, Params, SUMS};
use spirv_std::arch::control_barrier;
use spirv_std::memory::{Scope, Semantics};
use spirv_std::spirv;

/// The pose that is drawn, as its packet holds it, and the frame that it is relative to.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Coded {
    pub anchor: Anchor,
    pub code: PoseCode,
}

/// The host takes the first step, to the first evaluation. `groups[0]`: stages of an evaluation; `groups[1]`: those of
/// the final picture.
#[spirv(compute(threads(256)))]
pub fn solve(
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Columns,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] levels: &[Params],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] s: &mut Search,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] partials: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] params: &mut Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] groups: &mut [Groups],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &Counters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] coded: &mut Coded,
) {
    reduce::total(lane, params.tiles_x * params.tiles_y, partials, scratch);
    // All have read the parameters before one changes them.
    const SCOPE: u32 = Scope::Workgroup as u32;
    const SEMANTICS: u32 = Semantics::ACQUIRE_RELEASE.bits() | Semantics::UNIFORM_MEMORY.bits();
    control_barrier::<SCOPE, SCOPE, SEMANTICS>();
    if lane != 0 {
        return;
    }
    let mut k = 0;
    while k < SUMS as usize {
        s.sums[k] = scratch[k];
        k += 1;
    }
    if counters.pairs_needed > s.pairs_needed {
        s.pairs_needed = counters.pairs_needed;
    }
    search::advance(s);
    if s.phase == FOUND {
        coded.code = search::quantised(&s.found, &coded.anchor, s.program.profile);
        // The whole picture; stage `project` places its camera.
        *params = levels[0];
        groups[0] = Groups::NONE;
        groups[1] = Groups::of(&levels[0]);
    } else {
        let mut next = levels[search::prototype(s.level, s.program.sparse)];
        search::set_pose(&mut next, &s.trial);
        *params = next;
        groups[0] = Groups::of(&next);
        groups[1] = Groups::NONE;
    }
}
