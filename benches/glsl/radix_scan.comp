// Stage `radix_scan` by hand: one workgroup, an invocation a digit.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "radix.glsl"
layout(local_size_x = 256) in;
layout(std430, binding = 1) buffer B1 { uint histogram[]; };
shared uint totals[RADIX];

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint blocks = (counters[pass.keys] + RADIX_BLOCK - 1) / RADIX_BLOCK;
    uint total = 0;
    for (uint block = 0; block < blocks; block++)
        total += histogram[block * RADIX + lane];
    totals[lane] = total;
    barrier();
    for (uint step = 1; step < RADIX; step *= 2) {
        uint before = lane >= step ? totals[lane - step] : 0;
        barrier();
        totals[lane] += before;
        barrier();
    }
    uint before = totals[lane] - total;
    for (uint block = 0; block < blocks; block++) {
        uint here = histogram[block * RADIX + lane];
        histogram[block * RADIX + lane] = before;
        before += here;
    }
}
