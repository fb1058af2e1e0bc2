// What the stages of the radix sort share, as in `shared.rs`, `radix.rs` and `lanes.rs` below shaders-rs.
const uint DIGITS = 3;
const uint TABLE = 2048;
const uint CULLED = 0xffffffff;
const uint LANES = 8;
const uint SORT_STEP = 128;

layout(push_constant) uniform Pass {
    uint digit;
    uint first;
    uint log_blocks;
    uint keys;
} pass;

struct Counters {
    uint pairs_needed;
    uint visible;
    uint digit_bits;
};

// Keys [x, y) of a workgroup.
uvec2 block(Counters counters, uint group) {
    uint count = pass.first == 1 ? pass.keys : counters.visible;
    uint each = ((count >> pass.log_blocks) / SORT_STEP + 1) * SORT_STEP;
    return min(uvec2(group, group + 1) * each, uvec2(count));
}

// How many lanes before this one hold the same value. Lanes store in their order: the last one's value remains.
uint rank(uint value, uint lane) {
    uint before = 0;
    [[unroll]] for (uint other = 0; other < LANES - 1; other++)
        before += uint(subgroupBroadcast(value, other) == value && other < lane);
    return before;
}
