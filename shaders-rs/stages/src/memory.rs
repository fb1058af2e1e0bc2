//! Access to buffers by index, without a test of the bounds. A failed test would end the invocation, so a driver would
//! have to carry a mask of running invocations through all that follows. On llvmpipe that doubles the time of a stage.
//! Every index here is below a size that the host allocated; each use says which.

use spirv_std::arch::IndexUnchecked;

/// Element `i`, which must exist.
pub fn at<T: Copy, B: IndexUnchecked<T> + ?Sized>(buffer: &B, i: u32) -> T {
    // SAFETY: the caller's index.
    unsafe { *buffer.index_unchecked(i as usize) }
}

/// Element `i`, which must exist, to be changed.
pub fn at_mut<T, B: IndexUnchecked<T> + ?Sized>(buffer: &mut B, i: u32) -> &mut T {
    // SAFETY: the caller's index.
    unsafe { buffer.index_unchecked_mut(i as usize) }
}

/// A buffer of pairs of floats. As words of 64 bits a pair is one access: llvmpipe pays by
/// accesses, a GPU by bytes.
pub trait Pairs {
    /// Loops over harmonics are written out: on llvmpipe an array that a loop reads lies in memory. On a GPU all that
    /// is written out is loaded at once, and takes the registers.
    const WRITTEN_OUT: bool;

    /// Pair `i`, which must exist.
    fn pair(&self, i: u32) -> [f32; 2];
}

impl Pairs for [f32] {
    const WRITTEN_OUT: bool = false;

    fn pair(&self, i: u32) -> [f32; 2] {
        [at(self, 2 * i), at(self, 2 * i + 1)]
    }
}

impl Pairs for [u64] {
    const WRITTEN_OUT: bool = true;

    fn pair(&self, i: u32) -> [f32; 2] {
        let pair: u64 = at(self, i);
        [f32::from_bits(pair as u32), f32::from_bits((pair >> 32) as u32)]
    }
}

/// A buffer of pairs of floats that are changed.
pub trait PairsMut: Pairs {
    /// Sets pair `i`, which must exist.
    fn put(&mut self, i: u32, pair: [f32; 2]);
}

impl PairsMut for [f32] {
    fn put(&mut self, i: u32, pair: [f32; 2]) {
        *at_mut(self, 2 * i) = pair[0];
        *at_mut(self, 2 * i + 1) = pair[1];
    }
}

impl PairsMut for [u64] {
    fn put(&mut self, i: u32, pair: [f32; 2]) {
        *at_mut(self, i) = u64::from(pair[0].to_bits()) | u64::from(pair[1].to_bits()) << 32;
    }
}
