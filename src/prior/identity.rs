//! The identity of a prior: whether both sides of a link hold the same one.

use std::fmt;

use super::{RenderOptions, Splats};
use crate::residual::wavelet::Tables;

/// Identity of a prior: the first four bytes, little endian, of a BLAKE3 hash. The hash covers all that shapes its
/// pictures: the render options, the degree, every parameter kept, the order of splats (it decides between equal
/// depths), and its scene coder tables, if it has any. File format, order of properties and dropped splats do not
/// change the identity.
///
/// It protects against mistakes, not against forgery: two different priors share an identity with a
/// chance of 1 in 2³².
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PriorId(pub u32);

impl PriorId {
    /// Bytes as in a packet.
    pub fn to_bytes(self) -> [u8; 4] {
        self.0.to_le_bytes()
    }

    /// From a packet's bytes.
    pub fn from_bytes(bytes: [u8; 4]) -> PriorId {
        PriorId(u32::from_le_bytes(bytes))
    }

    pub(super) fn of(
        splats: &Splats,
        options: &RenderOptions,
        coder_tables: Option<&Tables>,
    ) -> PriorId {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"nvsprior prior 1");
        hash_floats(&mut hasher, &[options.near, options.alpha_max]);
        hasher.update(&[u8::from(options.antialiased)]);
        hash_floats(&mut hasher, &options.background);
        hasher.update(&splats.sh_degree.to_le_bytes());
        hasher.update(&(splats.len() as u64).to_le_bytes());
        hash_floats(&mut hasher, splats.positions.as_flattened());
        hash_floats(&mut hasher, splats.log_scales.as_flattened());
        hash_floats(&mut hasher, splats.rotations.as_flattened());
        hash_floats(&mut hasher, &splats.opacity_logits);
        hash_floats(&mut hasher, &splats.sh);
        // Without tables nothing is added: such priors keep the identity that they had before tables existed.
        if let Some(tables) = coder_tables {
            hasher.update(&tables.write());
        }
        let hash = *hasher.finalize().as_bytes();
        PriorId::from_bytes([hash[0], hash[1], hash[2], hash[3]])
    }
}

impl fmt::Display for PriorId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

/// Hashes floats as little-endian bytes, a buffer at a time.
fn hash_floats(hasher: &mut blake3::Hasher, values: &[f32]) {
    let mut buffer = Vec::with_capacity(4096);
    for chunk in values.chunks(1024) {
        buffer.clear();
        buffer.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
        hasher.update(&buffer);
    }
}

#[cfg(test)]
mod tests {
    use super::super::coder_tables::tests::sample_tables;
    use super::super::tests::sample_splats;
    use super::*;

    #[test]
    fn the_hash_is_part_of_the_wire_format() {
        let id = PriorId::of(&sample_splats(5, 1), &RenderOptions::INRIA, None);
        assert_eq!(id.to_string(), "5d4dcd04");
        assert_eq!(PriorId::from_bytes(id.to_bytes()), id);
    }

    #[test]
    fn every_parameter_counts() {
        let splats = sample_splats(5, 1);
        let id = PriorId::of(&splats, &RenderOptions::INRIA, None);
        let changed = |change: fn(&mut Splats)| {
            let mut other = splats.clone();
            change(&mut other);
            PriorId::of(&other, &RenderOptions::INRIA, None)
        };
        assert_ne!(changed(|s| s.positions[4][2] += 1e-3), id);
        assert_ne!(changed(|s| s.log_scales[0][0] += 1e-3), id);
        assert_ne!(changed(|s| s.rotations[1][3] += 1e-3), id);
        assert_ne!(changed(|s| s.opacity_logits[2] += 1e-3), id);
        assert_ne!(changed(|s| s.sh[59] += 1e-3), id);
        assert_ne!(changed(|s| s.positions.swap(0, 1)), id);
        assert_ne!(PriorId::of(&splats, &RenderOptions::GSPLAT, None), id);
        let antialiased = RenderOptions { antialiased: true, ..RenderOptions::INRIA };
        assert_ne!(PriorId::of(&splats, &antialiased, None), id);
    }

    #[test]
    fn every_byte_of_the_coder_tables_counts() {
        let (splats, tables) = (sample_splats(5, 1), sample_tables(1));
        let of = |tables: Option<&Tables>| PriorId::of(&splats, &RenderOptions::INRIA, tables);
        let id = of(Some(&tables));
        assert_eq!(of(Some(&tables.clone())), id);
        assert_ne!(of(None), id);
        assert_ne!(of(Some(&Tables::generic())), of(None));
        let bytes = tables.write();
        for at in 4..bytes.len() {
            let mut other = bytes.clone();
            other[at] ^= 1;
            assert_ne!(of(Some(&Tables::read(&other).unwrap())), id, "byte {at}");
        }
    }
}
