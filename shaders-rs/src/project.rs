//! Stage `project`: each splat's mean, conic, colour and depth as the camera sees it, and the number
//! of tiles it touches.

use crate::shared::{self, Params};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// Position, opacity and the scaled axes turned into camera coordinates.
pub struct Splat {
    pub world: [f32; 3],
    pub camera: [f32; 3],
    pub opacity: f32,
    pub axes: [[f32; 3]; 3],
}

/// Reads splat `i` from its planes.
pub fn load(params: &Params, geometry: &[f32], i: usize) -> Splat {
    let n = params.splats as usize;
    let at = |plane: usize| geometry[plane * n + i];
    let world = [at(0), at(1), at(2)];
    let turned = shared::transform(&params.rotation, world);
    let camera = [
        turned[0] + params.translation[0],
        turned[1] + params.translation[1],
        turned[2] + params.translation[2],
    ];
    let axes = [
        shared::transform(&params.rotation, [at(4), at(5), at(6)]),
        shared::transform(&params.rotation, [at(7), at(8), at(9)]),
        shared::transform(&params.rotation, [at(10), at(11), at(12)]),
    ];
    Splat { world, camera, opacity: at(3), axes }
}

/// Colour from spherical harmonics, + 0.5, not below 0.
fn colour(params: &Params, sh: &[f32], i: usize, world: [f32; 3]) -> [f32; 3] {
    let n = params.splats as usize;
    let (d, _) = shared::direction(params, world);
    let basis = shared::sh_basis(d);
    let mut rgb = [0.5, 0.5, 0.5];
    let count = shared::sh_coefficients(params.sh_degree) as usize;
    let mut k = 0;
    while k < count {
        let b = basis[k];
        rgb[0] += b * sh[(k * 3) * n + i];
        rgb[1] += b * sh[(k * 3 + 1) * n + i];
        rgb[2] += b * sh[(k * 3 + 2) * n + i];
        k += 1;
    }
    [shared::max(rgb[0], 0.0), shared::max(rgb[1], 0.0), shared::max(rgb[2], 0.0)]
}

/// One invocation a splat.
#[spirv(compute(threads(256)))]
pub fn project(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] geometry: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] sh: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &mut [Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] tile_counts: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] keys: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] indices: &mut [u32],
) {
    let i = id.x as usize;
    if id.x >= params.splats {
        return;
    }
    let splat = load(params, geometry, i);
    let s = shared::project(params, splat.camera, &splat.axes, splat.opacity);
    let mut tiles = 0;
    if s.opacity > 0.0 {
        let [x0, y0, x1, y1] = shared::tile_box(params, &s);
        let mut y = y0;
        while y < y1 {
            let mut x = x0;
            while x < x1 {
                tiles += shared::touches_tile(s.mean, s.conic, s.opacity, [x, y]) as u32;
                x += 1;
            }
            y += 1;
        }
    }
    let mut key = shared::CULLED;
    if tiles > 0 {
        key = s.depth.to_bits();
        let [r, g, b] = colour(params, sh, i, splat.world);
        let at = i * shared::RECORD as usize;
        records[at] = Vec4::new(s.mean[0], s.mean[1], s.conic[0], s.conic[1]);
        records[at + 1] = Vec4::new(s.conic[2], s.opacity, s.sigma[0], s.sigma[1]);
        records[at + 2] = Vec4::new(r, g, b, s.depth);
    }
    tile_counts[i] = tiles;
    keys[i] = key;
    indices[i] = id.x;
}
