//! Stage `train_slots`: gives each splat in view that is trained one slot per tile that it may touch. Stage
//! `splat_backward` notes there which pair the tile and the splat are; so stage `train_step` finds a splat's pairs in a
//! fixed order. It also lists these splats, since only they take a step: on the reef a picture shows two of five.

use crate::memory::{at, at_mut};
use crate::shared::{CULLED, GROUP, NOWHERE, Outline, Params, Projected, RECORD};
use crate::training::{NO_PAIR, SlotCounters, Training, slot_box};
use spirv_std::arch::atomic_i_add;
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::memory::{Scope, Semantics};
use spirv_std::spirv;

/// What stage `project` wrote of a splat.
pub fn load(records: &[Vec4], i: u32) -> Projected {
    let (a, b) = (at::<Vec4, _>(records, i * RECORD), at::<Vec4, _>(records, i * RECORD + 1));
    Projected {
        mean: [a.x, a.y],
        conic: [a.z, a.w, b.x],
        log_opacity: b.y,
        sigma: [b.z, b.w],
        depth: 1.0,
    }
}

fn add(counter: &mut u32, value: u32) -> u32 {
    // SAFETY: an atomic on a word of a storage buffer. Which splat has which slots, and which place in the
    // list, is of no account.
    unsafe {
        const SCOPE: u32 = Scope::QueueFamily as u32;
        atomic_i_add::<u32, SCOPE, { Semantics::NONE.bits() }>(counter, value)
    }
}

/// One invocation per splat that is trained.
#[spirv(compute(threads(256)))]
pub fn train_slots(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] keys: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] starts: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] seen: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] counters: &mut SlotCounters,
) {
    const _: () = assert!(GROUP == 256);
    if id.x >= training.in_use {
        return;
    }
    let i = training.first_trained + id.x;
    let mut start = NO_PAIR;
    if at::<u32, _>(keys, i) != CULLED {
        let splat = load(records, i);
        let [x0, y0, x1, y1] = slot_box(params, &Outline::new(params, &splat));
        if (splat.log_opacity > NOWHERE) & (x0 < x1) & (y0 < y1) {
            let area = (x1 - x0) * (y1 - y0);
            let first = add(&mut counters.slots, area);
            add(&mut counters.blocks, area / 256);
            let fits = (first < training.slot_capacity) & (area <= training.slot_capacity - first);
            start = if fits { first } else { NO_PAIR };
            let place = add(&mut counters.seen, 1);
            *at_mut(seen, place) = id.x;
            add(&mut counters.groups[0], if place % GROUP == 0 { 1 } else { 0 });
        }
    }
    *at_mut(starts, i) = start;
    if id.x == 0 {
        counters.groups[1] = 1;
        counters.groups[2] = 1;
    }
}
