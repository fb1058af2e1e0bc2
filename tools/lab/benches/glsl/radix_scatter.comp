// Stage `radix_scatter` for subgroups of eight, by hand.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "radix.glsl"

layout(local_size_x = 8) in;
layout(std430, binding = 0) buffer B0 { Counters counters; };
layout(std430, binding = 1) readonly buffer B1 { uint histogram[]; };
layout(std430, binding = 2) readonly buffer B2 { uint keys[]; };
layout(std430, binding = 3) readonly buffer B3 { uint values[]; };
layout(std430, binding = 4) writeonly buffer B4 { uint keys_out[]; };
layout(std430, binding = 5) writeonly buffer B5 { uint values_out[]; };
shared uint next[TABLE];

// Adds to the sum over the `reach` lanes up to this one the sum over the `reach` lanes before them.
uint widen(uint sum, uint lane, uint reach) {
    uint other = subgroupShuffle(sum, (lane - reach) & (LANES - 1));
    return sum + (lane >= reach ? other : 0);
}

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint bits = counters.digit_bits;
    uint shift = bits * pass.digit;
    uint digits = 1 << bits;
    uvec2 range = block(counters, gl_WorkGroupID.x);
    uint blocks = 1 << pass.log_blocks;
    uint all_before = 0;
    for (uint d = lane; d < digits; d += LANES) {
        uint before = 0;
        uint all = 0;
        for (uint block = 0; block < blocks; block++) {
            uint here = histogram[block * digits + d];
            before += block < gl_WorkGroupID.x ? here : 0;
            all += here;
        }
        uint upto = widen(widen(widen(all, lane, 1), lane, 2), lane, 4);
        next[d] = all_before + upto - all + before;
        all_before += subgroupBroadcast(upto, LANES - 1);
    }
    if (pass.first == 1 && gl_WorkGroupID.x == 0 && lane == 0)
        counters.visible = all_before;
    for (uint start = range.x; start < range.y; start += LANES) {
        uint place = start + lane;
        uint key = CULLED;
        uint value = place;
        if (place < range.y) {
            key = keys[place];
            if (pass.first == 0)
                value = values[place];
        }
        bool kept = key != CULLED;
        uint d = (key >> shift) & (digits - 1);
        uint to = next[d] + rank(kept ? d : TABLE, lane);
        if (kept) {
            next[d] = to + 1;
            if (pass.digit + 1 < DIGITS)
                keys_out[to] = key;
            values_out[to] = value;
        }
    }
}
