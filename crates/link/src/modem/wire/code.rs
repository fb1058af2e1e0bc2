//! The erasure code of a layer.
//!
//! The chunks of a layer are the values of a polynomial over GF(2⁸), byte by byte: chunk i at the point i. The first
//! ones, as many as the threshold, are the layer's bytes, and determine the polynomial. So any as many chunks yield
//! every other one, by Lagrange's formula. It is the systematic Vandermonde code of `reed-solomon-erasure`, whose
//! arithmetic of the field is used here. That crate's own coder takes memory for each packet, and for each pattern of
//! losses.

use reed_solomon_erasure::galois_8::{add, div, mul, mul_slice_xor};

use crate::modem::limits::MAX_SHARES;

/// Chunks that determine all others of a layer.
pub struct Known {
    /// Their indices. Those beyond `count` are not used.
    points: [u8; MAX_SHARES],
    /// By chunk: the product of its distances to all others.
    spans: [u8; MAX_SHARES],
    count: usize,
}

impl Known {
    /// The chunks of these indices, which differ, at most [`MAX_SHARES`].
    pub fn new(indices: impl Iterator<Item = usize>) -> Known {
        let mut known = Known { points: [0; MAX_SHARES], spans: [1; MAX_SHARES], count: 0 };
        for index in indices.take(MAX_SHARES) {
            let point = index as u8;
            known.points[known.count] = point;
            for other in 0..known.count {
                let apart = add(point, known.points[other]);
                known.spans[other] = mul(known.spans[other], apart);
                known.spans[known.count] = mul(known.spans[known.count], apart);
            }
            known.count += 1;
        }
        known
    }

    /// Writes the chunk of another index. `chunk` yields the known ones by their index; all have the same length.
    pub fn write<'a>(&self, index: usize, chunk: impl Fn(usize) -> &'a [u8], into: &mut [u8]) {
        let at = index as u8;
        let points = &self.points[..self.count];
        let product = points.iter().fold(1, |product, point| mul(product, add(at, *point)));
        into.fill(0);
        for (point, span) in points.iter().zip(&self.spans) {
            let weight = div(product, mul(*span, add(at, *point)));
            mul_slice_xor(weight, chunk((*point).into()), into);
        }
    }
}

#[cfg(test)]
mod tests {
    use reed_solomon_erasure::galois_8::ReedSolomon;

    use super::*;
    use nvsprior::random::Random;

    const LEN: usize = 5;

    /// Chunks of random bytes with their parity, as the crate makes it.
    fn chunks(count: usize, threshold: usize, random: &mut Random) -> Vec<Vec<u8>> {
        let mut chunks = vec![vec![0; LEN]; count];
        chunks[..threshold].iter_mut().flatten().for_each(|byte| *byte = random.bits() as u8);
        if count > threshold {
            ReedSolomon::new(threshold, count - threshold).unwrap().encode(&mut chunks).unwrap();
        }
        chunks
    }

    #[test]
    fn it_is_the_code_of_the_crate() {
        let mut random = Random::new(4);
        let few = (1..=24).flat_map(|count| (1..=count).map(move |threshold| (count, threshold)));
        for (count, threshold) in few.chain([(256, 1), (256, 90), (256, 255), (255, 128)]) {
            let chunks = chunks(count, threshold, &mut random);
            let known = Known::new(0..threshold);
            let mut chunk = [0xA5; LEN];
            for index in threshold..count {
                known.write(index, |index| &chunks[index], &mut chunk);
                assert_eq!(chunk[..], chunks[index], "{index} of {count}, {threshold}");
            }
        }
    }

    #[test]
    fn any_chunks_yield_the_others() {
        let mut random = Random::new(5);
        for (count, threshold) in [(1, 1), (4, 2), (16, 5), (16, 16), (40, 33), (256, 100)] {
            let chunks = chunks(count, threshold, &mut random);
            for _ in 0..20 {
                let mut order: Vec<_> = (0..count).collect();
                order.sort_by_cached_key(|_| random.bits());
                let (there, lost) = order.split_at(threshold);
                let known = Known::new(there.iter().copied());
                let mut chunk = [0xA5; LEN];
                for index in lost {
                    known.write(*index, |index| &chunks[index], &mut chunk);
                    assert_eq!(chunk[..], chunks[*index], "{index} of {count}, {threshold}");
                }
            }
        }
    }
}
