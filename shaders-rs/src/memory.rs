//! Buffers by index without a test of the bounds. A failed test ends the invocation, so a driver must
//! carry a mask of those still running through all that follows; on llvmpipe that doubles the time of
//! a stage. Every index here lies below a size that the host allocated by; each use says which.

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
