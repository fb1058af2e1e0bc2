// Stage `radix_count` by hand.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "radix.glsl"
layout(local_size_x = 256) in;
layout(std430, binding = 1) readonly buffer B1 { uint keys[]; };
layout(std430, binding = 2) writeonly buffer B2 { uint histogram[]; };
shared uint bins[RADIX];

void main() {
    uint lane = gl_LocalInvocationIndex;
    bins[lane] = 0;
    barrier();
    uint end = min((gl_WorkGroupID.x + 1) * RADIX_BLOCK, counters[pass.keys]);
    for (uint at = gl_WorkGroupID.x * RADIX_BLOCK + lane; at < end; at += RADIX)
        atomicAdd(bins[digit(keys[at])], 1);
    barrier();
    histogram[gl_WorkGroupID.x * RADIX + lane] = bins[lane];
}
