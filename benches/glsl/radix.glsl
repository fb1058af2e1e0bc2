// Constants of the radix sort, as in shaders-rs/src/shared.rs and radix.rs.
const uint RADIX = 256;
const uint RADIX_BLOCK = 4096;
const uint SCATTER_THREADS = 32;

layout(push_constant) uniform Pass {
    uint keys;
    uint shift;
} pass;

layout(std430, binding = 0) readonly buffer B0 { uint counters[]; };

uint digit(uint key) {
    return (key >> pass.shift) & (RADIX - 1);
}
