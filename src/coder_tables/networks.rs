//! Small networks in integers: chances of a coefficient's bits from its context.
//!
//! Inputs and hidden values have [`FEATURE_PLACES`] binary places, weights [`WEIGHT_PLACES`], logits [`LOGIT_PLACES`].
//! No sum leaves 32 bits: inputs stay within [`LARGEST`], hidden values within [`LARGEST_HIDDEN`], and layers have at
//! most [`MAGNITUDE_INPUTS`] inputs.

/// Numbers that the network for magnitudes looks at.
pub const MAGNITUDE_INPUTS: usize = 33;
/// Numbers that the network for signs looks at.
pub const SIGN_INPUTS: usize = 17;
/// The first inputs for magnitudes: what was coded before. If they are all zero, the context is quiet.
pub const COUNT_INPUTS: usize = 18;
/// The other inputs.
pub const QUIET_INPUTS: usize = MAGNITUDE_INPUTS - COUNT_INPUTS;
/// Hidden values of the network for quiet contexts.
pub const HIDDEN_QUIET: usize = 12;
/// Classes of bands that a network tells apart: 7 ranks, 4 orientations, 3 planes.
pub const CLASSES: usize = 14;
/// Values of the hidden layers.
pub const HIDDEN: usize = 32;
/// Values of the second hidden layer for magnitudes.
pub const HIDDEN_2: usize = 16;
/// Values of the hidden layer for signs.
pub const HIDDEN_SIGN: usize = 16;
/// Logits of a magnitude: not zero; above one; above two; one more beyond.
pub const LOGITS: usize = 4;

/// Binary places of a feature.
pub const FEATURE_PLACES: u32 = 6;
/// Largest magnitude of a feature.
pub const LARGEST: i32 = 1000;
/// Binary places of a weight.
pub const WEIGHT_PLACES: u32 = 11;
/// A weight of 1, and an input of 1.
pub const WEIGHT_SCALE: f64 = (1 << WEIGHT_PLACES) as f64;
/// See [`WEIGHT_SCALE`].
pub const FEATURE_SCALE: f64 = (1 << FEATURE_PLACES) as f64;
/// Binary places of a logit.
pub const LOGIT_PLACES: u32 = 8;
/// Largest magnitude of a logit, in these.
pub const LARGEST_LOGIT: i32 = 12 << LOGIT_PLACES;
/// Largest hidden value.
pub const LARGEST_HIDDEN: i32 = 1900;

const _: () =
    assert!(MAGNITUDE_INPUTS as i64 * LARGEST as i64 * 32_767 < i32::MAX as i64 - (1 << 24));
const _: () = assert!(HIDDEN as i64 * LARGEST_HIDDEN as i64 * 32_767 < i32::MAX as i64 - (1 << 24));

/// A logit in [`LOGIT_PLACES`] binary places.
pub type Logit = i16;

/// The weights. Biases have the places of a weight times an input's, less [`FEATURE_PLACES`]: those of a weight.
#[derive(Clone, Debug, PartialEq)]
pub struct Networks {
    /// First layer for magnitudes: by input, then hidden value.
    pub magnitude_1: [[i16; HIDDEN]; MAGNITUDE_INPUTS],
    /// What a class of band adds.
    pub magnitude_class: [[i16; HIDDEN]; CLASSES],
    /// Bias.
    pub magnitude_bias_1: [i16; HIDDEN],
    /// Second layer.
    pub magnitude_2: [[i16; HIDDEN_2]; HIDDEN],
    /// Its bias.
    pub magnitude_bias_2: [i16; HIDDEN_2],
    /// Third layer.
    pub magnitude_3: [[i16; LOGITS]; HIDDEN_2],
    /// Its bias.
    pub magnitude_bias_3: [i16; LOGITS],
    /// First layer for quiet contexts, which tell whether the coefficient is not zero. Most contexts are quiet, so this
    /// network is small.
    pub quiet_1: [[i16; HIDDEN_QUIET]; QUIET_INPUTS],
    /// What a class of band adds.
    pub quiet_class: [[i16; HIDDEN_QUIET]; CLASSES],
    /// Bias.
    pub quiet_bias_1: [i16; HIDDEN_QUIET],
    /// Second layer.
    pub quiet_2: [i16; HIDDEN_QUIET],
    /// Its bias.
    pub quiet_bias_2: i16,
    /// First layer for signs: by input, then hidden value.
    pub sign_1: [[i16; HIDDEN_SIGN]; SIGN_INPUTS],
    /// What a class of band adds.
    pub sign_class: [[i16; HIDDEN_SIGN]; CLASSES],
    /// Bias.
    pub sign_bias_1: [i16; HIDDEN_SIGN],
    /// Second layer.
    pub sign_2: [i16; HIDDEN_SIGN],
    /// Its bias.
    pub sign_bias_2: i16,
}

/// The three classes of a band of a plane.
pub fn classes(rank: usize, orientation: usize, plane: usize) -> [usize; 3] {
    [rank, 7 + orientation, 11 + plane]
}
