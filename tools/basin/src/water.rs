//! What the water does to light: attenuation and backscatter that differ by wavelength.

use glam::{Quat, Vec3};

use super::growth::progress;

/// Number of directions that direct light comes from.
pub const LAMP_COUNT: usize = 4;

/// A body of water, and the light above it. Vectors have a value for each channel, linear RGB.
#[derive(Clone)]
pub struct Water {
    /// Loss of a surface's radiance along the line of sight, `β_d`, per metre.
    pub attenuation: Vec3,
    /// Growth of the veil along the line of sight, `β_b`, per metre.
    pub backscatter: Vec3,
    /// Radiance of water without end, `B∞`.
    pub veil: Vec3,
    /// Loss of the light on its way down from the surface, per metre.
    pub downwelling: Vec3,
    /// Height of the surface, metres.
    pub surface: f32,
    /// Directions towards the direct light (before normalisation).
    pub lamps: [Vec3; LAMP_COUNT],
    /// All light, beside that of the basin's lamps.
    pub light: Vec3,
}

impl Water {
    /// Clear tap water, below a hall's four lamps.
    pub const BASIN: Water = Water {
        attenuation: Vec3::new(0.19, 0.07, 0.06),
        backscatter: Vec3::new(0.16, 0.12, 0.11),
        veil: Vec3::new(0.012, 0.070, 0.095),
        downwelling: Vec3::new(0.09, 0.03, 0.025),
        surface: 5.6,
        lamps: [
            Vec3::new(0.35, 0.10, 1.0),
            Vec3::new(0.25, 0.42, 1.0),
            Vec3::new(-0.05, 0.30, 1.0),
            Vec3::new(0.08, -0.02, 1.0),
        ],
        light: Vec3::ONE,
    };

    /// The basin weeks later: a little more turbid and greener, the hall's light dimmer and from elsewhere.
    pub fn basin_after(weeks: f32) -> Water {
        let clear = Water::BASIN;
        let far = progress(weeks);
        let turn = Quat::from_rotation_z(0.08 * weeks);
        let lower = Vec3::new(1.0 + 0.5 * far, 1.0 + 0.5 * far, 1.0);
        Water {
            attenuation: clear.attenuation * (1.0 + 0.14 * far),
            backscatter: clear.backscatter * (1.0 + 0.25 * far),
            veil: clear.veil * Vec3::ONE.lerp(Vec3::new(1.15, 1.10, 0.90), far),
            lamps: clear.lamps.map(|lamp| turn * (lamp * lower)),
            light: Vec3::ONE.lerp(Vec3::new(0.86, 0.95, 0.90), far),
            ..clear
        }
    }

    /// Green harbour water. The sun stands over the water; waves spread its light.
    pub const HARBOUR: Water = Water {
        attenuation: Vec3::new(0.30, 0.11, 0.19),
        backscatter: Vec3::new(0.26, 0.20, 0.22),
        veil: Vec3::new(0.020, 0.080, 0.045),
        downwelling: Vec3::new(0.15, 0.05, 0.09),
        surface: 5.4,
        lamps: [
            Vec3::new(0.85, 0.30, 1.0),
            Vec3::new(0.70, 0.42, 1.0),
            Vec3::new(0.78, 0.22, 1.0),
            Vec3::new(0.62, 0.34, 1.0),
        ],
        light: Vec3::splat(1.5),
    };

    /// The same harbour on another day: more silt, and the sun further along.
    pub const HARBOUR_LATER: Water = Water {
        attenuation: Vec3::new(0.32, 0.12, 0.205),
        backscatter: Vec3::new(0.28, 0.215, 0.235),
        lamps: [
            Vec3::new(0.88, 0.16, 1.0),
            Vec3::new(0.73, 0.28, 1.0),
            Vec3::new(0.81, 0.08, 1.0),
            Vec3::new(0.65, 0.20, 1.0),
        ],
        light: Vec3::splat(1.4),
        ..Water::HARBOUR
    };

    /// A fjord's deep water, which no daylight reaches. What lamps do in it: `medium`.
    pub const BLACK: Water = Water { veil: Vec3::ZERO, light: Vec3::ZERO, ..Water::BASIN };

    /// Radiance after `range` metres: `C = J exp(−β_d z) + B∞ (1 − exp(−β_b z))`
    /// (Akkaynak and Treibitz, "A Revised Underwater Image Formation Model", CVPR 2018, eq. 20).
    pub fn through(&self, radiance: Vec3, range: f32) -> Vec3 {
        let veil = self.veil * (Vec3::ONE - (-self.backscatter * range).exp());
        radiance * (-self.attenuation * range).exp() + veil
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn water_keeps_the_near_and_veils_the_far() {
        let red = Vec3::new(0.8, 0.1, 0.1);
        for water in [Water::BASIN, Water::basin_after(26.0), Water::HARBOUR, Water::HARBOUR_LATER]
        {
            assert_eq!(water.through(red, 0.0), red);
            assert!((water.through(red, 1e3) - water.veil).abs().max_element() < 1e-6);
            assert!(water.through(red, 3.0).x < 0.6 * red.x);
        }
    }
}
