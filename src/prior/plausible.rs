//! Whether a scene's numbers look as if they stood on another scale than its format says.

use super::coordinate_frame::CoordinateFrame;
use super::splats::Splats;
use super::warning::PriorWarning;

/// Fewest splats by which that is judged.
const FEWEST: usize = 50;
/// No scene of a smaller spread has splats of one unit and more alone.
const LARGE: f32 = 100.0;
/// No trained colour is so far from grey, as a constant coefficient of the spherical harmonics.
const BRIGHT: f32 = 30.0;

/// Warnings of such numbers.
pub fn warnings(splats: &Splats, frame: &CoordinateFrame) -> Vec<PriorWarning> {
    let mut found = Vec::new();
    let mut warn = |what, looks_like| found.push(PriorWarning::LooksLike { what, looks_like });
    if splats.len() < FEWEST {
        return found;
    }
    if frame.spread < LARGE && splats.log_scales.iter().flatten().all(|s| *s >= 0.0) {
        warn("the scales", "lengths, not logarithms of lengths");
    }
    if splats.opacity_logits.iter().all(|logit| (0.0..=1.0).contains(logit)) {
        warn("the opacities", "values from 0 to 1, not logits");
    }
    let mut constant = splats.sh.chunks_exact(splats.sh_stride()).flat_map(|sh| &sh[..3]);
    let brightest = constant.clone().copied().fold(0.0, f32::max);
    if brightest > BRIGHT && constant.all(|value| *value >= 0.0) {
        warn("the colours", "values from 0 to 255, not spherical harmonics");
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample_splats;
    use super::*;

    #[test]
    fn numbers_on_another_scale_are_told() {
        let mut splats = sample_splats(60, 1);
        splats.sh.iter_mut().for_each(|v| *v *= 0.01);
        let told =
            |splats: &Splats| warnings(splats, &CoordinateFrame::of(&splats.positions)).len();
        assert_eq!(told(&splats), 0);
        splats.log_scales.iter_mut().flatten().for_each(|s| *s = s.exp());
        assert_eq!(told(&splats), 1);
        splats.opacity_logits.iter_mut().for_each(|l| *l = 1.0 / (1.0 + (-*l).exp()));
        assert_eq!(told(&splats), 2);
        splats.sh.iter_mut().for_each(|v| *v = v.abs() * 255.0);
        assert_eq!(told(&splats), 3);
        splats.positions.iter_mut().flatten().for_each(|p| *p *= 1e4);
        assert_eq!(told(&splats), 2, "a scene of large units may have large splats alone");
    }
}
