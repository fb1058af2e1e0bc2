//! Points of the prior as key frames see them. They are found again by their descriptors, with
//! locality-sensitive hashing (Indyk & Motwani 1998): each table uses some bits of the descriptor.

use super::descriptor::{Descriptor, distance};
use super::features::Feature;

/// Tables. The chance that at least one of them gives a right match is about four in five.
const TABLES: usize = 8;
/// Bits of a table's key.
const BITS: u32 = 14;
/// Two descriptors that differ in more bits are of two points.
const ALIKE: u32 = 40;
/// A longer chain holds patches that all look the same; its rest is ignored.
const LONGEST: usize = 256;
/// No entry.
const END: u32 = u32::MAX;

/// Which features a key frame has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Group {
    pub first: u32,
    pub count: u32,
}

/// All points, in groups.
pub struct Landmarks {
    points: Vec<[f32; 3]>,
    descriptors: Vec<Descriptor>,
    groups: Vec<Group>,
    /// The group of each point.
    owner: Vec<u32>,
    /// First entry of each chain, table by table.
    heads: Vec<u32>,
    /// The entry after each, a table's after the other's.
    next: Vec<[u32; TABLES]>,
    /// The feature for which a group was last counted, and its count.
    counted: Vec<(u32, u32)>,
}

impl Landmarks {
    /// Makes one with room for `groups` groups of at most `points` points.
    pub fn with_room(groups: usize, points: usize) -> Landmarks {
        let all = groups * points;
        Landmarks {
            points: Vec::with_capacity(all),
            descriptors: Vec::with_capacity(all),
            groups: Vec::with_capacity(groups),
            owner: Vec::with_capacity(all),
            heads: if groups > 0 { vec![END; TABLES << BITS] } else { Vec::new() },
            next: Vec::with_capacity(all),
            counted: Vec::with_capacity(groups),
        }
    }

    /// Bytes that `groups` groups of `points` points take in memory.
    pub fn bytes(groups: usize, points: usize) -> usize {
        let point = size_of::<[f32; 3]>() + size_of::<Descriptor>() + 4 + 4 * TABLES;
        groups * points * point + ((4 * TABLES) << BITS)
    }

    pub fn groups(&self) -> usize {
        self.groups.len()
    }

    pub fn add(&mut self, points: impl Iterator<Item = ([f32; 3], Descriptor)>) {
        let first = self.points.len() as u32;
        let owner = self.groups.len() as u32;
        for (point, descriptor) in points {
            let entry = self.points.len() as u32;
            let mut next = [END; TABLES];
            for (table, next) in next.iter_mut().enumerate() {
                let head = &mut self.heads[(table << BITS) + key(&descriptor, table)];
                (*next, *head) = (*head, entry);
            }
            self.points.push(point);
            self.descriptors.push(descriptor);
            self.owner.push(owner);
            self.next.push(next);
        }
        self.groups.push(Group { first, count: self.points.len() as u32 - first });
        self.counted.push((END, 0));
    }

    /// Counts for each group how many of the features have a match in it: `votes`, most first.
    pub fn vote(&mut self, features: &[Feature], votes: &mut Vec<(u32, u32)>) {
        votes.clear();
        self.counted.fill((END, 0));
        let features = if self.groups.is_empty() { &[] } else { features };
        for (index, feature) in features.iter().enumerate() {
            for table in 0..TABLES {
                let mut entry = self.heads[(table << BITS) + key(&feature.descriptor, table)];
                let mut left = LONGEST;
                while entry != END && left > 0 {
                    let at = entry as usize;
                    let (last, count) = &mut self.counted[self.owner[at] as usize];
                    let new = *last != index as u32;
                    if new && distance(&self.descriptors[at], &feature.descriptor) <= ALIKE {
                        (*last, *count) = (index as u32, *count + 1);
                    }
                    entry = self.next[at][table];
                    left -= 1;
                }
            }
        }
        let all = self.counted.iter().enumerate().map(|(group, (_, count))| (group as u32, *count));
        votes.extend(all.filter(|(_, count)| *count > 0));
        votes.sort_unstable_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    }

    /// The points of a group, with their descriptors.
    pub fn group(&self, group: usize) -> (&[[f32; 3]], &[Descriptor]) {
        let Group { first, count } = self.groups[group];
        let range = first as usize..(first + count) as usize;
        (&self.points[range.clone()], &self.descriptors[range])
    }
}

/// A table's key: bits from all over the descriptor, other ones for each table.
fn key(descriptor: &Descriptor, table: usize) -> usize {
    (0..BITS as usize).fold(0, |key, i| {
        // 97 is prime to 256: no bit comes twice in a table, and tables share few.
        let bit = (table * 29 + (table * BITS as usize + i) * 97) % 256;
        key << 1 | (descriptor[bit / 64] >> (bit % 64) & 1) as usize
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn descriptor(seed: u64) -> Descriptor {
        std::array::from_fn(|i| {
            let z = (seed * 4 + i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        })
    }

    /// With 32 bits turned over.
    fn disturbed(from: Descriptor) -> Descriptor {
        std::array::from_fn(|i| from[i] ^ (0x0101_0101_0101_0101 << (i + 1)))
    }

    #[test]
    fn the_group_that_was_seen_comes_first() {
        let mut landmarks = Landmarks::with_room(20, 50);
        for group in 0..20_u64 {
            landmarks
                .add((0..50).map(|i| ([group as f32, i as f32, 0.0], descriptor(group * 50 + i))));
        }
        let feature =
            |i: u64| Feature { place: [0.0; 2], descriptor: disturbed(descriptor(7 * 50 + i)) };
        let seen: Vec<Feature> = (0..50).map(feature).collect();
        let mut votes = Vec::with_capacity(20);
        landmarks.vote(&seen, &mut votes);
        assert_eq!(votes[0].0, 7);
        assert!(votes[0].1 > 25, "{votes:?}");
        assert!(votes.get(1).is_none_or(|v| v.1 < 5), "{votes:?}");
        assert_eq!(landmarks.group(7).0[3], [7.0, 3.0, 0.0]);
    }

    #[test]
    fn none_is_found_in_nothing() {
        let mut landmarks = Landmarks::with_room(0, 50);
        let mut votes = vec![(1, 1)];
        landmarks.vote(&[], &mut votes);
        assert!(votes.is_empty() && landmarks.groups() == 0);
    }
}
