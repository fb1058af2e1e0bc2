//! Splats as planes, and back.

use glam::DVec3;

use crate::trainer::UNUSED;
use nvsprior::prior::Splats;
use nvsprior_kernels::shared::sh_coefficients;
use nvsprior_kernels::training::{LOG_SCALE, OPACITY, POSITION, ROTATION, SH, planes};

use super::MapOptions;

/// Planes of one float per splat; a view of one splat's numbers.
pub struct Planes<'a> {
    pub numbers: &'a mut [f32],
    pub splats: usize,
}

impl Planes<'_> {
    /// The number of a splat in a plane.
    pub fn at(&mut self, plane: u32, splat: usize) -> &mut f32 {
        &mut self.numbers[plane as usize * self.splats + splat]
    }

    pub fn copy(&mut self, from: usize, to: usize) {
        for plane in self.numbers.chunks_exact_mut(self.splats) {
            plane[to] = plane[from];
        }
    }

    /// Sets all numbers of a splat to zero.
    pub fn clear(&mut self, splat: usize) {
        for plane in self.numbers.chunks_exact_mut(self.splats) {
            plane[splat] = 0.0;
        }
    }
}

pub fn to_planes(splats: &Splats, centre: DVec3) -> Vec<f32> {
    to_roomy_planes(splats, centre, splats.len())
}

/// Planes with room for `n` splats, at least those that there are.
pub fn to_roomy_planes(splats: &Splats, centre: DVec3, n: usize) -> Vec<f32> {
    let stride = splats.sh_stride();
    let mut numbers = vec![0.0; n * planes(splats.sh_degree) as usize];
    let mut planes = Planes { numbers: &mut numbers, splats: n };
    for i in splats.len()..n {
        *planes.at(OPACITY, i) = UNUSED;
        *planes.at(ROTATION, i) = 1.0;
    }
    let mut set = |first: u32, i: usize, values: &[f32]| {
        (first..).zip(values).for_each(|(plane, value)| *planes.at(plane, i) = *value);
    };
    for i in 0..splats.len() {
        let position = DVec3::from(splats.positions[i].map(f64::from)) - centre;
        set(POSITION, i, &position.as_vec3().to_array());
        set(LOG_SCALE, i, &splats.log_scales[i]);
        set(ROTATION, i, &splats.rotations[i]);
        set(OPACITY, i, &[splats.opacity_logits[i]]);
        set(SH, i, &splats.sh[i * stride..][..stride]);
    }
    numbers
}

/// The first `alive` splats of the planes.
pub fn from_planes(planes: &[f32], options: &MapOptions, centre: DVec3, alive: u32) -> Splats {
    let (n, alive) = (options.splats as usize, alive as usize);
    let at = |plane: u32, i: usize| planes[plane as usize * n + i];
    let coefficients = 3 * sh_coefficients(options.sh_degree);
    let position = |i: usize| {
        let own = [0, 1, 2].map(|k| f64::from(at(POSITION + k, i)));
        (DVec3::from(own) + centre).as_vec3().to_array()
    };
    Splats {
        origin: [0.0; 3],
        positions: (0..alive).map(position).collect(),
        log_scales: (0..alive).map(|i| [0, 1, 2].map(|k| at(LOG_SCALE + k, i))).collect(),
        rotations: (0..alive).map(|i| [0, 1, 2, 3].map(|k| at(ROTATION + k, i))).collect(),
        opacity_logits: (0..alive).map(|i| at(OPACITY, i)).collect(),
        sh: (0..alive).flat_map(|i| (0..coefficients).map(move |k| at(SH + k, i))).collect(),
        sh_degree: options.sh_degree,
    }
}
