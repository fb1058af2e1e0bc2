// Stage `splat` for subgroups of eight, by hand: shaders-rs/stages/src/splat.rs is measured against it.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "params.glsl"

layout(local_size_x = 8) in;
layout(std430, binding = 0) readonly buffer B0 { Params params; };
layout(std430, binding = 1) readonly buffer B1 { uvec2 ranges[]; };
layout(std430, binding = 2) readonly buffer B2 { uint pair_splats[]; };
layout(std430, binding = 3) readonly buffer B3 { vec4 records[]; };
layout(std430, binding = 4) writeonly buffer B4 { float picture[]; };

// As in shaders-rs/kernels/src/portable.rs and shared.rs.
const float POWER_SCALE = 0.01499177;
const float POWER_SHIFT = 0.7220327;
const float POWER_SUM = 0.47866673;
const float FACTOR = 0.10399171; // sqrt(0.5 log2 e POWER_SCALE)
const float CUT = POWER_SHIFT + POWER_SCALE * -7.9943534; // log2(1/255)
const float STOP = 1e-4;

// Four rows of a column.
struct Four {
    vec4 r, g, b, depth, t;
};

void blend(inout Four p, vec4 y, float level, float curve, float slope, vec4 colour) {
    vec4 argument = vec4(level) + y * (slope - y * curve);
    vec4 alpha = argument * argument + POWER_SUM;
    alpha *= alpha;
    alpha *= alpha;
    alpha *= alpha;
    alpha *= alpha;
    alpha *= alpha;
    alpha = min(alpha, vec4(params.alpha_max));
    alpha = mix(vec4(0.0), alpha, greaterThanEqual(argument, vec4(CUT)));
    alpha = mix(vec4(0.0), alpha, greaterThan(p.t, vec4(STOP)));
    vec4 weight = alpha * p.t;
    p.t -= weight;
    p.r += weight * colour.r;
    p.g += weight * colour.g;
    p.b += weight * colour.b;
    p.depth += weight * colour.a;
}

float largest(vec4 v) {
    return max(max(v.x, v.y), max(v.z, v.w));
}

void store(uvec2 pixel, float r, float g, float b, float depth, float t) {
    if (pixel.x < params.width && pixel.y < params.height) {
        uint at = (pixel.y * params.width + pixel.x) * 5;
        picture[at] = r + t * params.background[0];
        picture[at + 1] = g + t * params.background[1];
        picture[at + 2] = b + t * params.background[2];
        picture[at + 3] = depth;
        picture[at + 4] = t;
    }
}

void store_four(uvec2 pixel, Four p) {
    store(pixel, p.r.x, p.g.x, p.b.x, p.depth.x, p.t.x);
    store(pixel + uvec2(0, 1), p.r.y, p.g.y, p.b.y, p.depth.y, p.t.y);
    store(pixel + uvec2(0, 2), p.r.z, p.g.z, p.b.z, p.depth.z, p.t.z);
    store(pixel + uvec2(0, 3), p.r.w, p.g.w, p.b.w, p.depth.w, p.t.w);
}

void main() {
    uint lane = gl_SubgroupInvocationID;
    uvec2 tile = gl_WorkGroupID.xy;
    uvec2 range = ranges[tile.y * params.tiles_x + tile.x];
    vec2 middle = vec2(tile * 8u + 4u);
    float x = float(lane) - 3.5;
    Four upper = Four(vec4(0), vec4(0), vec4(0), vec4(0), vec4(1));
    Four lower = upper;
    for (uint at = range.x; at < range.y; at += 8) {
        uint place = min(at + lane, range.y - 1);
        uint i = pair_splats[place] * 3;
        vec4 a = records[i];
        vec4 b = records[i + 1];
        vec4 colour = records[i + 2];
        vec2 d = a.xy - middle;
        vec3 l = vec3(a.zw, b.x) * FACTOR;
        float u = l.x * d.x + l.y * d.y;
        float w = l.z * d.y;
        float level = POWER_SHIFT + POWER_SCALE * (at + lane < range.y ? b.y : -1000.0) - w * w;
        float down = (l.z + l.z) * w;
        float tilt = l.y + l.y;
        float curve = l.y * l.y + l.z * l.z;
        [[unroll]] for (uint j = 0; j < 8; j++) {
            float u_j = subgroupShuffle(u, j) - subgroupShuffle(l.x, j) * x;
            float level_j = subgroupShuffle(level, j) - u_j * u_j;
            float slope_j = subgroupShuffle(tilt, j) * u_j + subgroupShuffle(down, j);
            float curve_j = subgroupShuffle(curve, j);
            vec4 colour_j = vec4(subgroupShuffle(colour.r, j), subgroupShuffle(colour.g, j),
                                 subgroupShuffle(colour.b, j), subgroupShuffle(colour.a, j));
            blend(upper, vec4(-3.5, -2.5, -1.5, -0.5), level_j, curve_j, slope_j, colour_j);
            blend(lower, vec4(0.5, 1.5, 2.5, 3.5), level_j, curve_j, slope_j, colour_j);
        }
        float left = max(largest(upper.t), largest(lower.t));
        left = max(left, subgroupShuffle(left, lane ^ 1));
        left = max(left, subgroupShuffle(left, lane ^ 2));
        left = max(left, subgroupShuffle(left, lane ^ 4));
        if (left <= STOP)
            break;
    }
    uvec2 pixel = tile * 8u + uvec2(lane, 0);
    store_four(pixel, upper);
    store_four(pixel + uvec2(0, 4), lower);
}
