// Stage `radix_scatter` for subgroups of eight, by hand.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "radix.glsl"

layout(local_size_x = 8) in;
layout(std430, binding = 0) readonly buffer B0 { Counters counters; };
layout(std430, binding = 1) readonly buffer B1 { uint histogram[]; };
layout(std430, binding = 2) readonly buffer B2 { uint keys[]; };
layout(std430, binding = 3) readonly buffer B3 { uint values[]; };
layout(std430, binding = 4) writeonly buffer B4 { uint keys_out[]; };
layout(std430, binding = 5) writeonly buffer B5 { uint values_out[]; };
shared uint next[TABLE];

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint bits = digit_bits(counters);
    uint shift = bits * pass.digit;
    uint digits = 1 << bits;
    uvec2 range = block(counters, gl_WorkGroupID.x);
    for (uint d = lane; d < digits; d += LANES)
        next[d] = histogram[gl_WorkGroupID.x * digits + d];
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
