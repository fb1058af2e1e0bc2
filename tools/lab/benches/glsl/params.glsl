// As `Params` in shaders-rs/kernels/src/shared.rs: scalars one after the other.
struct Params {
    float rotation[9];
    float translation[3];
    float centre[3];
    float focal[2];
    float principal[2];
    float frustum[4];
    float background[3];
    float near;
    float radius;
    float alpha_max;
    float dilation;
    float dilation_kept;
    uint width;
    uint height;
    uint tiles_x;
    uint tiles_y;
    uint splats;
    uint pair_capacity;
    uint frame_offset;
    uint sort_blocks;
    uint bin_blocks;
    uint tiles_per_group;
};
