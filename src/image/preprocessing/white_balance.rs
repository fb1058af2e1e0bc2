//! Gray-world white balance.

/// How colours are balanced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WhiteBalance {
    /// They stay as they are.
    #[default]
    None,
    /// Gray world (Buchsbaum 1980): each channel gets a gain, so that the means of all three become their common mean.
    /// A gain is at most [`WhiteBalance::MAX_GAIN`], and never below ⅓. It is rounded to 1/4096.
    GrayWorld,
}

impl WhiteBalance {
    /// The largest gain. A dark frame, or one of a single colour, has a channel of little but noise: it stays dark.
    pub const MAX_GAIN: u32 = 4;
}

/// Fractional bits of gains.
const GAIN_BITS: u32 = 12;

/// Brings the means of red, green and blue to their common mean. `counts`: which pixels make the means; `None`: all do.
pub(super) fn gray_world(rgb: &mut [u8], counts: Option<&[bool]>) {
    let tables = gains(rgb, counts).map(table);
    for pixel in rgb.chunks_exact_mut(3) {
        for (value, table) in pixel.iter_mut().zip(&tables) {
            *value = table[usize::from(*value)];
        }
    }
}

/// The gain of each channel.
fn gains(rgb: &[u8], counts: Option<&[bool]>) -> [u32; 3] {
    let mut sums = [0u64; 3];
    let counted = |pixel: usize| counts.is_none_or(|counts| counts[pixel]);
    for (_, pixel) in rgb.chunks_exact(3).enumerate().filter(|(index, _)| counted(*index)) {
        for (sum, value) in sums.iter_mut().zip(pixel) {
            *sum += u64::from(*value);
        }
    }
    let all: u64 = sums.iter().sum();
    let max = WhiteBalance::MAX_GAIN << GAIN_BITS;
    sums.map(|sum| match sum {
        // A channel without any light has no use for a gain.
        0 => 1 << GAIN_BITS,
        sum => (((all << GAIN_BITS) + 3 * sum / 2) / (3 * sum)).min(max.into()) as u32,
    })
}

/// What a gain makes of each value.
fn table(gain: u32) -> [u8; 256] {
    let half = 1 << (GAIN_BITS - 1);
    std::array::from_fn(|value| ((value as u32 * gain + half) >> GAIN_BITS).min(255) as u8)
}
