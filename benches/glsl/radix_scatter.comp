// Stage `radix_scatter` by hand: each invocation ranks a contiguous run of the block.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "radix.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer B1 { uint histogram[]; };
layout(std430, binding = 2) readonly buffer B2 { uint keys[]; };
layout(std430, binding = 3) readonly buffer B3 { uint values[]; };
layout(std430, binding = 4) writeonly buffer B4 { uint keys_out[]; };
layout(std430, binding = 5) writeonly buffer B5 { uint values_out[]; };

const uint RUN = RADIX_BLOCK / SCATTER_THREADS;
const uint WORDS = RADIX / 2;
// Two counters of 16 bits to a word.
shared uint table[WORDS * SCATTER_THREADS];

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint first = gl_WorkGroupID.x * RADIX_BLOCK + lane * RUN;
    uint end = min(first + RUN, counters[pass.keys]);
    for (uint word = 0; word < WORDS; word++)
        table[word * SCATTER_THREADS + lane] = 0;
    barrier();
    for (uint at = first; at < end; at++) {
        uint d = digit(keys[at]);
        table[(d / 2) * SCATTER_THREADS + lane] += 1 << (16 * (d % 2));
    }
    barrier();
    for (uint word = lane; word < WORDS; word += SCATTER_THREADS) {
        uint before = 0;
        for (uint other = 0; other < SCATTER_THREADS; other++) {
            uint here = table[word * SCATTER_THREADS + other];
            table[word * SCATTER_THREADS + other] = before;
            before += here;
        }
    }
    barrier();
    for (uint at = first; at < end; at++) {
        uint key = keys[at];
        uint d = digit(key);
        uint slot = (d / 2) * SCATTER_THREADS + lane;
        uint rank = (table[slot] >> (16 * (d % 2))) & 0xffff;
        table[slot] += 1 << (16 * (d % 2));
        uint to = histogram[gl_WorkGroupID.x * RADIX + d] + rank;
        keys_out[to] = key;
        values_out[to] = values[at];
    }
}
