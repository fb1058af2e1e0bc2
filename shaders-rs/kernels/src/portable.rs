//! Division, roots, logarithm and power of 2, made of additions, multiplications and bit operations. Vulkan rounds
//! those correctly on every device, and leaves the others open. So every device and the host compute the same bits
//! here, if products and sums are not contracted (the builder decorates them) and are rounded to nearest even.
//!
//! Arguments must be normal numbers within the stated range: devices may flush denormals.

/// 1/x, within 1.5 units in the last place. |x| in [2⁻¹²⁵, 2¹²⁵].
pub fn reciprocal(x: f32) -> f32 {
    // Negates the exponent and mirrors the mantissa: off by at most 12 %. Each step squares the error.
    let y = f32::from_bits(0x7ef3_11c7_u32.wrapping_sub(x.to_bits()));
    let y = y * (2.0 - x * y);
    let y = y * (2.0 - x * y);
    let y = y * (2.0 - x * y);
    y + y * (1.0 - x * y)
}

/// 1/√x, within 2 units in the last place. x in [2⁻¹²⁵, 2¹²⁵].
pub fn inverse_sqrt(x: f32) -> f32 {
    // Half the exponent negated: off by at most 3.5 %.
    let y = f32::from_bits(0x5f37_5a86_u32.wrapping_sub(x.to_bits() >> 1));
    let half = 0.5 * x;
    let y = y * (1.5 - half * y * y);
    let y = y * (1.5 - half * y * y);
    y * (1.5 - half * y * y)
}

/// √x, within 2 units in the last place; 0 below 2⁻¹²⁵. x up to 2¹²⁵.
pub fn sqrt(x: f32) -> f32 {
    if x >= LEAST { x * inverse_sqrt(x) } else { 0.0 }
}

/// Arguments from here on are far from denormals.
const LEAST: f32 = 2.350_988_7e-38;

/// log₂ x, within 3·10⁻⁷. x normal and positive. The polynomial is that of Cephes' `logf` (Moshier 1989).
pub fn log2(x: f32) -> f32 {
    const ROOT_HALF: u32 = 0x3f35_04f3;
    let exponent = (x.to_bits().wrapping_sub(ROOT_HALF) as i32) >> 23;
    let mantissa = f32::from_bits(x.to_bits().wrapping_sub((exponent << 23) as u32));
    let t = mantissa - 1.0;
    let p = 7.037_683_6e-2;
    let p = p * t - 1.151_461e-1;
    let p = p * t + 1.167_699_9e-1;
    let p = p * t - 1.242_014_1e-1;
    let p = p * t + 1.424_932_3e-1;
    let p = p * t - 1.666_805_7e-1;
    let p = p * t + 2.000_071_5e-1;
    let p = p * t - 2.499_999_4e-1;
    let p = p * t + 3.333_333e-1;
    let square = t * t;
    let ln = t + (p * t * square - 0.5 * square);
    exponent as f32 + ln * core::f32::consts::LOG2_E
}

/// What [`power`] takes for log₂ of alpha: this much of it …
pub const POWER_SCALE: f32 = 0.014_991_77;
/// … and this.
pub const POWER_SHIFT: f32 = 0.722_032_7;

/// What [`power`] adds to the square of its argument.
pub const POWER_SUM: f32 = 0.478_666_73;

/// Alpha from `s = POWER_SHIFT + POWER_SCALE log₂ alpha`, as `(s² + POWER_SUM)³²`: seven operations. For alphas from
/// 2⁻⁸ to 1 the error is at most 7·10⁻⁵, 1/56 of a step of 8 bits. Below 2⁻⁸ it is any number. The constants have the
/// least error of this form.
pub fn power(s: f32) -> f32 {
    let p = s * s + POWER_SUM;
    let p = p * p;
    let p = p * p;
    let p = p * p;
    let p = p * p;
    p * p
}

/// The derivative of the logarithm of [`power`] by that of the alpha which it stands for: close to 1.
pub fn power_slope(s: f32) -> f32 {
    const FACTOR: f32 = 64.0 * POWER_SCALE / core::f32::consts::LN_2;
    FACTOR * s / (s * s + POWER_SUM)
}

/// Results of [`sample`].
pub const RESULTS: usize = 10;

/// What stage `arithmetic` computes from three numbers: every operation that a portable picture is made of. `a` in
/// [2⁻¹²⁵, 2¹²⁵], `c` in [−125, 125].
pub fn sample(a: f32, b: f32, c: f32) -> [f32; RESULTS] {
    [
        a + b,
        a - b,
        a * b,
        // What a device must not fuse.
        a * b + c,
        c - a * b,
        reciprocal(a),
        inverse_sqrt(a),
        sqrt(a),
        log2(a),
        power(POWER_SHIFT + POWER_SCALE * c),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every exponent in `exponents`, with mantissas all over.
    fn numbers(exponents: std::ops::Range<i32>) -> impl Iterator<Item = f32> {
        let mantissas = (0..1 << 23).step_by(4999);
        exponents.flat_map(move |e| {
            mantissas.clone().map(move |m| f32::from_bits(((e + 127) as u32) << 23 | m))
        })
    }

    fn worst(numbers: impl Iterator<Item = f32>, error: impl Fn(f32) -> f64) -> f64 {
        numbers.map(error).fold(0.0, f64::max)
    }

    fn relative(got: f32, exact: f64) -> f64 {
        (f64::from(got) / exact - 1.0).abs()
    }

    #[test]
    fn errors_are_as_stated() {
        const ULP: f64 = 1.0 / (1 << 24) as f64 * 2.0;
        let of = |f: fn(f32) -> f32, exact: fn(f64) -> f64| {
            worst(numbers(-125..125), |x| relative(f(x), exact(f64::from(x))))
        };
        let r = of(reciprocal, |x| 1.0 / x);
        assert!(r < 1.5 * ULP, "reciprocal: {} ulp", r / ULP);
        let r = of(inverse_sqrt, |x| 1.0 / x.sqrt());
        assert!(r < 2.0 * ULP, "inverse_sqrt: {} ulp", r / ULP);
        let r = of(sqrt, f64::sqrt);
        assert!(r < 2.0 * ULP, "sqrt: {} ulp", r / ULP);
        let r = worst(numbers(-8..1), |x| (f64::from(log2(x)) - f64::from(x).log2()).abs());
        assert!(r < 3e-7, "log2: {r}");
        let alphas = (-8_000..=0).map(|i| i as f32 * 0.001);
        let r = worst(alphas, |x| {
            (f64::from(power(POWER_SHIFT + POWER_SCALE * x)) - f64::from(x).exp2()).abs()
        });
        assert!(r < 7e-5, "power: {r}");
    }

    #[test]
    fn exact_values_stay_exact() {
        assert_eq!((reciprocal(1.0), reciprocal(-4.0)), (1.0, -0.25));
        assert_eq!((sqrt(0.0), sqrt(-1.0), sqrt(f32::NAN)), (0.0, 0.0, 0.0));
        assert_eq!((log2(1.0), log2(0.25), log2(8.0)), (0.0, -2.0, 3.0));
    }
}
