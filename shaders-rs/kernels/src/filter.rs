//! The display filter's layout: planes of words, each of four bytes, one byte per value of a channel.

/// Outputs that an invocation of stage `filter_layer` makes, for each of its blocks of 2×2 pixels.
pub const FILTER_OUTPUTS: u32 = 8;
/// Blocks of a row that an invocation makes.
pub const FILTER_RUN: u32 = 4;
/// Columns and rows of the invocations of a workgroup.
pub const FILTER_GROUP: u32 = 8;
/// `Vec4`s of weights per tap and word of inputs: four inputs, eight outputs.
pub const FILTER_WEIGHTS: u32 = 8;
/// `Vec4`s of biases and scales per eight outputs.
pub const FILTER_ENDS: u32 = 4;

/// A layer, as stage `filter_layer` needs it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct FilterLayer {
    /// Columns of blocks.
    pub width: u32,
    /// Rows of blocks.
    pub height: u32,
    /// Words of inputs per block.
    pub words: u32,
    /// Distance of the taps, blocks.
    pub dilation: u32,
    /// Its first weights, a `Vec4`.
    pub weights: u32,
    /// Its first biases, a `Vec4`.
    pub ends: u32,
}

impl FilterLayer {
    /// As push constants.
    pub fn words(self) -> [u32; 6] {
        [self.width, self.height, self.words, self.dilation, self.weights, self.ends]
    }
}
