//! Why a JPEG cannot be used.

/// What is wrong with a JPEG.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JpegError {
    #[error("the JPEG is cut off: its data end at byte {at}, within the picture")]
    Cut { at: usize },
    #[error("the JPEG is broken at byte {at}: {what}")]
    Broken { at: usize, what: &'static str },
    #[error("the JPEG is not whole: scans are missing, so that it has coarse detail only")]
    Scans,
}
