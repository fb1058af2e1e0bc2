//! The fjord's water, which no daylight reaches: what it takes from a beam of light, and where it scatters it to.

use glam::Vec3;

/// Loss along a path by absorption and scattering together (beam attenuation, c), per metre and channel.
const ATTENUATION: Vec3 = Vec3::new(0.42, 0.17, 0.20);
/// Of it what is scattered (b).
const SCATTERING: Vec3 = Vec3::new(0.085, 0.09, 0.10);

/// The share of a beam that is left after a path.
pub fn kept(metres: f32) -> Vec3 {
    (-ATTENUATION * metres).exp()
}

/// Radiance per metre of path and irradiance that the water scatters into another direction. `turn`: cosine of the
/// angle between the light's direction and the new one.
pub fn scattered(turn: f32) -> Vec3 {
    // Most goes on nearly as it came; a small part goes anywhere (two terms, as V. Haltrin, "One-parameter two-term
    // Henyey–Greenstein phase function for light scattering in seawater", Applied Optics 41, 2002, has them).
    SCATTERING * (0.97 * henyey_greenstein(0.92, turn) + 0.03 * henyey_greenstein(-0.25, turn))
}

/// The share of light that turns by an angle, per steradian, with a mean cosine of `g`.
fn henyey_greenstein(g: f32, turn: f32) -> f32 {
    let square = (1.0 + g * g - 2.0 * g * turn).max(1e-4);
    (1.0 - g * g) / (4.0 * std::f32::consts::PI * square * square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_scattered_is_all_of_the_scattering() {
        let steps = 200_000;
        let width = 2.0 / steps as f32;
        let over_turns = (0..steps).map(|i| scattered(-1.0 + (i as f32 + 0.5) * width));
        let whole = over_turns.sum::<Vec3>() * width * std::f32::consts::TAU;
        assert!((whole / SCATTERING - 1.0).abs().max_element() < 0.01, "{whole}");
    }

    #[test]
    fn most_goes_forward_and_red_goes_first() {
        assert!(scattered(0.95).y > 40.0 * scattered(-0.9).y);
        assert!(scattered(-1.0).y > scattered(-0.3).y);
        assert!(kept(3.0).x < 0.6 * kept(3.0).y);
    }
}
