// Stage `radix_count` for subgroups of eight, by hand.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "radix.glsl"

layout(local_size_x = 8) in;
layout(std430, binding = 0) readonly buffer B0 { Counters counters; };
layout(std430, binding = 1) readonly buffer B1 { uint keys[]; };
layout(std430, binding = 2) writeonly buffer B2 { uint histogram[]; };
shared uint bins[TABLE];

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint bits = counters.digit_bits;
    uint shift = bits * pass.digit;
    uint digits = 1 << bits;
    uvec2 range = block(counters, gl_WorkGroupID.x);
    for (uint d = lane; d < digits; d += LANES)
        bins[d] = 0;
    for (uint start = range.x; start < range.y; start += LANES) {
        uint place = start + lane;
        uint key = place < range.y ? keys[place] : CULLED;
        uint d = (key >> shift) & (digits - 1);
        uint before = rank(key != CULLED ? d : TABLE, lane);
        if (key != CULLED)
            bins[d] += before + 1;
    }
    for (uint d = lane; d < digits; d += LANES)
        histogram[gl_WorkGroupID.x * digits + d] = bins[d];
}
