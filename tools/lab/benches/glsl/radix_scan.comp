// Stage `radix_scan` for subgroups of eight, by hand: one workgroup.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "radix.glsl"

layout(local_size_x = 8) in;
layout(std430, binding = 0) buffer B0 { Counters counters; };
layout(std430, binding = 1) buffer B1 { uint histogram[]; };

// Adds to the sum over the `reach` lanes up to this one the sum over the `reach` lanes before them.
uint widen(uint sum, uint lane, uint reach) {
    uint other = subgroupShuffle(sum, (lane - reach) & (LANES - 1));
    return sum + (lane >= reach ? other : 0);
}

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint digits = 1 << digit_bits(counters);
    uint end = digits << pass.log_blocks;
    uint before = 0;
    for (uint d = lane; d < digits; d += LANES) {
        uint sum = 0;
        for (uint cell = d; cell < end; cell += digits)
            sum += histogram[cell];
        uint upto = widen(widen(widen(sum, lane, 1), lane, 2), lane, 4);
        uint next = before + upto - sum;
        for (uint cell = d; cell < end; cell += digits) {
            uint here = histogram[cell];
            histogram[cell] = next;
            next += here;
        }
        before += subgroupBroadcast(upto, LANES - 1);
    }
    if (lane == 0)
        counters.visible = before;
}
