//! The identity of a prior: a hash of all that shapes its pictures.

use super::container::{PartName, covered_parts};
use super::coordinate_frame::CoordinateFrame;
use super::id::PriorId;
use super::options::RenderOptions;
use super::splats::Splats;
use crate::coder_tables::Tables;

/// What the hash begins with.
const START: &[u8] = b"nvsprior prior 1";

/// The identity of a prior of these splats. `stated_frame`: the coordinate frame, if the prior does not take that of
/// its splats.
pub(super) fn identity_of(
    splats: &Splats,
    options: &RenderOptions,
    stated_frame: Option<&CoordinateFrame>,
    coder_tables: Option<&Tables>,
) -> PriorId {
    let mut hasher = blake3::Hasher::new();
    hasher.update(START);
    for (name, content) in covered_parts(options, stated_frame, coder_tables, splats.origin) {
        if let Some(content) = content {
            hash_start(&mut hasher, name, content.len());
            hasher.update(&content);
        }
    }
    let numbers = splats.len() * (11 + splats.sh_stride());
    hash_start(&mut hasher, PartName::SPLATS, 8 + 4 * numbers);
    hasher.update(&splats.sh_degree.to_le_bytes());
    hasher.update(&(splats.len() as u32).to_le_bytes());
    hash_floats(&mut hasher, splats.positions.as_flattened());
    hash_floats(&mut hasher, splats.log_scales.as_flattened());
    hash_floats(&mut hasher, splats.rotations.as_flattened());
    hash_floats(&mut hasher, &splats.opacity_logits);
    hash_floats(&mut hasher, &splats.sh);
    let hash = *hasher.finalize().as_bytes();
    PriorId::from_bytes([hash[0], hash[1], hash[2], hash[3]])
}

/// Hashes a part's name and the bytes of its content.
fn hash_start(hasher: &mut blake3::Hasher, name: PartName, bytes: usize) {
    hasher.update(&name.bytes());
    hasher.update(&(bytes as u64).to_le_bytes());
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
    use super::super::tests::{sample_splats, sample_tables};
    use super::*;

    #[test]
    fn the_hash_is_part_of_the_wire_format() {
        let id = identity_of(&sample_splats(5, 1), &RenderOptions::INRIA, None, None);
        assert_eq!(id.to_string(), "224b05be");
        assert_eq!(PriorId::from_bytes(id.to_bytes()), id);
    }

    #[test]
    fn every_parameter_counts() {
        let splats = sample_splats(5, 1);
        let id = identity_of(&splats, &RenderOptions::INRIA, None, None);
        let changed = |change: fn(&mut Splats)| {
            let mut other = splats.clone();
            change(&mut other);
            identity_of(&other, &RenderOptions::INRIA, None, None)
        };
        assert_ne!(changed(|s| s.positions[4][2] += 1e-3), id);
        assert_ne!(changed(|s| s.log_scales[0][0] += 1e-3), id);
        assert_ne!(changed(|s| s.rotations[1][3] += 1e-3), id);
        assert_ne!(changed(|s| s.opacity_logits[2] += 1e-3), id);
        assert_ne!(changed(|s| s.sh[59] += 1e-3), id);
        assert_ne!(changed(|s| s.positions.swap(0, 1)), id);
        assert_ne!(identity_of(&splats, &RenderOptions::GSPLAT, None, None), id);
        let antialiased = RenderOptions { antialiased: true, ..RenderOptions::INRIA };
        assert_ne!(identity_of(&splats, &antialiased, None, None), id);
        let of_focal = |focal| {
            let options = RenderOptions { trained_focal: Some(focal), ..RenderOptions::INRIA };
            identity_of(&splats, &options, None, None)
        };
        assert_ne!(of_focal(270.0), id);
        assert_ne!(of_focal(270.0), of_focal(271.0));
    }

    #[test]
    fn a_stated_frame_counts() {
        let of = |frame| identity_of(&sample_splats(5, 1), &RenderOptions::INRIA, frame, None);
        let frame = CoordinateFrame { centre: [1.0, 2.0, 3.0], spread: 4.0 };
        assert_ne!(of(Some(&frame)), of(None));
        assert_ne!(of(Some(&CoordinateFrame { spread: 5.0, ..frame })), of(Some(&frame)));
    }

    #[test]
    fn every_byte_of_the_coder_tables_counts() {
        let (splats, tables) = (sample_splats(5, 1), sample_tables(1));
        let of =
            |tables: Option<&Tables>| identity_of(&splats, &RenderOptions::INRIA, None, tables);
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
