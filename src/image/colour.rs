//! From Y, U, V to red, green, blue.

use super::Colour;

/// Fractional bits of samples, and of coefficients: together they keep sums below 2³¹.
pub(super) const SAMPLE_BITS: u32 = 8;
const COEFFICIENT_BITS: u32 = 13;

/// Coefficients of the conversion, ITU-R BT.601-7 and BT.709-6, section 3.
pub(super) struct Matrix {
    black: i32,
    y: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl Matrix {
    pub fn new(colour: Colour) -> Matrix {
        let (red, blue) = match colour {
            Colour::Bt601Limited | Colour::Bt601Full => (0.299, 0.114),
            Colour::Bt709Limited | Colour::Bt709Full => (0.2126, 0.0722),
        };
        let (black, y, chroma) = match colour {
            Colour::Bt601Limited | Colour::Bt709Limited => (16, 255.0 / 219.0, 255.0 / 224.0),
            Colour::Bt601Full | Colour::Bt709Full => (0, 1.0, 1.0),
        };
        let green = 1.0 - red - blue;
        let (red_v, blue_u) = (2.0 * (1.0 - red) * chroma, 2.0 * (1.0 - blue) * chroma);
        let fixed = |v: f64| (v * f64::from(1 << COEFFICIENT_BITS)).round() as i32;
        Matrix {
            black: black << SAMPLE_BITS,
            y: fixed(y),
            red_v: fixed(red_v),
            green_u: fixed(-blue_u * blue / green),
            green_v: fixed(-red_v * red / green),
            blue_u: fixed(blue_u),
        }
    }

    /// Red, green and blue of samples with [`SAMPLE_BITS`].
    pub fn rgb(&self, y: u16, u: u16, v: u16) -> [u8; 3] {
        const BITS: u32 = SAMPLE_BITS + COEFFICIENT_BITS;
        let grey = (i32::from(y) - self.black) * self.y + (1 << (BITS - 1));
        let (u, v) = (i32::from(u) - (128 << SAMPLE_BITS), i32::from(v) - (128 << SAMPLE_BITS));
        [self.red_v * v, self.green_u * u + self.green_v * v, self.blue_u * u]
            .map(|chroma| ((grey + chroma) >> BITS).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_and_greys() {
        let at = |colour, y: u16, u: u16, v: u16| Matrix::new(colour).rgb(y << 8, u << 8, v << 8);
        for (limited, full) in
            [(Colour::Bt601Limited, Colour::Bt601Full), (Colour::Bt709Limited, Colour::Bt709Full)]
        {
            assert_eq!(at(limited, 16, 128, 128), [0; 3]);
            assert_eq!(at(limited, 235, 128, 128), [255; 3]);
            for y in 0..256 {
                assert_eq!(at(full, y, 128, 128), [y as u8; 3]);
            }
            assert_eq!(at(limited, 255, 255, 255)[0], 255);
            assert_eq!(at(limited, 0, 0, 0)[0], 0);
        }
        // BT.601's pure red.
        assert_eq!(at(Colour::Bt601Limited, 81, 90, 240), [254, 0, 0]);
    }
}
