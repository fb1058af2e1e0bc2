//! The erasure code of a layer.

use reed_solomon_erasure::galois_8::ReedSolomon;

/// Fills the chunks after the first `threshold`, all of the same length, so that any `threshold` of them give the rest.
///
/// # Panics
/// If there are more than 256 chunks, if their lengths differ, or if `threshold` is 0. The caller has checked all three.
pub(super) fn protect(chunks: &mut [&mut [u8]], threshold: usize) {
    if chunks.len() > threshold && !chunks[0].is_empty() {
        let code = code(chunks.len(), threshold);
        code.encode(chunks).expect("chunks of one length, as many as the code has");
    }
}

/// Fills the first `threshold` chunks from those that are there, which are as many or more.
pub(super) fn restore(chunks: &mut [(&mut [u8], bool)], threshold: usize) {
    let whole = chunks[..threshold].iter().all(|(_, there)| *there);
    if !whole && !chunks[0].0.is_empty() {
        let code = code(chunks.len(), threshold);
        code.reconstruct_data(chunks).expect("as many chunks as the threshold are there");
    }
}

fn code(count: usize, threshold: usize) -> ReedSolomon {
    ReedSolomon::new(threshold, count - threshold).expect("1 to 255 of at most 256")
}
