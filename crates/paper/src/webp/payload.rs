//! A coded difference picture.

/// A difference picture by WebP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Payload<'a> {
    /// It is a whole WebP file, not one without what a packet says anyway.
    pub whole: bool,
    /// Its bytes.
    pub bytes: &'a [u8],
}
