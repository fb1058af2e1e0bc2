//! The splats of a prior: trained parameters, as files hold them.

use super::error::PriorError;
use super::limits::MAX_SH_DEGREE;

/// Trained parameters of all splats, as files hold them: scales as logarithms, opacities as logits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Splats {
    /// The world's point that [`positions`](Self::positions) count from: not zero if the scene lies so far from its
    /// coordinates' origin that 32-bit numbers are too coarse there.
    pub origin: [f64; 3],
    /// Means, from `origin`, world axes, the prior's unit.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the splat's own axes.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions (w, x, y, z), splat to world; any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Logits of the opacities.
    pub opacity_logits: Vec<f32>,
    /// Spherical harmonics: per splat `(degree + 1)²` coefficients of RGB triples.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
}

impl Splats {
    /// Highest degree of spherical harmonics.
    pub const MAX_SH_DEGREE: u32 = MAX_SH_DEGREE;

    /// None yet, with room for `count` of the degree.
    pub fn with_capacity(count: usize, sh_degree: u32) -> Splats {
        let mut splats = Splats { sh_degree, ..Splats::default() };
        splats.positions.reserve_exact(count);
        splats.log_scales.reserve_exact(count);
        splats.rotations.reserve_exact(count);
        splats.opacity_logits.reserve_exact(count);
        splats.sh.reserve_exact(count * splats.sh_stride());
        splats
    }

    /// Number of splats.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Floats of spherical harmonics per splat: `3 (degree + 1)²`.
    pub fn sh_stride(&self) -> usize {
        3 * (self.sh_degree as usize + 1).pow(2)
    }

    /// Rotation of splat `index` at unit length, (w, x, y, z). The stored rotation may have any
    /// length. It is kept as trained, so that reading and writing a prior does not change its
    /// identity.
    pub fn unit_rotation(&self, index: usize) -> [f32; 4] {
        let q = self.rotations[index];
        let length = quaternion_length(q);
        q.map(|v| (f64::from(v) / length) as f32)
    }

    /// Opacity of splat `index`, from its logit.
    pub fn opacity(&self, index: usize) -> f64 {
        1.0 / (1.0 + libm::exp(-f64::from(self.opacity_logits[index])))
    }

    /// The splats that `kept` names, in their order.
    ///
    /// # Panics
    /// If `kept` has not an entry per splat.
    pub fn filtered(&self, kept: &[bool]) -> Splats {
        assert_eq!(kept.len(), self.len(), "one entry per splat");
        Splats {
            origin: self.origin,
            positions: pick(&self.positions, kept, 1),
            log_scales: pick(&self.log_scales, kept, 1),
            rotations: pick(&self.rotations, kept, 1),
            opacity_logits: pick(&self.opacity_logits, kept, 1),
            sh: pick(&self.sh, kept, self.sh_stride()),
            sh_degree: self.sh_degree,
        }
    }

    /// The splats that `which` names, in that order, without the spherical harmonics above a degree.
    pub(super) fn picked(&self, which: &[u32], degree: u32) -> Splats {
        let sh_degree = degree.min(self.sh_degree);
        let mut splats = Splats::with_capacity(which.len(), sh_degree);
        splats.origin = self.origin;
        let own = splats.sh_stride();
        for index in which.iter().map(|index| *index as usize) {
            splats.positions.push(self.positions[index]);
            splats.log_scales.push(self.log_scales[index]);
            splats.rotations.push(self.rotations[index]);
            splats.opacity_logits.push(self.opacity_logits[index]);
            splats.sh.extend_from_slice(&self.sh[index * self.sh_stride()..][..own]);
        }
        splats
    }

    /// Moves other splats behind these, whose origin they get.
    ///
    /// # Panics
    /// If they have another degree.
    pub fn append(&mut self, other: &mut Splats) {
        assert_eq!(self.sh_degree, other.sh_degree, "degree");
        if other.origin != self.origin {
            let exact = other.positions_from_zero();
            other.place(self.origin, &exact);
        }
        self.positions.append(&mut other.positions);
        self.log_scales.append(&mut other.log_scales);
        self.rotations.append(&mut other.rotations);
        self.opacity_logits.append(&mut other.opacity_logits);
        self.sh.append(&mut other.sh);
    }

    /// Has the positions, which count from zero here, count from `origin`.
    pub(super) fn place(&mut self, origin: [f64; 3], exact: &[[f64; 3]]) {
        self.origin = origin;
        let from = |p: &[f64; 3]| std::array::from_fn(|axis| (p[axis] - origin[axis]) as f32);
        self.positions = exact.iter().map(from).collect();
    }

    /// The positions in the world.
    pub(super) fn positions_from_zero(&self) -> Vec<[f64; 3]> {
        let from =
            |p: &[f32; 3]| std::array::from_fn(|axis| f64::from(p[axis]) + self.origin[axis]);
        self.positions.iter().map(from).collect()
    }

    /// The splats without the spherical harmonics above a degree.
    pub fn with_sh_degree(&self, degree: u32) -> Splats {
        let sh_degree = degree.min(self.sh_degree);
        let own = 3 * (sh_degree as usize + 1).pow(2);
        let sh = self.sh.chunks_exact(self.sh_stride()).flat_map(|c| &c[..own]).copied().collect();
        Splats { sh, sh_degree, ..self.clone() }
    }

    /// The lowest degree beyond which all coefficients are zero.
    pub(super) fn needed_sh_degree(&self) -> u32 {
        let coefficients = (self.sh_degree as usize + 1).pow(2);
        let mut last = 0;
        for own in self.sh.chunks_exact(3 * coefficients) {
            // Only coefficients after the last one found so far are looked at.
            let behind = own[3 * (last + 1)..].chunks_exact(3);
            if let Some(at) = behind.rev().position(|rgb| rgb.iter().any(|v| *v != 0.0)) {
                last = coefficients - 1 - at;
            }
        }
        last.isqrt() as u32
    }

    /// Checks that the degree is known and that all arrays hold the same number of splats.
    pub fn check_shape(&self) -> Result<(), PriorError> {
        if self.sh_degree > Self::MAX_SH_DEGREE {
            return Err(PriorError::ShDegree { degree: self.sh_degree });
        }
        let expected = self.len();
        let lengths = [
            ("log_scales", self.log_scales.len(), expected),
            ("rotations", self.rotations.len(), expected),
            ("opacity_logits", self.opacity_logits.len(), expected),
            ("sh", self.sh.len(), expected * self.sh_stride()),
        ];
        match lengths.into_iter().find(|(_, found, expected)| found != expected) {
            Some((array, found, expected)) => Err(PriorError::Shape { array, found, expected }),
            None => Ok(()),
        }
    }
}

/// Entries of the splats that are kept, `stride` a splat.
fn pick<T: Copy>(array: &[T], kept: &[bool], stride: usize) -> Vec<T> {
    let entries = array.chunks_exact(stride).zip(kept);
    entries.filter(|(_, kept)| **kept).flat_map(|(entry, _)| entry).copied().collect()
}

/// Length of a quaternion, in f64: no finite f32 overflows it.
pub(super) fn quaternion_length(q: [f32; 4]) -> f64 {
    q.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt()
}
